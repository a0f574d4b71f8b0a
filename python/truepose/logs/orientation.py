"""Measured orientations of a spatial platform: Euler angles or quaternions as rotation vectors."""

import itertools
from collections.abc import Iterable

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.exceptions import InputError, choose
from truepose.robot.description import Description

VECTOR = ("measured_rx", "measured_ry", "measured_rz")
EULER = ("measured_roll", "measured_pitch", "measured_yaw")
QUATERNION = ("measured_qx", "measured_qy", "measured_qz", "measured_qw")
#: Orders of the turns about the axes: upper case about the turned ones, lower case fixed ones.
ORDERS = tuple("".join(order) for order in itertools.permutations("XYZ"))
CONVENTIONS = (*ORDERS, *(order.lower() for order in ORDERS))
USUAL = "ZYX"
#: Largest deviation of a quaternion's length from 1.
UNIT = 0.01


def units(robot: Description) -> dict[str, str]:
    """Return the unit of every column of Euler angles and quaternions that a log may have."""
    if robot.spec.mobility != "spatial":
        return {}
    return {**dict.fromkeys(EULER, "rad"), **dict.fromkeys(QUATERNION, "")}


def columns(robot: Description, names: Iterable[str], where: str) -> tuple[str, ...]:
    """Return the columns of a log's Euler angles or quaternions; none where it has neither."""
    if robot.spec.mobility != "spatial":
        return ()
    names = set(names)
    given = [[name for name in kind if name in names] for kind in (VECTOR, EULER, QUATERNION)]
    if len(found := [kind for kind in given if kind]) > 1:
        raise InputError(
            f"{where}: columns {found[0][0]} and {found[1][0]}: two forms of one orientation; "
            "leave one out"
        )
    for kind, own in zip((EULER, QUATERNION), given[1:], strict=True):
        if own:
            if missing := [name for name in kind if name not in own]:
                raise InputError(f"{where}: no column {missing[0]}; {own[0]} needs it")
            return kind
    return ()


def require(euler: str | None) -> str:
    """Return the convention of a log's Euler angles, by default `USUAL`."""
    if euler is not None and euler not in CONVENTIONS:
        raise InputError(choose("euler", euler, CONVENTIONS))
    return euler or USUAL


def require_used(euler: str | None, *forms: str) -> None:
    """Raise InputError where a convention is given and no log has Euler angles."""
    if euler is not None and require(euler) not in forms:
        raise InputError(f"euler = {euler}: no column measured_roll, measured_pitch, measured_yaw")


def of_euler(angles: Array, order: str) -> Array:
    """Return rotation vectors, (N, 3), of angles about x, y and z (roll, pitch, yaw), (N, 3).

    `order` "ZYX" is R = R_z(yaw) R_y(pitch) R_x(roll), as is "xyz".
    """
    from scipy.spatial.transform import Rotation  # takes its time to import

    columns = angles[:, ["XYZ".index(axis) for axis in order.upper()]]
    return np.asarray(Rotation.from_euler(order, columns).as_rotvec())


def vectors(values: Array, names: tuple[str, ...], order: str, lines: Array, at: str) -> Array:
    """Return rotation vectors, (N, 3), of the columns `names`; NaN in rows without any.

    Refuses incomplete rows and quaternions that are not unit; `at` is for messages.
    """
    read = finite_rows(values)
    shown = ", ".join(names)
    if (rows := np.flatnonzero(np.isfinite(values).any(axis=1) & ~read)).size:
        raise InputError(f"{at} {lines[rows[0]]}: {shown}: all of them or none")
    result = np.full((len(values), 3), np.nan)
    if names == EULER:
        result[read] = of_euler(values[read], order)
        return result
    size = np.linalg.norm(values, axis=1)
    if (rows := np.flatnonzero(read & ~(np.abs(size - 1) < UNIT))).size:
        raise InputError(
            f"{at} {lines[rows[0]]}: {shown}: a quaternion of length {size[rows[0]]:.4g}, must be 1"
        )
    from scipy.spatial.transform import Rotation

    result[read] = Rotation.from_quat(values[read]).as_rotvec()
    return result
