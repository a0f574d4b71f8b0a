"""A robot and its sensors: the facade over the C++ core."""

from __future__ import annotations

from pathlib import Path

from truepose import robotfile
from truepose.exceptions import RobotFileError
from truepose.robot.dynamics import Dynamics
from truepose.robot.redundancy import Redundancy


class Robot(Redundancy, Dynamics):
    """A robot and its sensors. Immutable: :meth:`replace` and :meth:`with_sensors` return copies.

    Coordinates x are those of the file's mobility (m, rad), motor positions q are what the motor
    encoders read (rad or m), redundant positions r what the sensors in use read. All methods
    take any leading shape and run in C++. Frame: base, z up.

    Parameters
    ----------
    spec : RobotFile
        A validated robot file.
    """


def robots() -> list[str]:
    """Names of the shipped robots.

    Examples
    --------
    >>> import truepose as tp
    >>> "h4" in tp.robots()
    True
    """
    return list(robotfile.shipped())


def load(robot: str | Path) -> Robot:
    """Load a shipped robot by name, or any robot from its file.

    Parameters
    ----------
    robot : str or Path
        A name of :func:`robots`, or the path of a robot file.

    Raises
    ------
    RobotFileError
        The file cannot be read or describes no robot; one line says what is wrong.

    Examples
    --------
    >>> import truepose as tp
    >>> robot = tp.load("h4")
    >>> robot.n, robot.r
    (4, 1)
    """
    spec = robotfile.read(robot)
    try:
        return Robot(spec)
    except RobotFileError as error:
        raise RobotFileError(f"{robot}: {error}") from None
