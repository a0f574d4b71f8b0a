"""`truepose maslow`."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose import files, robotfile
from truepose.calibration.causes.hypothesis import LN_RATE
from truepose.calibration.causes.search import DECISIVE
from truepose.commands.options import Output, file_text, wrote
from truepose.design.candidates import CandidatePoses, drawn, reachable
from truepose.design.poses import plan_poses
from truepose.exceptions import InputError, TrueposeError
from truepose.show import Cell, Table, fixed, number
from truepose_sleds import belts, firmware, frame, to_read
from truepose_sleds.belts import BELTS, Model, Sled
from truepose_sleds.to_read import FEWEST, Readings

#: Candidate poses over the workspace for the next ones.
CANDIDATES = 400
#: Scatter of the anchors over σ from which σ is too small: of simulated sleds 1 % exceed it.
DISHONEST = 1.6
#: σ by which a strain must be below 0 to be named.
SHORTER = 3
#: Number of disjoint parts that are calibrated separately, each of `FEWEST` poses at least.
PARTS = 4
#: Share of the rows that must have a pose.
REACHED = 0.9
#: Largest difference of the log's common extension from the firmware's, m, that it then lacks.
LACKS = 0.06


def command(
    log: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG [MASLOW.YAML]",
            help="The log: CLBM text, a serial log, or CSV with columns tl, tr, bl, br, mm; the "
            "machine's settings.",
        ),
    ],
    heights: Annotated[
        str | None,
        typer.Option(
            metavar="TL,TR,BL,BR",
            help="Of the anchors over the arms, mm.",
            show_default="the settings'",
        ),
    ] = None,
    tightened: Annotated[
        belts.Tightened,
        typer.Option(
            help="How the lower belts are pulled for a reading: the belt of the sled's side first, "
            "both alike, or nothing stretches."
        ),
    ] = "sides",
    next_poses: Annotated[
        int | None,
        typer.Option("--plan", min=1, help="How many poses to say that are worth reading next."),
    ] = None,
    lines: Annotated[
        Path | None, typer.Option(help="Text file to write: the lines for the firmware.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Calibrated robot file to write.")
    ] = None,
    output: Output = Output(),
) -> None:
    """Calibrate a Maslow sled: its anchors from its own log, with a σ for each.

    Prints the lines for the firmware, what the poses cannot tell apart, slipped belts, wrong
    readings, and the error of held-out rows: lower belts predicted by the upper ones.

    Example: **truepose maslow serial.log maslow.yaml --lines anchors.txt**
    """
    outputs = [robotfile.output(out, "-o")] if out else []
    outputs += [files.Output(lines, "lines", "--lines")] if lines else []
    files.check(outputs, log, output.force)
    read = to_read.read(log)
    if heights is not None:
        read = projected(read, heights)
    answer = list(read.notes)
    try:
        read, lost = with_poses(read)
        sled = belts.calibrate(read.lengths, Model(True, tightened))
    except TrueposeError as error:
        raise InputError(f"{read.source}: {error}") from None
    sideways = on_its_side(sled)
    sled, slipped = (sled, []) if sideways else belts.without_slips(sled, read.lines, read.word)
    missing = 0.0
    if abs(sled.extension[0] - read.extension) < LACKS:
        missing = read.extension
        answer.append(
            f"the lengths lack the extension of {1e3 * missing:.1f} mm that the firmware adds"
        )
    answer += [*slipped, *suspects(sled, read), *lost]
    answer += sideways
    answer += honesty(sled)
    notes = [
        f"{len(read.lengths)} poses; unknown: {sled.model}",
        f"σ of a belt's reading, estimated from the log: {1e3 * sled.sigma:.2f} mm",
        f"prior σ, assumed: anchors {1e3 * belts.ANCHOR:.0f} mm, a common extension "
        f"{1e3 * belts.EXTENSION:.0f} mm, offsets {1e3 * belts.OFFSET:.0f} mm, strains "
        f"{100 * belts.STRAIN:.1f} %",
        *apart(sled),
    ]
    table, text = pasted(sled, read, missing)
    further = [] if next_poses is None else [worth_reading(sled, next_poses)]
    output.show([table, unknowns(sled), models(sled), *further], answer, notes)
    contents = [file_text(sled.fit.robot)] * bool(out) + [text] * bool(lines)
    files.write(dict(zip(outputs, contents, strict=True)), log, output.force)
    wrote(output.how, out, lines)


def on_its_side(sled: Sled) -> list[str]:
    """Return a warning of belts exchanged across the frame, or a note on an upright frame."""
    gain = belts.exchanged(sled)
    best = max(gain.values(), default=-np.inf)
    width, height = (1e3 * side for side in sled.size)
    if (odds := best + LN_RATE) > DECISIVE:
        which = " exchanged, or ".join(of for of in gain if gain[of] > best - DECISIVE)
        return [
            f"warning: belts {which} exchanged (odds 10^{odds / np.log(10):.0f}): only then the "
            "belts stretch as by gravity and tightening; the frame found is on its side, "
            f"{width:.0f} mm wide and {height:.0f} mm high: check the columns"
        ]
    if height > width and best > -DECISIVE:
        return [
            f"the frame found is upright, {width:.0f} mm wide and {height:.0f} mm high; if yours is"
            f" wider than high, belts {', or '.join(gain)}, are exchanged: the log, whose belts "
            "hardly stretch, fits both"
        ]
    return []


def with_poses(read: Readings) -> tuple[Readings, list[str]]:
    """Return the readings without a few rows that have no pose in the best frame, and a line."""
    robot = belts.robot_of(frame.start(read.lengths), belts.READING, Model()).expected()
    good = np.isfinite(robot.fkm(read.lengths[:, :2], errors="nan")).all(axis=1)
    if good.all() or good.mean() < REACHED or good.sum() < FEWEST:
        return read, []
    numbers = ", ".join(map(str, read.lines[~good]))
    said = f"{read.word} {numbers}: left out: the upper belts do not meet in a frame like that"
    return read._replace(lengths=read.lengths[good], lines=read.lines[good]), [said]


def projected(read: Readings, heights: str) -> Readings:
    """Return the readings for anchors at these heights.

    The firmware logs e + √(b² - h²) of a belt of length b, with its own heights h and extension e.
    """
    try:
        given = np.array([1e-3 * float(part) for part in heights.split(",")])
    except ValueError:
        given = np.zeros(0)
    if len(given) != 4 or not ((given >= 0) & (given < 1)).all():
        raise InputError(
            f"--heights {heights}: must be four numbers from 0 to 1000, tl,tr,bl,br (mm)"
        )
    usual = zip(BELTS, to_read.HEIGHTS, strict=True)
    own = np.array([read.heights.get(belt, 1e-3 * z) for belt, z in usual])
    belt2 = (read.lengths - read.extension) ** 2 + own**2 - given**2
    if (belt2 <= 0).any():
        raise InputError(f"--heights {heights}: a belt is shorter than its anchor's height")
    known = {f"{belt}Z": 1e3 * z for belt, z in zip(BELTS, given.tolist(), strict=True)}
    lengths = read.extension + np.sqrt(belt2)
    return read._replace(lengths=lengths, settings=read.settings | known)


def pasted(sled: Sled, read: Readings, missing: float) -> tuple[Table, str]:
    """Return the firmware's settings with and without its correction of stretch, and the lines.

    The lines are those for the correction where the machine's settings have it.
    """
    plain, stretch = (firmware.best(sled, of, missing) for of in (True, False))
    pull = read.settings.get("calibrationPullForce", firmware.PULL)
    newtons = firmware.stiffness(sled, pull)
    rows = [
        [
            key,
            fixed(1e3 * v, 1),
            fixed(1e3 * stretch.values[key], 1),
            fixed(1e3 * plain.sigma[key], 1),
        ]
        for key, v in plain.values.items()
    ]
    rows += [[f"{belt}Z", *[fixed(1e3 * z, 1)] * 2, ""] for belt, z in read.heights.items()]
    rows += [["beltAxialStiffness", "", fixed(newtons, 0), ""]] if newtons else []
    column = 2 if "beltAxialStiffness" in read.settings else 1
    text = "".join(f"$/{read.prefix}{row[0]}={row[column]}\n" for row in rows if row[column])
    title = f"Settings $/{read.prefix}… for the firmware, mm (stiffness in N); σ over power cycles"
    header = ["setting", "as it is", "with stretch (#1060)", "σ"]
    for what, error in (
        ("position error in this run, rms", "error"),
        ("expected in another run, rms", "expected"),
    ):
        rows.append([what, *(fixed(1e3 * getattr(of, error), 2) for of in (plain, stretch)), ""])
    return Table("settings", title, header, rows), text


def unknowns(sled: Sled) -> Table:
    """Return a table with one row for each unknown."""
    rows = []
    for name, of in sled.unknowns.items():
        strain = name.startswith("strain")
        factor, unit = (100.0, "%") if strain else (1e3, "mm")
        cells = [fixed(factor * v, 3 if strain else 1) for v in (of.value, of.sigma)]
        rows.append([name, *cells, unit, of.verdict])
    title = "Anchors (from bl, x towards br), belts' offsets (length = reading + offset), strains"
    return Table("unknowns", title, ["unknown", "value", "σ", "unit", "verdict"], rows)


def models(sled: Sled) -> Table:
    """Return each model's errors of the lower belts on held-out ninths of the rows."""
    known = [Model(False, "off"), Model(True, "off"), Model(True, "alike"), Model(True, "sides")]
    rows, named = [], list(sled.fit.outliers)
    for model in known:
        wrong = 1e3 * belts.held_out(np.delete(sled.undone, named, axis=0), model)
        used = "used" if model == sled.model else ""
        cells = [number(v) for v in (np.sqrt(np.mean(wrong**2)), np.median(np.abs(wrong)))]
        rows.append([str(model), *cells, Cell(used, used)])
    without = ", without the rows named wrong" if named else ""
    title = f"Lower belts predicted by the upper ones, on held-out ninths{without}"
    return Table("held_out", title, ["unknown", "rms (mm)", "median (mm)", "here"], rows)


