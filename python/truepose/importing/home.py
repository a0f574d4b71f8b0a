"""Where does an imported pivot stand? Home, and the branch that each motor is on there."""

from __future__ import annotations

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, TrueposeError
from truepose.robot.robot import Robot
from truepose.robotfile import validate


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
    middle = [float(np.mean(axis.get("limits", (0, 0)))) for axis in data["axis"]]
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
