"""`truepose maslow`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from truepose import files, logs, robotfile
from truepose.arguments import Array
from truepose.commands.options import Force, How, file_text, wrote
from truepose.design.candidates import CandidatePoses, drawn, reachable
from truepose.design.poses import plan_poses
from truepose.exceptions import InputError
from truepose.integrations.maslow import belts
from truepose.integrations.maslow.belts import BELTS, Model, Sled
from truepose.show.table import Cell, Table, fixed, number
from truepose.show.terminal import Format, show

#: With fewer poses than unknowns of the largest model, the prior determines most of them.
FEWEST = 12
#: Candidate poses over the workspace for the next ones.
CANDIDATES = 400
#: Range of the anchors' scatter over σ in which σ is accepted.
HONEST = (0.8, 1.25)
#: Number of disjoint parts that are calibrated separately, each of `FEWEST` poses at least.
PARTS = 4


def command(
    log: Annotated[
        Path, typer.Argument(help="CSV: columns tl, tr, bl, br, the belts' lengths in mm.")
    ],
    heights: Annotated[
        str, typer.Option(help="Of the anchors tl,tr,bl,br over the sled's plane, mm.")
    ] = "116,69,47,89",
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
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Calibrated robot file to write.")
    ] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Calibrate a Maslow sled: its anchors from its own log, with a σ for each.

    Prints parameters that the poses cannot tell apart, wrong readings, and the error of held-out
    rows: lower belts predicted by the upper ones.

    Example: **truepose maslow log.csv -o sled.toml**
    """
    output = robotfile.output(out, "-o") if out else None
    files.check([output] if output else [], (log,), force)
    above = _heights(heights)
    lengths, lines = read(log, above)
    model = Model(True, tightened)
    before = [
        f"{len(lengths)} poses; anchors' heights {heights} mm; unknown: {model}",
        f"prior σ, assumed: anchors {1e3 * belts.ANCHOR:.0f} mm, offsets "
        f"{1e3 * belts.OFFSET:.0f} mm, strains {100 * belts.STRAIN:.1f} %",
    ]
    sled = belts.calibrate(lengths, above, model)
    before.append(f"σ of a belt's reading, as the log bears it out: {1e3 * sled.sigma:.2f} mm")
    width, height = (1e3 * side for side in sled.size)
    if height > width:  # as with two opposite columns exchanged
        before.append(
            f"warning: the frame found is higher than wide, {width:.0f} x {height:.0f} mm: columns "
            "bl and tr exchanged, or br and tl?"
        )
    further = [] if next_poses is None else [worth_reading(sled, next_poses)]
    answer = [*before, *apart(sled), *suspects(sled, lines), *honesty(lengths, above, model)]
    show([unknowns(sled), models(sled, above), *further], how, answer)
    if output:
        files.write({output: file_text(sled.fit.robot)}, (log,), force)
    wrote(how, out)


def read(path: Path, heights: list[float]) -> tuple[Array, Array]:
    """Return lengths in m and their row numbers; raise InputError if they are not a sled's."""
    lengths, lines = logs.reading.table(path, BELTS)
    for k, name in enumerate(BELTS):
        if (wrong := np.flatnonzero(~(lengths[:, k] > 0))).size:
            at = f"line {lines[wrong[0]]}: {name} = {lengths[wrong[0], k]:g}"
            raise InputError(f"{path}: {at}: must be a length, mm")
    if len(lengths) < FEWEST:
        raise InputError(f"{path}: {len(lengths)} poses: must be {FEWEST} or more")
    _, first, of = np.unique(lengths, axis=0, return_index=True, return_inverse=True)
    if (repeated := np.setdiff1d(np.arange(len(lengths)), first)).size:
        again = repeated[0]
        twin = first[of.ravel()[again]]
        raise InputError(
            f"{path}: line {lines[again]}: as line {lines[twin]}, digit for digit: a pose that is "
            "there twice counts twice"
        )
    lengths = 1e-3 * lengths
    if mistake := belts.mistakes(lengths):
        raise InputError(f"{path}: {mistake}")
    for k, belt in np.argwhere(lengths <= heights):
        reads, above = (f"{1e3 * v:g}" for v in (lengths[k, belt], heights[belt]))
        raise InputError(
            f"{path}: line {lines[k]}: {BELTS[belt]} = {reads}: must be more than the height of "
            f"its anchor, {above} (--heights)"
        )
    if mistake := belts.swapped(lengths, heights):
        raise InputError(f"{path}: {mistake}")
    return lengths, lines


