"""Control laws: the paper's three, and the two that weight the readings."""

from typing import Literal

from truepose import _core
from truepose.exceptions import InputError
from truepose.robot.description import Description

Law = Literal["joint", "tej", "cartesian", "weighted", "estimated"]
LAWS: tuple[Law, ...] = tuple(_core.laws)


def usual(robot: Description) -> Law:
    """Return a robot's default law: tej with redundant sensors, joint without."""
    return "tej" if robot.r else "joint"


def require_sensors(robot: Description, law: str) -> None:
    """Raise InputError unless the robot uses a redundant sensor or the law needs none."""
    if robot.m + robot.r == robot.n and _core.laws[law].sensed:
        raise no_sensor(robot, f"law {law!r}")


def no_sensor(robot: Description, what: str) -> InputError:
    """Return the error for a law that needs a redundant sensor where none is in use."""
    has = ", ".join(sensor.name for sensor in robot.spec.sensor)
    where = f"its file has {has} (with_sensors, --sensors)" if has else "its file has none"
    return InputError(
        f"{robot.name}: {what} needs a redundant sensor, and none is in use: {where}; "
        "law 'joint' needs none"
    )
