"""Tables about a calibration: readings, parameters and the accuracy to expect."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.calibration import learnt
from truepose.calibration.between import Between
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import explained, review
from truepose.calibration.causes.hypothesis import Case
from truepose.calibration.causes.lasting import as_read
from truepose.calibration.expectation import Expectation, expect
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import fit_to
from truepose.calibration.registration import Registered, sigmas
from truepose.exceptions import PoseError, TrueposeError
from truepose.logs import Log
from truepose.robot import Axis, Robot, coordinate_axes, in_print, samples_or_home, summed
from truepose.show import PRINT, Cell, Table, fixed, named, number

#: One row in so many is held out.
FOLD = 5
#: Calls of `progress` that :func:`assess` makes.
STEPS = 3
#: Errors of the marker in the tracker's frame, not of the pose in the base frame.
SEEN = "in the tracker's frame"
#: Poses sampled from the workspace to predict the accuracy.
POSES = 500


@dataclass(frozen=True)
class Assessment:
    """A calibration and its tests. N rows, k = r (+ n with external measurements) columns."""

    fit: Calibration
    log: Log
    names: tuple[str, ...]  #: of the k columns
    before: Expectation  #: of all rows by the motors, at the prior mean
    after: Expectation  #: by the motors, at the calibrated geometry
    held_out: Array  #: (N, k) residuals of the held-out rows, fitted without them; else NaN
    reference_pose: Array  #: (n,)
    where: str  #: description of `poses`
    poses: Array  #: (P, n) of the accuracy
    accuracy: dict[tuple[str, str], Array]  #: (before/after, absolute/referenced) -> (P, n, n)
    notes: tuple[str, ...]  #: findings in the log, before and after the fit


def assess(
    case: Case,
    notes: Sequence[str] = (),
    refused: Sequence[str] = (),
    between: Between = Between(),
    reference_pose: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
    searched: Callable[[float], None] = lambda _: None,
) -> Assessment:
    """Calibrate by a checked log, and again without every fifth row; predict the accuracy.

    `progress` is called with each step's name, `searched` with the share of causes tried;
    `refused` are the reasons of a check against a fit, unless a cause is found.
    """
    robot, log, angle = case.robot, case.log, case.options.measured_angle_sigma

    def expected(by: Robot, part: Log, of: Registered | None) -> Expectation:
        sigma = sigmas(robot, part.measured_sigma, angle, len(part.lines))
        return expect(by, part.readings, part.measured, sigma, of, fit.level, part.loads)

    case = replace(case, differences=between.of(robot, log))
    fit, of = explained(case, refused, searched)
    fit, log = as_read(fit, of)
    progress("fit")
    model, seen = fit.prior.expected(), fit.registration
    before = expected(model, log, seen and seen.begun())
    after = expected(fit.robot, log, seen)
    held_out = np.full_like(after.residual, np.nan)
    out = np.arange(len(log.lines)) % FOLD == FOLD - 1
    if out.any():
        try:
            rest = of.by(case.options.loss).only(np.flatnonzero(~out))
            part, _ = as_read(fit_to(replace(rest, differences=between.of(robot, rest.log))), of)
            held_out[out] = expected(part.robot, log.only(out), part.registration).residual
        except TrueposeError as error:
            notes = [*notes, f"held-out lines: {error}"]
    progress("held-out lines")
    touch = robot.home if reference_pose is None else np.asarray(reference_pose, dtype=float)
    where, poses = _poses(fit)
    ahead: dict[tuple[str, str], Array] = {}
    for how, at in (("absolute", None), ("referenced", touch)):
        for when, known in (("before", model), ("after", fit.robot)):
            reached = _reached(fit, known, poses)
            ahead[when, how] = accuracy(known, reached, reference_pose=at, level=fit.level)
    if seen is not None and seen.sigma.any():
        ahead["after", SEEN] = fit.accuracy_seen(_reached(fit, fit.robot, poses))
    progress("accuracy")
    outside = robot.coordinates if log.measured is not None else ()
    names = (*robot.sensors, *(f"measured_{name}" for name, _ in outside))
    notes = [*notes, *review(fit, log), *fit.notes]
    return Assessment(
        fit, log, names, before, after, held_out, touch, where, poses, ahead, tuple(notes)
    )


def _reached(fit: Calibration, robot: Robot, x: Array) -> Array:
    return x[finite_rows(robot.ikm(x, errors="nan", level=fit.level))]


def _poses(fit: Calibration) -> tuple[str, Array]:
    """Return a description and poses of the workspace, else those of the log."""
    x = _reached(fit, fit.robot, samples_or_home(fit.robot, POSES))
    if fit.robot.spec.workspace and len(x):
        return "over the workspace", x
    x = fit.x[finite_rows(fit.x)]
    if len(x) == 0:
        raise PoseError(f"{fit.robot.name}: no line of the log has a pose")
    return "over the log's poses", x


def counted(result: Assessment) -> Array:
    """Return the rows that count in any rms, (N,) bool: no outliers, none left out."""
    return (result.fit.status == "ok") & (result.fit.weights >= 0.1)


def _rms(values: Array) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def residuals(result: Assessment) -> Table:
    """Tabulate readings' rms errors against the motors' prediction; last: poses fitted."""
    rows, good = [], counted(result)
    robot, after, seen = result.fit.robot, result.after, result.fit.registration
    fitted = result.fit.residuals[:, robot.m :]
    if seen is not None:
        fitted = np.hstack([fitted, seen.see(robot, result.fit.x, result.log.measured).residual])
    every = (result.before.residual, after.residual, result.held_out, after.sigma, fitted)
    for k, name in enumerate(result.names):
        factor, unit = in_print(robot, name)
        values = [_rms(factor * column[good, k]) for column in every]
        if values[0] is not None or values[1] is not None:
            rows.append([named("reading", name, unit), *map(number, values)])
    header = ["rms residual", "before", "after", "held out", "expected", "pose fitted"]
    return Table("residuals", "Each reading against its prediction by the motors", header, rows)


def worst(fit: Calibration) -> Table:
    """Tabulate the parameter combinations that the readings determine least."""
    rows = []
    for ratio, terms in fit.worst_known():
        text = " ".join(f"{v:+.2f} {name}" for name, v in terms.items())
        exact = " ".join(f"{float(v)!r} {name}" for name, v in terms.items())
        rows.append([fixed(ratio, 3), Cell(text.removeprefix("+"), exact)])
    header = ["σ / prior σ", "combination, each in units of its prior σ"]
    return Table("worst_known", "Worst-known combinations", header, rows)


def predicted(result: Assessment) -> Table:
    """Tabulate the rms of the predicted pose error, before and after, absolute and referenced."""
    robot = result.fit.robot
    total = summed(robot)
    axes = [Axis(total.name, *PRINT[total.unit]), *coordinate_axes(robot)]
    rows = []
    for (when, how), covariance in result.accuracy.items():
        mean = np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0)
        sigma = np.sqrt([mean[total.columns].sum(), *mean])
        cells = [number(axis.factor * float(of)) for axis, of in zip(axes, sigma, strict=True)]
        rows.append([f"{how}, {when}", *cells])
    count = len(result.accuracy["after", "absolute"])
    title = f"Predicted error of the pose, rms over {count} poses {result.where}"
    title += f"; calibrated on {int(counted(result).sum())} poses"
    return Table("accuracy", title, ["1σ bound", *(axis.label for axis in axes)], rows)


def registration_table(fit: Calibration) -> Table | None:
    """Tabulate the identified tracker frame and marker; None where they were known."""
    if not (every := fit.registration.known if fit.registration else []):
        return None
    rows = []
    for known in every:
        factor, unit = PRINT[known.unit]
        cells = [fixed(factor * v, 4) for v in (known.value, known.sigma)]
        rows.append([named("found", known.name, unit), *cells])
    title = "Registration: the base in the tracker's frame, the marker on the platform"
    return Table("registration", title, ["found", "value", "σ"], rows)


def differences_table(fit: Calibration) -> Table | None:
    """Tabulate the residuals of measured differences; None without any."""
    if fit.differences is None:
        return None
    rows = []
    for of in fit.differences.each:
        cells = [fixed(1e3 * v, 4) for v in (of.residual, of.left_out, of.left_out_sigma)]
        size = fixed(of.left_out / of.left_out_sigma)
        verdict = "wrong?" if of.doubtful else "outlier" if of.weight < 0.1 else ""
        rows.append([of.name, *cells, size, verdict])
    header = [
        "measured less expected",
        "by all (mm)",
        "by all others (mm)",
        "σ (mm)",
        "over σ",
        "verdict",
    ]
    return Table("differences", "Differences between poses", header, rows)


def beside_table(fit: Calibration) -> Table | None:
    """Tabulate unknowns of measured differences (planes, tool, print); None without any."""
    if fit.differences is None or not fit.differences.unknowns:
        return None
    known, plain = fit.differences.unknowns, (".slope.x", ".slope.y", ".slope.z", ".scale")
    units = {name: PRINT["" if name.endswith(plain) else "m"] for name in known}
    table = learnt.table(known, units, "unknown")
    table = replace(table, name="differences_own", title="Unknowns of the measured differences")
    return table.columns(0, 1, 3, 4, 5, 6)


def tables_of(result: Assessment) -> list[Table]:
    """Return every table that applies, in reading order."""
    fit = result.fit
    tables = [
        fit.causes.table() if fit.causes.verdict != "none" else None,
        residuals(result) if result.names else None,
        *(of(fit) for of in (Calibration.table, worst, differences_table, beside_table)),
        registration_table(fit),
        predicted(result),
    ]
    return [table for table in tables if table is not None]
