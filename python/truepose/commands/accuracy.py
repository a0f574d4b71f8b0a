"""`truepose accuracy`, `error-budget`: predicted errors, and what contributes to them."""

import re
from pathlib import Path

from typer import Option

from truepose.calibration.bound import accuracy
from truepose.commands import options
from truepose.commands.where import ConditionsOption, CriterionOptions, UseOptions, under
from truepose.design.error_budget import error_budget
from truepose.design.prediction import Prediction, overview, predict
from truepose.logs.reading import read_poses
from truepose.robot import Axis, coordinate_axes, label, load, summed
from truepose.robot.maps import workspace_slice
from truepose.robot.units import Summed
from truepose.show import Cell, Table, measured, tabled


def command(
    robot: options.RobotName,
    sensors: list[str] | None = Option(
        None,
        help="A set: names or globs separated by commas, none, or all. Repeatable: one set each.",
        show_default="none, those in use, these with each other one, with each kind, all",
    ),
    poses: options.Poses = None,
    calibrated: bool = Option(
        False, "--calibrated", help="Also after self-calibration over these poses."
    ),
    reference_pose: options.ReferencePose = None,
    conditions: ConditionsOption = None,
    level: options.ModelLevel = None,
    plot: Path | None = options.plot_option("a map of the first set's position σ"),
    output: options.Output = options.Output(),
) -> None:
    """Predict which law and sensors make a robot accurate, and after how many calibration poses.

    First the position error by sensor set: of the robot as built, at rest under each law, and after
    self-calibration. Then the Cramér-Rao bound (1σ) of each coordinate. All errors are root mean
    squares over the poses; tolerances and counts are those of the robot file.

    Example: **truepose accuracy h4 --sensors theta --sensors theta,z_telemeter --calibrated**
    """
    output.check([robot, poses], plot=plot)
    loaded = under(load(robot), conditions)
    sets = [options.parse_set(loaded, text) for text in sensors] if sensors else None
    touched = options.parse_pose(loaded, reference_pose, "--reference-pose")
    given = read_poses(loaded, poses) if poses else None
    found = predict(loaded, sets, given, calibrated=calibrated, reference_pose=touched, level=level)
    options.tell_exact(loaded, (name for names in found.sets for name in names))
    shown = loaded.with_sensors(*(sets[0] if sets else loaded.sensors))
    visited = found.poses if calibrated else None
    slice_ = workspace_slice(shown) if plot else shown.home
    output.write(plot=lambda: accuracy(shown, slice_, visited, touched, level, errors="nan").plot())
    first, answers = overview(found, level)
    answers += [f"{loaded.name}: {options.over(found.poses, poses, found.left_out)}."]
    shown_tables = tables(found)[:: -1 if not output.data else 1]  # the calibrated first
    output.show([first, *shown_tables], answers, notes(found))


def notes(found: Prediction) -> list[str]:
    """Explain why a robot as built may exceed the bound: tolerances that are not centered."""
    off = [name for name, p in found.robot.parameters.items() if abs(p.mean - p.value) > 1e-12]
    if not off:
        return []
    some = ", ".join(off[:4]) + f" and {len(off) - 4} more" * (len(off) > 4)
    return [
        f"Tolerances of {found.robot.name} are not centered: as built, laws use the nominal "
        f"geometry and the bound uses the mean: {some}."
    ]


def tables(found: Prediction) -> list[Table]:
    """Return a table for each predicted state: one row per sensor set, σ in mm and degrees."""
    axes: list[Axis | Summed] = [*coordinate_axes(found.robot), summed(found.robot)]
    result = []
    for what, sigma in found.sigma.items():
        rows = [
            {"sensors": Cell(label(found.robot, names), ",".join(names) or "none")}
            | {axis.label: axis.factor * v for axis, v in zip(axes, values, strict=True)}
            for names, values in zip(found.sets, sigma.tolist(), strict=True)
        ]
        learnt = ", calibrated on the same poses" if what.startswith("self-calibrated") else ""
        title = f"1σ bound of the pose, {what}: rms over {len(found.poses)} poses{learnt}"
        result.append(tabled("accuracy_" + re.sub("[ ,-]+", "_", what), title, rows))
    return result


def error_budget_command(
    robot: options.RobotName,
    sensors: options.SensorsOption = None,
    use: UseOptions = UseOptions(),
    conditions: ConditionsOption = None,
    criterion: CriterionOptions = CriterionOptions(),
    plot: Path | None = options.plot_option("the contributions"),
    output: options.Output = options.Output(),
) -> None:
    """Print what each tolerance and each reading contributes to the error of an estimated pose.

    Contributions are standard deviations of the position, rms over the poses; their squares add up.
    The last column is the error with half of that tolerance or noise.

    Example: **truepose error-budget h4 --calibrated 20 --plot budget.svg**
    """
    loaded = under(options.load_with(robot, sensors), conditions)
    output.check([robot, use.poses, use.calibrated], plot=plot)
    found = error_budget(loaded, use.use(loaded), criterion.criterion())
    output.write(plot=found.plot)
    total = summed(loaded)
    error, sigma = (measured(value, total.unit) for value in (found.error, found.sigma))
    answer = (
        f"{loaded.name} with {label(loaded, loaded.sensors)}, {found.state}: "
        f"{found.criterion.said(total.name)}: {error}; σ {sigma}; {len(found.over)} poses."
    )
    output.show([found.table()], [answer])
