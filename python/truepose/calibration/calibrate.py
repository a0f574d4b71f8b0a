"""Self-calibration of a robot from a log of its own readings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import logs, moved
from truepose.arguments import finite_rows, require
from truepose.calibration import log_checks
from truepose.calibration.between import Between
from truepose.calibration.bound import accuracy
from truepose.calibration.cause import Causes
from truepose.calibration.causes.hypothesis import Case, Hypothesis, equations, lost
from truepose.calibration.causes.lasting import as_read
from truepose.calibration.causes.search import (
    DECISIVE,
    REJECTED,
    Explained,
    Search,
    consistent,
    search,
    suspicion,
    vague,
)
from truepose.calibration.differences import Difference, measurements
from truepose.calibration.expectation import expect
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import UNITS, fit_to, inflated, misfit
from truepose.calibration.influences import NuisanceParameter, patterns
from truepose.calibration.lean import leaning_of
from truepose.calibration.options import CalibrationOptions
from truepose.calibration.registration import KnownPose
from truepose.exceptions import InputError, PoseError
from truepose.logs import Log
from truepose.robot import Payloads, Robot, require_robot
from truepose.robot.conditions import reading_offsets

#: Factor of the σ from which a misfit is notable.
NOTABLE = 1.2
#: Share of outliers below which a robust fit asks for no cause.
OUTLIERS = 0.1
#: Disagreement of readings, in units of their noise, from which an unexplained fit is refused;
#: below which it is that of a healthy robot, whose noise is not known better.
APART, HEALTHY = 10.0, 2.0


@moved.grouped(
    CalibrationOptions,
    homing="influences=truepose.calibration.homings(robot, homing, sigma)",
)
def calibrate(
    robot: Robot,
    readings: ArrayLike | Mapping[str, ArrayLike] | Log | None = None,
    *,
    known_pose: KnownPose | None = None,
    measured: ArrayLike | None = None,
    measured_sigma: ArrayLike | float | None = None,
    differences: Sequence[Difference] = (),
    influences: Sequence[NuisanceParameter] = (),
    loads: Payloads | None = None,
    options: CalibrationOptions = CalibrationOptions(),
) -> Calibration:
    """Identify a robot's geometry from its own readings: maximum a posteriori, poses unknown.

    Prior means and σ are the tolerances of the robot file (or its last calibration). They also fix
    the gauges: parameters that no reading depends on keep their prior and are reported so.

    Parameters
    ----------
    robot : Robot
        Robot with the sensors in use that were read.
    readings : array_like, shape (N, n + r), or a table, optional
        Extended positions q_e = [q; r], m or rad; NaN where a sensor was not read. Or a dict of
        arrays, a list of dicts, or a pandas, polars or pyarrow table with columns q1 … qn, every
        sensor's name, measured_x, … for externally measured coordinates (of a spatial platform's
        orientation measured_rx, ry, rz, or measured_roll, pitch, yaw, or measured_qx, qy, qz, qw),
        plane and point for the names of touched features. A table is checked first; ``notes`` has
        the findings. Optional where `known_pose` is given.
    known_pose : tuple of array_like, or a table, optional
        Readings (n + r,) and the pose (n,) in the base frame at which they were taken (a dowel, a
        stop, a probe), NaN for unknown coordinates. A third entry is σ of the pose, m and rad;
        default 0, exact. Also (K, n + r) and (K, n), or a table with columns measured_x, …. Given
        with the log, or alone for a robot that is already calibrated.
        ``tp.accuracy(…, reference_pose=pose)`` predicts its accuracy.
    measured : array_like, shape (N, n), optional
        Externally measured coordinates of these poses, NaN where not measured.
    measured_sigma : float, or array_like, shape (n,) or (N, n), optional
        Their σ: of lengths (m; of a rotational platform's angles, rad), or of every coordinate.
        By default a table's columns measured_x_sigma, …, else 0.02 mm.
    differences : sequence of PlaneContacts, DistanceMeasurements and RepeatedPoses, optional
        Differences measured between these poses, by rows of the readings, from 0. They can
        calibrate a robot without sensors. By default a table's columns plane and point, with σ
        of 0.02 mm a touch.
    influences : sequence of NuisanceParameter, optional
        Additions to the readings of known pattern and unknown amount; for a log with several
        homings, :func:`truepose.calibration.homings`.
    loads : Payloads, optional
        Forces and measured tensions of each row, for robots whose file has compliances with
        tolerances; by default a table's columns load_x, … and q1_tension, ….
    options : CalibrationOptions
        Level, loss, registration, search for causes and the rest.

    Raises
    ------
    InputError
        Wrong shapes, no uncertain parameter, no reading beyond those that determine the poses; a
        cause that explains the log better than its being correct.
    PoseError
        No row of the readings fits the robot, or the search does not converge.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> robot = tp.load("h4")
    >>> true = robot.expected().replace({"chain1.rod": 0.489})
    >>> fit = tp.calibrate(robot, true.extended_positions(workspace_grid(robot)))
    >>> fit.parameters["chain1.rod"].verdict
    'identified'
    >>> dowel = [0.0, 0.0, -0.4, 0.0]  # where the robot stands at a dowel
    >>> fit = tp.calibrate(fit.robot, known_pose=(true.extended_positions(dowel), dowel))
    >>> print(abs(fit.robot.estimate(true.extended_positions(dowel)).x - dowel).max() < 1e-5)
    True
    """
    require_robot(robot)
    require(options, CalibrationOptions, "options", 'CalibrationOptions(loss="squares")')
    if isinstance(readings, str | Path):
        raise InputError(f"readings: pass truepose.logs.read(robot, {str(readings)!r})")
    table, notes, refused = logs.is_table(readings), list[str](), list[str]()
    log = log_checks.log_of(robot, readings, known_pose is not None, options.euler)
    known: KnownPose | Log | None = known_pose
    if logs.is_table(known_pose):
        known = logs.of(robot, known_pose, "known_pose", options.euler)
    forms = [each.form for each in (log, known) if isinstance(each, Log)]
    logs.orientation.require_used(options.euler, *forms)
    if table:
        differences = differences or Between().of(robot, log, whole=True)
        log, findings = log_checks.check(robot, log, measurements(differences))
        notes = [finding.text for finding in findings if not finding.refused]
        refused = [finding.text for finding in findings if finding.refused]
    given: dict[str, Any] = {"measured": measured, "measured_sigma": measured_sigma, "loads": loads}
    log = replace(log, **{name: value for name, value in given.items() if value is not None})
    if measured is not None:
        log = replace(log, implied=None, euler=None, form="")
    case = Case(robot, log, options, known, differences, influences)
    fit, of = explained(case, refused)
    fit, log = as_read(fit, of)
    notes += review(fit, log) if table else left_out(fit, log)
    return replace(fit, notes=(*notes, *fit.notes))


def explained(
    case: Case, refused: Sequence[str] = (), progress: Callable[[float], None] = lambda _: None
) -> tuple[Calibration, Hypothesis]:
    """Calibrate by a checked log, after a search for what is wrong with it.

    `refused` are a check's reasons against a fit; poses outside the workspace are a note where
    readings, tolerances and noise agree. The hypothesis is that under which the robot is
    calibrated; :func:`as_read` returns the machine as it reads. Raises InputError for a decisive
    cause that is not applied, for undecided ones, and for `refused` without a cause.
    """
    log, cause, none = case.log, case.options.cause, case.nothing()
    leaning_of(case.robot, log, case.options.lean)  # a wrong lean or pattern is not searched for
    patterns(case.robot, case.influences, len(log.readings))
    if cause == "ignore" or not len(log.readings):
        if refused:
            raise InputError(f"readings: {'; '.join(refused)}")
        return fit_to(case), none
    squares = case.options.loss == "squares"
    robust = None if squares or refused else none.fit()
    all_agree = robust is not None and not doubted(robust)  # then it is that of squares
    if robust is not None and not all_agree and agrees(robust):
        return robust, none
    base = robust if all_agree else None
    causes, found, base = search(case, base=base, always=bool(refused), progress=progress)
    gross = any(of.kind == "gross errors" for of in causes.found[: causes.near])
    if gross and not squares:
        causes = replace(causes, verdict="none")  # the loss is for these
    if causes.verdict == "decisive" and cause == "apply":
        of, fit = found[0].of, found[0].fit
        undone = f"undone: {causes.text}: {state(of, log)}"
        fit = of.fit(options=of.by(case.options.loss).options) or fit
        return replace(fit, causes=causes, notes=(undone, *fit.notes)), of
    if causes.verdict in ("decisive", "undecided"):
        undo = "; cause='apply' undoes it" * (causes.verdict == "decisive")
        raise InputError(f"readings: {causes.text}{undo}")
    agree = base is not None and equations(base) > 0 and consistent(base, REJECTED)
    if refused and not (agree and all(log_checks.OUTSIDE in text for text in refused)):
        raise InputError(f"readings: {'; '.join(refused)}")
    fit, of = unexplained(case, Search(causes, found, base), squares or all_agree)
    if why := unsound(fit, of.kind == "tolerances"):
        said = causes.text or "the readings do not fit the robot"
        raise InputError(
            f"readings: {said}: {why}: check units, measured_sigma, level, tolerances and noise of "
            "the robot file; cause='ignore' calibrates nevertheless"
        )
    return replace(fit, causes=causes, notes=(*refused, *fit.notes)), of


def unexplained(case: Case, searched: Search, direct: bool) -> tuple[Calibration, Hypothesis]:
    """Calibrate where no mistake is undone, σ as large as the misfit; `direct`: by squares."""
    causes, found, base = searched
    wide = tolerant(causes, found)
    of, near = (case.nothing(), base) if wide is None else (wide.of, wide.fit)
    try:
        fit = near if direct and near is not None else fit_to(of.by(case.options.loss))
    except PoseError as error:
        if said := of_no_length(case.robot, case.log):
            raise PoseError(f"{said} ({str(error).removesuffix(UNITS)})") from None
        raise PoseError(f"{error}; {furthest(case.robot, case.log)}") from None
    if causes.verdict == "unexplained" and misfit(fit) > NOTABLE:
        return inflated(fit, causes.text), of
    if wide is not None:
        before = () if base is None else base.notes  # as of a contradicting known pose
        said = f"{causes.text}: calibrated with these"
        fit = replace(fit, notes=tuple(dict.fromkeys([*before, *fit.notes, said])))
    return fit, of


def unsound(fit: Calibration, wider: bool) -> str:
    """Return why a fit is worse than none, else ""; `wider`: its tolerances are not the file's."""
    rows = (fit.status == "ok") & (fit.redundancy > 0)
    apart = fit.disagreement(rows) if rows.any() else 0.0
    if apart > APART:
        return f"the readings disagree by {apart:.0f} times their noise, at most {APART:g}"
    x = fit.x[finite_rows(fit.x)]
    if wider or not len(x) or apart < HEALTHY:
        return ""
    worse = []
    for pose in (None, fit.robot.home):
        before, after = (
            accuracy(robot, x, reference_pose=pose, level=fit.level, errors="nan").rms
            for robot in (fit.prior.expected(), fit.robot)
        )
        worse.append(after > before)
    return "the robot would be known less well than before" if all(worse) else ""


def state(of: Hypothesis, log: Log) -> str:
    """Say which machine a calibrated robot is once the mistakes of a log are undone."""
    said = []
    for each, before in zip(of.each, [log, *(each.given.log for each in of.each)], strict=False):
        if each.given.log is not before and each.lasts is None:
            said.append("a mistake of the log alone: the robot takes readings as its file says")
        elif each.influence and each.lasts is None and not each.leans:
            said.append("not part of the robot, which is the machine without it")
        else:
            said.append("the robot is the machine as it reads in the log's last row")
    return "; ".join(dict.fromkeys(said))


def tolerant(causes: Causes, found: Sequence[Explained]) -> Explained | None:
    """Return the likeliest larger tolerances or noise that may explain a log without a cause."""
    near = found[: causes.near] if causes.verdict == "unexplained" else ()
    return next((each for each in near if vague(each)), None)


def agrees(fit: Calibration) -> bool:
    """Return whether a robust fit leaves nothing to explain but a few outliers."""
    few = len(fit.outliers) <= OUTLIERS * len(fit.status)
    known = suspicion(fit) < DECISIVE and not fit.departure.rejected
    return few and known and lost(fit) == 0 and misfit(fit) < NOTABLE


def doubted(fit: Calibration) -> bool:
    """Return whether a fit leaves out rows or measured differences as gross errors."""
    between = fit.differences.each if fit.differences else ()
    return bool(len(fit.outliers)) or any(of.weight < 0.1 for of in between)


def of_no_length(robot: Robot, log: Log) -> str:
    """Name the rows in which a cable or leg that is read may have no length, within 3 σ."""
    kinds = [*robot.spec.actuators, *(sensor.kind for sensor in robot.spec.used)]
    said = []
    for k, offset in enumerate(reading_offsets(robot)):
        short = np.abs(log.readings[:, k]) <= 3 * robot.parameters[offset].sigma
        if kinds[k] in ("telescopic", "distance") and short.any():
            said.append(f"{robot.readings[k]} in {log.at(np.flatnonzero(short))}")
    why = "may be a cable or leg of no length, which has no direction"
    return f"{', '.join(said)}: {why}: stop 0.1 m before the anchor" if said else ""


def furthest(robot: Robot, log: Log) -> str:
    """Name the sensor and the rows that are furthest from their prediction by the motors."""
    seen = expect(robot.expected(), log.readings, loads=log.loads)
    square = np.nan_to_num((seen.residual / seen.sigma) ** 2)
    off = np.where(finite_rows(seen.x), square.sum(axis=1), np.inf)
    name = f"{robot.sensors[square.sum(axis=0).argmax()]}, " if robot.r else ""
    return f"furthest from the motors' prediction: {name}{log.at(np.argsort(-off)[:8])}"


def left_out(fit: Calibration, log: Log) -> list[str]:
    """List rows with motor readings that the calibrated robot cannot reach, by reason."""
    read = finite_rows(log.readings[:, : fit.robot.m])
    if not read.size:  # known poses alone
        return []
    reasons = dict.fromkeys(fit.status[read & (fit.status != "ok")].tolist())
    return [
        f"{log.at(np.flatnonzero(read & (fit.status == reason)))}: left out: {reason} with the "
        "calibrated geometry"
        for reason in reasons
    ]


def review(fit: Calibration, log: Log) -> list[str]:
    """Describe rows left out, outliers and doubtful parameters: one line of text each."""
    findings = left_out(fit, log)
    if len(outliers := fit.outliers):
        by_size = outliers[np.argsort(-fit.chi2[outliers])]
        many = "s" * (len(outliers) > 1)
        findings.append(f"{log.at(by_size)}: {len(outliers)} outlier{many}, worst first")
    counted = (fit.weights >= 0.1) & (fit.redundancy > 0)
    if counted.any() and (apart := fit.disagreement(counted)) > 2:
        findings.append(
            f"the readings disagree by {apart:.1f} times their noise (median) for any "
            "geometry: check the file's level, tolerances and sensor noise"
        )
    steps = {name: abs(p.value - p.prior) / p.prior_sigma for name, p in fit.parameters.items()}
    if far := [f"{name} by {step:.1f} σ" for name, step in steps.items() if step > 4]:
        findings.append(f"further from nominal than tolerances allow: {', '.join(far[:5])}")
    if all(p.verdict == "not identified" for p in fit.parameters.values()):
        findings.append("no parameter is known noticeably better than before")
    return findings