def apart(sled: Sled) -> list[str]:
    """Return offsets that the poses cannot separate from anchors, and the effect of one σ."""
    names, covariance = list(sled.unknowns), sled.fit.joint_covariance
    own = [k for k, name in enumerate(names) if name.endswith("offset")]
    anchors = [k for k, name in enumerate(names) if name.endswith((".x", ".y"))]
    root = np.linalg.cholesky(sled.fit.prior_covariance[np.ix_(own, own)])
    half = np.linalg.solve(root, np.linalg.cholesky(covariance[np.ix_(own, own)]))
    vectors, ratio, _ = np.linalg.svd(half)
    said = []
    for v, r in zip(vectors.T, ratio, strict=True):
        if r < 0.5:
            break
        step = r * root @ v
        moves = covariance[np.ix_(anchors, own)] @ np.linalg.solve(root.T, v) / r
        terms = ", ".join(
            f"{names[own[j]]} {1e3 * step[j]:+.1f}" for j in np.argsort(-np.abs(step))
        )
        largest = np.argsort(-np.abs(moves))[:2]
        with_it = ", ".join(f"{names[anchors[j]]} {1e3 * moves[j]:+.1f}" for j in largest)
        said.append(f"offsets or anchors? One σ of {terms} is {with_it} mm; {r:.2f} of the prior σ")
    return said or ["the poses tell offsets and anchors apart"]


