"""`truepose error-budget`: contributions of tolerances and readings to the pose error."""

from __future__ import annotations

from pathlib import Path

from typer import Option

from truepose.commands import options
from truepose.commands.conditions import ConditionsOption, under
from truepose.commands.design import Calibrated, Confidence, parse_confidence, visited
from truepose.design.criterion import Measure
from truepose.design.error_budget import error_budget
from truepose.logs.reading import read_poses
from truepose.robot.units import label, summed
from truepose.show.terminal import Format, show
from truepose.show.units import measured


def command(
    robot: options.RobotName,
    sensors: options.SensorsOption = None,
    calibrated: Calibrated = None,
    reference_pose: options.ReferencePose = None,
    poses: Path | None = Option(
        None, help="CSV file of the poses to evaluate.", show_default="32 over the workspace"
    ),
    conditions: ConditionsOption = None,
    confidence: Confidence = "95%",
    measure: Measure = "rms",
    plot: Path | None = options.plot_option("the contributions"),
    how: options.How = Format.table,
    force: options.Force = False,
) -> None:
    """Print what each tolerance and each reading contributes to the error of an estimated pose.

    Contributions are standard deviations of the position, rms over the poses; their squares add up.
    The last column is the error with half of that tolerance or noise.

    Example: **truepose error-budget h4 --calibrated 20 --plot budget.svg**
    """
    loaded = under(options.load_with(robot, sensors), conditions)
    csv = None if calibrated is None or calibrated.isdigit() else calibrated
    write = options.writer((robot, poses, csv), force, plot=plot)
    found = error_budget(
        loaded,
        calibrated_on=None if calibrated is None else visited(loaded, calibrated),
        reference_pose=options.parse_pose(loaded, reference_pose, "--reference-pose"),
        poses=read_poses(loaded, poses) if poses else None,
        confidence=parse_confidence(confidence),
        measure=measure,
    )
    write(plot=found.plot)
    total = summed(loaded)
    error, sigma = (measured(value, total.unit) for value in (found.error, found.sigma))
    answer = (
        f"{loaded.name} with {label(loaded, loaded.sensors)}, {found.state}: "
        f"{found.criterion.said(total.name)}: {error}; σ {sigma}; {len(found.over)} poses."
    )
    show([found.table()], how, [answer], written=(plot,))