def _heights(text: str) -> list[float]:
    try:
        heights = [1e-3 * float(part) for part in text.split(",")]
    except ValueError:
        heights = []
    if len(heights) != 4 or not all(0 <= z < 1 for z in heights):
        raise InputError(f"--heights {text}: must be four numbers from 0 to 1000, tl,tr,bl,br (mm)")
    return heights


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


def models(sled: Sled, heights: list[float]) -> Table:
    """Return each model's errors of the lower belts on held-out ninths of the rows."""
    known = [Model(False, "off"), Model(True, "off"), Model(True, "alike"), Model(True, "sides")]
    rows = []
    for model in known:
        wrong = 1e3 * belts.held_out(sled.lengths, heights, model)
        used = "used" if model == sled.model else ""
        cells = [number(v) for v in (np.sqrt(np.mean(wrong**2)), np.median(np.abs(wrong)))]
        rows.append([str(model), *cells, Cell(used, used)])
    title = "Lower belts predicted by the upper ones, on held-out ninths"
    return Table("held_out", title, ["unknown", "rms (mm)", "median (mm)", "here"], rows)


def apart(sled: Sled) -> list[str]:
    """Return offsets that the poses cannot separate from anchors, and the effect of one σ."""
    unknowns, covariance = sled.unknowns, sled.fit.joint_covariance
    names, said = list(unknowns), []
    prior = np.array([of.prior_sigma for of in unknowns.values()])
    own = [k for k, name in enumerate(names) if not name.endswith((".x", ".y"))]
    anchors = [k for k, name in enumerate(names) if name.endswith((".x", ".y"))]
    scaled = covariance[np.ix_(own, own)] / np.outer(prior[own], prior[own])
    ratio2, vectors = np.linalg.eigh(scaled)
    for k in range(len(ratio2) - 1, -1, -1):
        if ratio2[k] < 0.5**2:
            break
        direction = vectors[:, k] / prior[own]
        moves = covariance[np.ix_(anchors, own)] @ direction / np.sqrt(ratio2[k])
        largest = np.argsort(-np.abs(moves))[:2]
        terms = " ".join(
            f"{'-' if vectors[j, k] < 0 else '+'}{names[own[j]]}"
            for j in np.argsort(-np.abs(vectors[:, k]))
            if abs(vectors[j, k]) > 0.3
        )
        with_it = ", ".join(f"{names[anchors[j]]} {1e3 * moves[j]:+.1f} mm" for j in largest)
        said.append(
            f"offsets or anchors? {terms}: known to {np.sqrt(ratio2[k]):.2f} of the prior σ "
            f"before; by one σ of it {with_it}"
        )
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


def suspects(sled: Sled, lines: Array) -> list[str]:
    """Return poses that do not fit, by row and belt."""
    return [
        f"line {lines[k]}: {belt} reads {1e3 * wrong:+.1f} mm off what the other belts say: counts "
        "for next to nothing"
        for k, belt, wrong in sled.suspects()
    ]


def honesty(lengths: Array, heights: list[float], model: Model) -> list[str]:
    """Return whether anchors from disjoint quarters of the poses scatter as σ predicts."""
    if len(lengths) < PARTS * FEWEST:
        return [
            f"whether σ is honest quarters of {len(lengths)} poses are too few to say: "
            f"{PARTS * FEWEST} or more would"
        ]
    found = belts.spread(lengths, heights, model, PARTS)
    low, high = HONEST
    verdict = (
        "as σ says"
        if low <= found.of_readings <= high
        else "more than σ says: something is missing in the model"
        if found.of_readings > high
        else "less than σ says: what is missing in the model is the same in each quarter"
    )
    return [
        f"anchors from disjoint quarters of the poses scatter by {found.of_stated:.2f} of their σ: "
        "what σ has from the prior, that of the offsets above all, is the same in each quarter and "
        f"scatters in none; by {found.of_readings:.2f} of the rest of it: {verdict}"
    ]
