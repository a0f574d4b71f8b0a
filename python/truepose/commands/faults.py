"""`truepose faults`: detectability of sensor faults, or the faulty reading of a log."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from typer import Argument, Context, Option

from truepose import logs
from truepose.arguments import Array
from truepose.commands import options
from truepose.commands.where import ConditionsOption, under
from truepose.faults.isolation import Isolation, isolate
from truepose.faults.limits import FALSE_ALARM, HOURS, TIMES, Detectability, detectability
from truepose.faults.undetected import undetected_motors, worst_of
from truepose.logs.reading import read_poses
from truepose.robot import Robot, label
from truepose.robot.workspace import regular_grid
from truepose.show import PRINT, Cell, Table, measured

#: Effects in the readings of a correct model that `Effects.allowed_for` supports.
KNOWN_EFFECTS = ("backlash", "eccentricity")
#: Options of the prediction alone.
_PREDICTED = ("--poses", "--calibrated", "--plot", "--effects")


def command(
    context: Context,
    robot: options.RobotName,
    log: Path | None = Argument(
        None,
        help="Isolate the faulty reading of this log: CSV, Parquet or MCAP; columns q1 … qn "
        "and each sensor's name; SI.",
        show_default=False,
    ),
    sensors: options.SensorsOption = None,
    columns: options.Columns = None,
    poses: options.Poses = None,
    calibrated: bool = Option(
        False, "--calibrated", help="After self-calibration over these poses."
    ),
    effects: str = options.effects_option(
        "none",
        "Further effects in the readings: all, none, backlash, eccentricity.",
        KNOWN_EFFECTS,
    ),
    conditions: ConditionsOption = None,
    level: options.ModelLevel = None,
    false_alarm: float | None = Option(
        None,
        metavar="P",
        help="Probability of a false alarm in each test (one a cycle).",
        show_default=f"one in {HOURS:g} hours at 1 kHz",
    ),
    plot: Path | None = options.plot_option("the limits of each reading"),
    output: options.Output = options.Output(),
) -> None:
    """Predict which sensor faults are detectable; with a LOG, isolate the faulty reading.

    Without LOG: the smallest detectable and isolable fault of each reading, the pose error of a
    fault just below detection under each law, and readings that no test can distinguish.

    With LOG: the size of a fault of each reading in all rows, and the χ² that remains. Move the
    robot slowly through its workspace, and use the file of its last calibration.

    Example: **truepose faults h4 --sensors theta,z_telemeter --calibrated --effects all**, then
    **truepose faults calibrated.toml tour.csv**
    """
    loaded = under(options.load_with(robot, sensors), conditions)
    given = options.given(context)
    if log is not None:
        said = f"only for a prediction: leave out, or leave {log} out"
        options.refuse(given, _PREDICTED, said)
        readings = logs.read(loaded, log, columns).readings
        isolated = isolate(loaded, readings, level, false_alarm=false_alarm)
        output.show([isolated.table()], verdict(isolated))
        return
    options.refuse(given, ["--columns"], "only with a LOG: leave out")
    if not loaded.r:
        said = "only with a redundant sensor in use: choose one (--sensors), or leave out"
        options.refuse(given, ["--calibrated", "--plot"], said)
    output.check([robot, poses], plot=plot)
    allowed = options.effects_of(effects, KNOWN_EFFECTS)
    subject = allowed.allowed_for(loaded)
    at, left_out = (read_poses(loaded, poses), 0) if poses else regular_grid(loaded)
    visited = at if calibrated else None
    found = detectability(subject, at, visited, level, false_alarm=false_alarm)
    if effects != "none":
        found = replace(found, state=f"{found.state}, effects {effects}")
    # A fault's change of the motors' torques needs dynamics.
    undetected = [undetected_motors(found, at)] if loaded.spec.chain else []
    if not loaded.r:
        tables = [found.table()] if output.data else []
        output.show([*tables, *undetected], [without_sensors(loaded)])
        return
    output.write(plot=found.plot)
    where = f"{options.over(at, poses, left_out)}; {found.state}."
    answer = f"{loaded.name}, {label(loaded, loaded.sensors)}: {where}"
    answers = [answer, *map(worst_of, undetected)]
    output.show([found.table(), *undetected, *harm(found)], answers, list(notes(found)))


def without_sensors(robot: Robot) -> str:
    """Return the message for a robot without redundant sensors."""
    spare = ", ".join(sensor.name for sensor in robot.spec.sensor)
    return (
        f"{robot.name}: no redundant sensor in use: readings cannot be compared; only their range, "
        "speed and freezing can be monitored. Any other fault causes an undetected pose error. "
        f"Sensors of its file (--sensors): {spare or 'none'}."
    )


def harm(found: Detectability) -> list[Table]:
    """Return tables of the pose error of a fault just below detection: one column per law."""
    robot, laws = found.robot, list(found.cross_sensitivity)
    shape = (-1, len(robot.readings), 2)
    worst = [found.pose_error(law).reshape(shape).max(axis=0) for law in laws]
    moving = [found.moving_pose_error(law) for law in laws]
    result = []
    for name, title, errors in (
        ("harm_at_rest", "Pose error of a fault just below detection, worst pose", worst),
        ("harm_moving", f"The same for a fault that {found.moving} poses do not reveal", moving),
    ):
        columns = [
            [_offset(robot, law, e) for e in error] for law, error in zip(laws, errors, strict=True)
        ]
        rows = list(zip(robot.readings, *columns, strict=True))
        result.append(Table(name, title, ["reading", *laws], rows))
    return result


def notes(found: Detectability) -> Iterator[str]:
    """Yield notes: meaning of the tables, and readings that no test can distinguish."""
    odds = f"{found.false_alarm:.2g}"
    if found.false_alarm == FALSE_ALARM:
        odds = f"one in {HOURS:g} hours at 1 kHz, {odds}"
    yield (
        f"Detection probability {found.power:g}, false alarms {odds} per test: a bias or a jump in "
        "one cycle, a drift grown to this size; over poses read once each, a constant bias."
    )
    yield (
        "Undetected motor encoders: off by just less than is detected, at most 3° or 10 mm "
        "(assumed), with the motors at rest on their setpoints. Readings that repeat their "
        "setpoints without the robot contradict nothing: no test of readings detects them."
    )
    yield (
        f"Confused with: readings whose faults explain a fault of {TIMES:g} times the limit as "
        "well, at most of the poses where it is detected."
    )
    every = f"over all {found.detected[..., 0].size} poses"
    for where, groups in (("at any one pose", found.alike_at_rest), (every, found.alike)):
        told = "; ".join(" = ".join(group) for group in groups) or "none"
        yield f"Indistinguishable {where} (parallel signatures): {told}."
    if found.unseen:
        yield f"Undetectable by any test at any pose: {', '.join(found.unseen)}."


def _offset(robot: Robot, law: str, error: Array) -> Cell:
    """Return position and rotation in one cell, mm and degrees; "unbounded" without a bound."""
    units = {unit for _, unit in robot.coordinates}
    parts = {unit: float(e) for unit, e in zip(("m", "rad"), error, strict=True) if unit in units}
    data = {f"{law} ({PRINT[unit][1]})": PRINT[unit][0] * e for unit, e in parts.items()}
    bounded = np.isfinite(error).all()
    text = ", ".join(measured(e, unit) for unit, e in parts.items()) if bounded else "unbounded"
    return Cell(text, data)


def verdict(found: Isolation) -> list[str]:
    """Return notes: the faulty reading, or why it is not isolated."""
    gone = f" ({found.left_out} without a pose excluded)" if found.left_out else ""
    test = (
        f"{found.lines} rows{gone}, {found.level} level: χ² of the residuals "
        f"{found.chi2:.4g}, {found.freedom} degrees of freedom; a healthy robot exceeds "
        f"{found.limit:.4g} with probability {found.false_alarm:.2g}."
    )
    if not found.faulty:
        return [test, "No fault detected: the readings are consistent."]
    kinds, readings = [hypothesis.kind for hypothesis in found.may_be], found.readings
    if not kinds:
        said = (
            "No single bias or gain explains it: a fault that began within the log, several "
            "faults, a change of the geometry, or another robot's file."
        )
    elif len(readings) > 1:
        said = (
            f"One of these is faulty: {', '.join(readings)}. More poses or another sensor "
            "distinguish them (see truepose faults)."
        )
    else:
        why = f"its {kinds[0]} is wrong" if len(kinds) == 1 else "a " + " or a ".join(kinds)
        said = f"Faulty: {readings[0]}: {why}."
    return [test, said]
