"""Home pose, working mode and workspace of an imported robot."""

from typing import Any

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.exceptions import InputError, TrueposeError
from truepose.robot import Robot, explain, workspace_grid
from truepose.robot.frames import frames
from truepose.robot.workspace import condition_numbers
from truepose.robotfile import validate
from truepose.robotfile.schema import RobotFile, Workspace

# Poses along each coordinate of a workspace that are checked; of six coordinates.
_GRID, _COARSE = 21, 5
_SINGULAR = 1e4  # condition number of J; models are rounded to about as many digits


def standing(
    data: dict, homes: dict[str, Array], motors: Array, what: str
) -> tuple[Robot, list[str]]:
    """Return a robot with home and working modes, and notes on them.

    Home is the first of the named poses `homes` that is reachable within all limits and regular.
    The working modes are the nearest to the motors' positions in the model, `motors`, (m,).
    InputError, of `what`: no pose is reachable and regular.
    """
    why = ""
    for where, home in homes.items():
        spec = validate({**data, "home": home.tolist()}, what)
        try:
            robot = _at(spec, motors)
            return robot, [f"home is {where}, not {next(iter(homes))}: {why}"] if why else []
        except TrueposeError as error:
            why = why or str(error).removeprefix(f"{spec.name}: ")
    raise InputError(f"{what}: no home at {', '.join(homes)}: {why}")


def _at(spec: RobotFile, motors: Array) -> Robot:
    """Return the robot with the reachable working modes nearest to the motors."""

    def built(modes: list[int], **more: Any) -> Robot:
        chains = [
            chain.model_copy(update={"working_mode": mode, **more})
            for chain, mode in zip(spec.chain, modes, strict=True)
        ]
        return Robot(spec.model_copy(update={"chain": tuple(chains)}))

    # Limits may exclude one branch.
    found = [built([mode] * len(motors), limits=None) for mode in (-1, 1)]
    off = np.array([robot.ikm(spec.home, level="ideal") - motors for robot in found])
    far = np.where(
        [chain.actuator == "revolute" for chain in spec.chain], 1 - np.cos(off), np.abs(off)
    )
    robot = built((2 * np.argmin(far, axis=0) - 1).tolist())
    if condition_numbers(robot, robot.jacobian(robot.home)) > _SINGULAR:
        why = explain.at_home(robot.core, robot.spec, (_core.singular, -1), 1 / _SINGULAR)
        raise InputError(why)
    # Parts other than rod pairs may constrain the orientation (3-UPU), but are not in the file.
    if robot.loose:
        raise InputError(robot.full.reason)
    return robot


def with_workspace(robot: Robot) -> tuple[RobotFile, list[str]]:
    """Return a robot's file with a workspace, and notes on it.

    The workspace is the axes' ranges (a full turn without limits), elsewhere home ± the largest
    distance of a motor and ± 1 rad, or the largest share of them about home that is reachable and
    regular at all poses of a grid.
    """
    spec, home = robot.spec, robot.home
    ranges = np.array([axis.limits or (-np.pi, np.pi) for axis in spec.passive_axis]).T
    whole = "the axes' ranges"
    if not spec.passive_axis:
        D = frames(robot, home)[:3, 3]
        reach = max(np.linalg.norm(D - chain.base) for chain in spec.chain)
        units = np.array([unit for _, unit in robot.coordinates])
        ranges = home + np.outer((-1, 1), np.where(units == "m", reach, 1.0))
        whole = f"±{reach:.3g} m{' and ±1 rad' * ('rad' in units)}"
    for percent in range(100, 0, -5):
        low, high = (home + percent / 100 * (ranges - home)).tolist()
        found = Robot(spec.model_copy(update={"workspace": Workspace(minimum=low, maximum=high)}))
        grid = workspace_grid(found, _GRID if robot.n < 6 else _COARSE)
        if np.isfinite(found.ikm(grid, errors="nan", own_mode=True)).all():
            note = (
                f"[workspace] is {percent} % of {whole} about home: beyond it, not every pose is "
                "reachable and regular"
            )
            return found.spec, [note] if percent < 100 else []
    return spec, [
        "no [workspace]: almost no poses about home are reachable; give its minimum, maximum"
    ]
