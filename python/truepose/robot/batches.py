"""Batches of poses: conversion for the core, and errors of rows without a result."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, column_of, columns_of, numbers_of
from truepose.exceptions import InputError, PoseError, choose
from truepose.robot import explain
from truepose.robot.description import Description

_MUCH = 10.0  # m or rad: beyond any robot's workspace


def flattened(
    robot: Description, values: ArrayLike, width: int, name: str, errors: Errors
) -> tuple[Array, tuple[int, ...]]:
    """Check the shape, select a table's columns, and flatten the leading axes: (N, width)."""
    if errors not in ("raise", "nan"):
        raise InputError(choose("errors", errors, ("raise", "nan")))
    if (columns := columns_of(values)) is not None:
        values = _by_name(robot, values, columns, width, name)
    array = numbers_of(values, name)
    if array.ndim == 0 or array.shape[-1] != width:
        raise InputError(f"{name}: shape {array.shape}, must be (..., {width}) for {robot.name}")
    if errors == "raise" and not np.isfinite(array).all():
        bad = array.reshape(-1, width)[~np.isfinite(array.reshape(-1, width)).all(axis=-1)][0]
        raise InputError(f"{name} = {_list(bad)}: must be finite numbers")
    rows = array.reshape(-1, width)
    largest = np.abs(rows).max(axis=0, initial=0) if name.startswith("x") else ()
    for most, (coordinate, unit) in zip(largest, robot.coordinates, strict=False):
        if unit == "rad" and most > 2 * np.pi:
            said = f"{name}: {coordinate} = {most:.6g} rad is more than a turn; is it in degrees?"
            warnings.warn(f"{robot.name}: {said}", stacklevel=3)
    return rows, array.shape[:-1]


def as_rows(
    robot: Description,
    values: ArrayLike,
    name: str,
    least: int = 0,
    width: int | None = None,
    errors: Errors = "raise",
) -> Array:
    """Check at least so many rows, (N, width), by default poses, (N, n)."""
    width = robot.n if width is None else width
    rows, lead = flattened(robot, values, width, name, errors)
    if len(lead) != 1 or len(rows) < least:
        more = f", N at least {least}" if least else ""
        raise InputError(f"{name}: shape {(*lead, width)}, must be (N, {width}){more}")
    return rows


def as_row(robot: Description, values: ArrayLike, name: str, width: int | None = None) -> Array:
    """Check a single vector, by default (n,), such as a pose."""
    width = robot.n if width is None else width
    rows, lead = flattened(robot, values, width, name, "raise")
    if lead:
        raise InputError(f"{name}: shape {(*lead, width)}, must be ({width},)")
    return rows[0]


def _by_name(
    robot: Description, table: Any, columns: list[Any], width: int, name: str
) -> ArrayLike:
    coordinates = tuple(coordinate for coordinate, _ in robot.coordinates)
    sets = [names for names in (coordinates, robot.readings[:width]) if len(names) == width]
    for names in sets:
        if set(names) <= set(columns):
            return np.column_stack([numbers_of(column_of(table, n), f"{name}: {n}") for n in names])
    must = " or ".join(", ".join(names) for names in sets)
    raise InputError(f"{name}: columns {', '.join(map(str, columns))}: must be {must}")


def require_answers(
    robot: Description,
    what: str,
    rows: Array,
    lead: tuple[int, ...],
    status: Array,
    chain: Array,
    errors: Errors,
    name: str = "x",
    level: Level | None = None,
) -> None:
    """Raise PoseError for the first row without a result, unless `errors` is "nan"."""
    if errors == "nan" or not (status > 0).any():  # below 0: a result, with a warning
        return
    k = int(np.flatnonzero(status > 0)[0])
    index = f" {tuple(int(i) for i in np.unravel_index(k, lead))}" if lead else ""
    named = explain.part(robot.spec, int(status[k]), int(chain[k])) if chain[k] >= 0 else ""
    reason = f"{named}: " if named else ""
    reason += _core.describe(int(status[k]))
    if status[k] == _core.joint_limit:
        full, motor = robot.is_full(level), int(chain[k])
        reason += ", " if motor >= 0 else " "
        reason += explain.beyond(robot.core, robot.spec, rows[k], motor, full)
    if np.abs(rows[k]).max() > _MUCH:
        reason += "; is it in mm or degrees instead of m and rad?"
    raise PoseError(f"{robot.name}: {what}{index} {name} = {_list(rows[k])}: {reason}")


def at_poses(
    robot: Description,
    x: ArrayLike,
    errors: Errors,
    function: Callable[..., Any],
    *arguments: Any,
    level: Level | None = None,
) -> list[Array]:
    """Evaluate a core function at poses x, (..., n); each result has x's leading shape."""
    rows, lead = flattened(robot, x, robot.n, "x", errors)
    *results, status, chain = function(robot.core, rows, *arguments)
    require_answers(robot, "pose", rows, lead, status, chain, errors, level=level)
    return [of.reshape((*lead, *of.shape[1:]))[()] for of in results]


def together(
    robot: Description, errors: Errors, *, motors: str = "", **values: ArrayLike
) -> list[Array]:
    """Check arrays (..., n), of `motors` (..., m), by name and broadcast their leading shapes."""
    widths = [robot.m if name == motors else robot.n for name in values]
    every = zip(widths, values.items(), strict=True)
    flat = (flattened(robot, v, width, name, errors) for width, (name, v) in every)
    arrays = [rows.reshape(*lead, rows.shape[-1]) for rows, lead in flat]
    try:
        lead = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
        return [np.broadcast_to(a, (*lead, a.shape[-1])) for a in arrays]
    except ValueError:
        shapes = ", ".join(f"{n} {a.shape}" for n, a in zip(values, arrays, strict=True))
        raise InputError(f"{shapes}: leading shapes must broadcast") from None


def inverse(J: Array) -> Array:
    """Return K, q̇ = K ẋ, (..., m, n): J⁻¹, or its pseudo-inverse with redundant motors."""
    across = J.swapaxes(-1, -2)
    square = J.shape[-1] == J.shape[-2]
    return np.linalg.inv(J) if square else np.linalg.solve(J @ across, J).swapaxes(-1, -2)


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values) + "]"


def members(robot: Description, records: Any) -> list[Any]:
    """Return every member of the core's records; of vectors the entries that a robot has."""
    if records.dtype.names:
        return [of for name in records.dtype.names for of in members(robot, records[name])]
    width = {_core.max_readings: robot.m + robot.r, _core.max_motors: robot.m}
    used = slice(width.get(records.shape[-1], robot.n) if records.ndim > 1 else None)
    return [np.array(records[..., used])]
