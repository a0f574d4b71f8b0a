"""`truepose plan`: calibration poses, in the order of a short tour."""

from pathlib import Path

import numpy as np
from typer import Option

from truepose import logs
from truepose.calibration.between import Between
from truepose.calibration.calibrate import calibrate
from truepose.calibration.fit import Calibration
from truepose.commands import options
from truepose.commands.where import ConditionsOption, Where, under
from truepose.design.candidates import COUNT, CandidatePoses
from truepose.design.pose_plan import PosePlan
from truepose.design.poses import HARDLY, SAMPLED, plan_poses
from truepose.exceptions import InputError
from truepose.logs.reading import read_poses
from truepose.robot import Robot, summed
from truepose.show import as_csv, measured, number, printed
from truepose.show.terminal import progress


def command(
    robot: options.RobotName,
    count: int | None = Option(
        None, min=1, metavar="N", help="Number of poses to choose.", show_default="30"
    ),
    target: str | None = Option(
        None, metavar="0.1mm", help="Choose as many as reach this σ of the position."
    ),
    candidates: str = Option(
        str(COUNT),
        metavar="N|CSV",
        help="Candidates: N poses of the workspace, then refined, or those of a CSV file.",
    ),
    after: Path | None = Option(
        None, metavar="LOG", help="Log of earlier readings, to which the plan adds poses."
    ),
    outside: str | None = Option(
        None,
        metavar="0.02mm,0.01deg",
        help="σ of a tracker, in a frame of its own, that measures each pose.",
    ),
    where: Where = Where(),
    seen: bool = Option(
        False, "--seen", help="With --outside: accuracy of the pose in the tracker's frame."
    ),
    relative_to: str | None = Option(
        None, metavar="X,Y,…", help="Accuracy relative to this pose; m and rad."
    ),
    sensors: options.SensorsOption = None,
    conditions: ConditionsOption = None,
    level: options.ModelLevel = None,
    out: Path | None = Option(None, "-o", "--out", help="Poses to write, in tour order (CSV)."),
    plot: Path | None = options.plot_option("predictions and the tour"),
    seed: options.Seed = 0,
    output: options.Output = options.Output(),
) -> None:
    """Plan calibration poses by their marginal gain in accuracy.

    Prints the predicted position error after each pose, and compares with random poses.

    Example: **truepose plan h4 --count 20 --sensors theta,z_telemeter**, then
    **truepose plan h4 --target 1.6mm**
    """
    if seen and outside is None:
        raise InputError("--seen: needs --outside, the σ of the tracker")
    given = options.count_or_file(candidates, "--candidates", SAMPLED)
    output.check([robot, after, where.poses, candidates], plan=out, plot=plot)
    loaded = under(options.load_with(robot, sensors), conditions)
    length, angle = options.parse_sigmas(loaded, outside, "--outside")
    x = given if isinstance(given, int) else read_poses(loaded, given)
    with progress("poses"):
        found = plan_poses(
            loaded,
            count,
            candidates=CandidatePoses(poses=x, measured_sigma=length, measured_angle_sigma=angle),
            after=None if after is None else fit_of(loaded, after),
            target=options.parse_target(loaded, target),
            use=where.use(loaded),
            relative_to=options.parse_pose(loaded, relative_to, "--relative-to"),
            level=level,
            seen=seen,
            seed=seed,
        )
    said = notes(found)
    if found.steps or out is None:
        output.write(plan=lambda: written(found), plot=found.plot)
    else:
        output.write(plot=found.plot)
        said.append(f"{out}: not written: the plan has no poses")
    output.show([found.table()], said)


def fit_of(robot: Robot, path: Path) -> Calibration:
    """Calibrate on a log as `truepose calibrate` does; with contacts, without distances."""
    log = logs.read(robot, path)
    try:
        return calibrate(robot, log, differences=Between().of(robot, log))
    except InputError as error:
        raise InputError(f"{path}: {options.of_log(error)}") from None


def notes(found: PosePlan) -> list[str]:
    """Return notes: accuracy of the plan, of random poses and of all candidates."""
    total, count, name = summed(found.robot), len(found.steps), found.robot.name
    wanted = printed(found.target or 0.0, total.unit, ".4g")
    if not count:
        sigma = measured(found.sigma[0, -1], total.unit)
        return [f"{name}: no more poses needed: {sigma}, the target {wanted} is reached."]
    gone = f", {found.left_out} unreachable ones left out" if found.left_out else ""
    low, median, high = np.quantile(found.random, [0, 0.5, 1])
    spread = f"{number(total.factor * low)} to {number(total.factor * high)}"
    sigma = found.sigma[-1, -1]
    lines = [
        f"{name}: {count} of {found.candidates} poses{gone}: "
        f"{measured(sigma, total.unit)}; σ over {len(found.over)} poses.",
        f"Random {count} of them: {measured(median, total.unit)} ({spread}); "
        f"all {found.candidates}: {measured(found.everything, total.unit)}.",
    ]
    if not np.isnan(found.gap):
        lines.append(f"No other {count} are better by more than {found.gap:.1%}.")
    more, longer = found.longer
    if more:
        lines.append(f"{more} poses more: {measured(longer, total.unit)}.")
    if found.gain > HARDLY:
        matters = (longer if more else found.everything) < HARDLY * sigma
        of_number = "; their number does" if matters else ", nor does their number"
        lines.append(f"The choice of poses hardly matters here{of_number}.")
    if found.target is not None:
        reached = f"reached with {found.needed}" if found.needed else f"not reached with {count}"
        lines.append(f"Target {wanted}: {reached}.")
    return lines


def written(found: PosePlan) -> str:
    """Return CSV of the poses in tour order, each with its step: step 1 has the largest gain."""
    names = [name for name, _ in found.robot.coordinates]
    steps = zip(found.poses.tolist(), found.order, strict=True)
    return as_csv(dict(zip(names, x, strict=True)) | {"step": k + 1} for x, k in steps)
