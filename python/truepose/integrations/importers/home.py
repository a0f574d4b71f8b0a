"""Home pose, working mode and workspace of an imported ankle, wrist or neck."""

from __future__ import annotations

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, TrueposeError
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace_grid
from truepose.robotfile import RobotFile, validate
from truepose.robotfile.schema import Workspace

_GRID = 21  # poses along each coordinate at which a workspace is looked at
_SHARES = 20  # of the axes' ranges, that are tried


def standing(
    data: dict, drawn: list[float], motors: Array, source: str, body: str
) -> tuple[Robot, list[str]]:
    """Return the robot of a pivot's file that lacks home and working modes, and what to say of it.

    Home is where its axes are drawn if it can stand there, motors within their limits too; else
    zero, else mid-range, which is said, and why.

    Parameters
    ----------
    data : dict
    drawn : list of float
        Its axes.
    motors : ndarray, shape (n,)
        As drawn; branches are those nearest to them.
    source, body : str
        Of the model, for messages.

    Raises
    ------
    InputError
        It stands in none of the three.
    """
    middle = [float(np.mean(axis.get("limits", (0, 0)))) for axis in data["passive_axis"]]
    why = ""
    for where, home in (("", drawn), ("zero", [0.0] * len(drawn)), ("mid-range", middle)):
        try:
            robot = _at({**data, "home": home}, motors, source)
        except _HomeError as error:
            why = why or str(error)
        else:
            return robot, [f"home is {where}, not as drawn: {why}"] if where else []
    raise InputError(f"{source}: {body}: stands neither as drawn nor at zero nor mid-range: {why}")


class _HomeError(Exception):
    """It does not stand at home."""


def _at(data: dict, motors: Array, source: str) -> Robot:
    """Return the robot, loaded as from its file."""
    found = []
    for mode in (-1, 1):  # limits may bar the other branch
        chains = [{**chain, "working_mode": mode, "limits": None} for chain in data["chain"]]
        robot = _loaded({**data, "chain": chains}, source)
        found.append(robot.ikm(data["home"], level="ideal"))
    off = np.abs(np.array(found) - motors)
    turning = [chain["actuator"] == "revolute" for chain in data["chain"]]
    off[:, turning] = np.abs((off[:, turning] + np.pi) % (2 * np.pi) - np.pi)
    modes = [(-1, 1)[k] for k in np.argmin(off, axis=0)]
    chains = [
        {**chain, "working_mode": mode} for chain, mode in zip(data["chain"], modes, strict=True)
    ]
    return _loaded({**data, "chain": chains}, source)


def _loaded(data: dict, source: str) -> Robot:
    spec = validate(data, source)
    try:
        return Robot(spec)
    except TrueposeError as error:
        raise _HomeError(str(error).removeprefix(f"{spec.name}: ")) from None


def with_workspace(robot: Robot) -> tuple[RobotFile, list[str]]:
    """Return a pivot's file with a workspace, and what to say of it.

    It is the axes' ranges, a full turn where there is none, or as much of them about home as is
    reached everywhere, on a grid, with no singularity between.
    """
    ranges = np.array([axis.limits or (-np.pi, np.pi) for axis in robot.spec.passive_axis]).T
    for share in range(_SHARES, 0, -1):
        ends = ranges if share == _SHARES else robot.home + share / _SHARES * (ranges - robot.home)
        low, high = (tuple(map(float, end)) for end in ends)
        box = Workspace(minimum=low, maximum=high)
        found = Robot(robot.spec.model_copy(update={"workspace": box}))
        q = found.ikm(workspace_grid(found, _GRID), errors="nan", own_mode=True)
        if np.isfinite(q).all():
            part = f"[workspace] is {100 * share // _SHARES} % of the axes' ranges about home"
            why = "beyond, not all is reached and regular"
            return found.spec, [] if share == _SHARES else [f"{part}: {why}"]
    none = "no [workspace]: little is reached about home; give its minimum, maximum"
    return robot.spec, [none]