def worth_reading(sled: Sled, count: int) -> Table:
    """Return the poses with the largest marginal gain and the accuracy with each.

    The belts are pulled differently while working, so the accuracy is of anchors and zeros only.
    """
    robot = sled.fit.robot
    x = drawn(robot, CANDIDATES, 0)
    x = x[reachable(robot, x, robot.highest_level)]
    acting = belts.influences(robot, x, sled.model.tightened)
    candidates = CandidatePoses(poses=x, influences=acting)
    found = plan_poses(robot, count, candidates=candidates, after=sled.fit)
    before = 1e3 * found.sigma[0, -1]
    rows = [
        [str(k), *(number(1e3 * v) for v in step.poses[0]), fixed(1e3 * sigma)]
        for k, (step, sigma) in enumerate(zip(found.steps, found.sigma[1:, -1], strict=True), 1)
    ]
    title = f"What to read next; σ of the sled's position is {before:.2f} mm before"
    return Table("next", title, ["pose", "x (mm)", "y (mm)", "σ of the position then (mm)"], rows)


def suspects(sled: Sled, read: Readings) -> list[str]:
    """Return poses that do not fit, by row and belt."""
    return [
        f"{read.word} {read.lines[k]}: {belt} reads {1e3 * wrong:+.1f} mm off what the other belts "
        "say: left out"
        for k, belt, wrong in sled.suspects()
    ]


def honesty(sled: Sled) -> list[str]:
    """Return warnings of belts that get shorter by a pull, and of a σ that is too small."""
    said = [
        f"{name} is {100 * of.value:.2f} ± {100 * of.sigma:.2f} %: a pull cannot make a belt "
        "shorter; something else acts like it: see --tightened"
        for name, of in sled.unknowns.items()
        if name.startswith("strain") and of.value < -SHORTER * of.sigma
    ]
    if len(sled.lengths) < PARTS * FEWEST:
        return said
    ratio = belts.spread(sled.undone, sled.model, PARTS)
    if ratio <= DISHONEST:
        return said
    return [
        *said,
        f"do not rely on σ: anchors from disjoint quarters of the poses scatter by {ratio:.1f} of "
        "the readings' part of it; something is missing in the model",
    ]
