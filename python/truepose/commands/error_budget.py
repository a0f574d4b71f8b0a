"""`truepose error-budget`: contributions of tolerances and readings to the pose error."""

from __future__ import annotations

from pathlib import Path

from truepose.commands import options
from truepose.commands.conditions import ConditionsOption, under
from truepose.commands.where import CriterionOptions, UseOptions
from truepose.design.error_budget import error_budget
from truepose.robot.units import label, summed
from truepose.show.terminal import Format, show
from truepose.show.units import measured


def command(
    robot: options.RobotName,
    sensors: options.SensorsOption = None,
    use: UseOptions = UseOptions(),
    conditions: ConditionsOption = None,
    criterion: CriterionOptions = CriterionOptions(),
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
    inputs = (robot, use.poses, use.calibrated)
    write = options.writer(inputs, force, plot=plot)
    found = error_budget(loaded, use.use(loaded), criterion.criterion())
    write(plot=found.plot)
    total = summed(loaded)
    error, sigma = (measured(value, total.unit) for value in (found.error, found.sigma))
    answer = (
        f"{loaded.name} with {label(loaded, loaded.sensors)}, {found.state}: "
        f"{found.criterion.said(total.name)}: {error}; σ {sigma}; {len(found.over)} poses."
    )
    show([found.table()], how, [answer], written=(plot,))
