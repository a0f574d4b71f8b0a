"""Home pose, working mode and workspace of an imported ankle, wrist or neck."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, TrueposeError
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace_grid
from truepose.robotfile import validate
from truepose.robotfile.schema import RobotFile, Workspace

_GRID = 21  # poses along each coordinate of a workspace that are checked


def standing(
    data: dict, drawn: list[float], motors: Array, source: str, body: str
) -> tuple[Robot, list[str]]:
    """Return a rotational robot with home and working modes, and notes on them.

    Home is the model's pose `drawn` if reachable within all limits, else zero or mid-range. The
    working modes are the nearest to the motors' positions in the model, `motors`, (n,). InputError,
    with `source` and `body`: none of the three is reachable.
    """
    middle = [float(np.mean(axis.get("limits", (0, 0)))) for axis in data["passive_axis"]]
    why = ""
    for where, home in (("", drawn), ("zero", [0.0] * len(drawn)), ("mid-range", middle)):
        spec = validate({**data, "home": home}, source)
        moved = f"home is {where}, not the model's pose: {why}"
        try:
            return _at(spec, motors), [moved] if where else []
        except TrueposeError as error:
            why = why or str(error).removeprefix(f"{spec.name}: ")
    raise InputError(f"{source}: {body}: no home at the model's pose, zero or mid-range: {why}")


def _at(spec: RobotFile, motors: Array) -> Robot:
    """Return the robot with the reachable working modes nearest to the motors."""

    def built(modes: Iterable[int], **more: Any) -> Robot:
        chains = [
            chain.model_copy(update={"working_mode": mode, **more})
            for chain, mode in zip(spec.chain, modes, strict=True)
        ]
        return Robot(spec.model_copy(update={"chain": tuple(chains)}))

    # Limits may exclude one branch.
    found = [built([mode] * len(motors), limits=None) for mode in (-1, 1)]
    off = np.array([robot.ikm(spec.home, level="ideal") - motors for robot in found])
    turning = [chain.actuator == "revolute" for chain in spec.chain]
    far = np.where(turning, 1 - np.cos(off), np.abs(off))
    return built((2 * np.argmin(far, axis=0) - 1).tolist())


def with_workspace(robot: Robot) -> tuple[RobotFile, list[str]]:
    """Return a rotational robot's file with a workspace, and notes on it.

    The workspace is the axes' ranges (a full turn without limits), or the largest share of them
    about home that is reachable and regular at all poses of a grid.
    """
    ranges = np.array([axis.limits or (-np.pi, np.pi) for axis in robot.spec.passive_axis]).T
    for percent in range(100, 0, -5):
        share = percent / 100
        low, high = (share * ranges + (1 - share) * robot.home).tolist()
        box = Workspace(minimum=low, maximum=high)
        found = Robot(robot.spec.model_copy(update={"workspace": box}))
        q = found.ikm(workspace_grid(found, _GRID), errors="nan", own_mode=True)
        if np.isfinite(q).all():
            part = f"[workspace] is {percent} % of the axes' ranges about home"
            why = "beyond it, not every pose is reachable and regular"
            return found.spec, [f"{part}: {why}"] if percent < 100 else []
    none = "no [workspace]: almost no poses about home are reachable; give its minimum, maximum"
    return robot.spec, [none]
