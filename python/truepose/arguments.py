"""Checks of arguments, and short forms of arrays, that several functions share."""

import fnmatch
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.exceptions import InputError, choose, shortened

Array = NDArray[Any]  #: of numbers unless documented otherwise (flags, words)
Errors = Literal["raise", "nan"]
Level = Literal["ideal", "full"]


def check_real(values: Any, name: str) -> None:
    """Raise InputError for values with units, masks or imaginary parts, which the core drops."""
    if hasattr(values, "to_base_units"):  # pint and similar packages
        raise InputError(f"{name}: has units ({values.units}): pass x.to_base_units().magnitude")
    if isinstance(values, str | Path):
        raise InputError(f"{name} = {shortened(repr(values))}: must be numbers, not text")
    parts = values if isinstance(values, list | tuple) else (values,)
    parts = [part for part in parts if isinstance(part, np.ndarray | np.generic)]
    if any(isinstance(part, np.ma.MaskedArray) for part in parts):
        raise InputError(f"{name}: a masked array: fill the masked values (NaN) or drop them")
    if any(map(np.iscomplexobj, parts)):
        raise InputError(f"{name}: complex numbers: must be real")


def columns_of(table: Any) -> list[Any] | None:
    """Return the names of a table's columns; None without names."""
    if isinstance(table, Mapping):
        return list(table)
    if isinstance(table, list) and table and all(isinstance(row, Mapping) for row in table):
        return list(dict.fromkeys(name for row in table for name in row))
    for name in ("column_names", "columns"):  # pyarrow; pandas, polars
        names = getattr(table, name, None)
        if names is not None and not callable(names):
            return list(names)
    names = getattr(getattr(table, "dtype", None), "names", None)  # a structured array
    return None if names is None else list(names)


def column_of(table: Any, name: Any) -> Any:
    """Return one column of a table as of :func:`columns_of`; None where a dict has no such cell."""
    return [row.get(name) for row in table] if isinstance(table, list) else table[name]


def numbers_of(values: ArrayLike, name: str) -> Array:
    """Return real numbers as an array."""
    check_real(values, name)
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be numbers") from None


def require(value: object, kind: type, name: str, instead: str) -> None:
    """Raise InputError unless an argument has a type; `instead` tells how to get one."""
    if not isinstance(value, kind):
        raise InputError(f"{name} = {shortened(repr(value))}: must be a {kind.__name__}: {instead}")


def require_or_none(value: object, kind: type, name: str, instead: str) -> None:
    """Raise InputError unless an argument is None or has a type."""
    if value is not None:
        require(value, kind, name, f"{instead}, or None")


def require_all(values: object, kind: type, name: str) -> None:
    """Raise InputError unless an argument is a sequence of values of a type."""
    if isinstance(values, str) or not isinstance(values, Sequence):
        kinds = kind.__name__
        raise InputError(f"{name}: must be a list of {kinds}: [{kinds.lower()}]")
    for value in values:
        if not isinstance(value, kind):
            raise InputError(f"{name}: {shortened(repr(value))}: must be a {kind.__name__}")


def check_seed(seed: int) -> int:
    """Return a seed that is valid for the core's generator."""
    if not (isinstance(seed, (int, np.integer)) and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed!r}: must be a whole number from 0 to 2^64 - 1")
    return int(seed)


def finite(name: str, value: Any, least: float = -math.inf, unit: str = "") -> None:
    """Raise InputError unless the value is a finite number of at least `least`."""
    must = f"a finite number{f' of at least {least}' if least > -math.inf else ''}{unit}"
    _check(name, value, must, lambda: math.isfinite(value) and value >= least)


def positive(name: str, value: Any, unit: str = "", most: float = math.inf) -> None:
    """Raise InputError unless the value is a finite number greater than 0, and at most `most`."""
    must = f"a finite number greater than 0{f' and at most {most:g}' if most < math.inf else ''}"
    _check(name, value, f"{must}{unit}", lambda: math.isfinite(value) and 0 < value <= most)


def whole(name: str, value: Any, least: int, most: float = math.inf) -> None:
    """Raise InputError unless the value is a whole number from `least` to `most`."""
    span = f"of at least {least}" if most == math.inf else f"from {least} to {most}"
    right = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    _check(name, value, f"a whole number {span}", lambda: right and least <= value <= most)


def fraction(name: str, value: Any) -> None:
    """Raise InputError unless the value is a number from 0 to 1."""
    _check(name, value, "a number from 0 to 1", lambda: 0 <= value <= 1)


def _check(name: str, value: Any, must: str, fits: Callable[[], bool]) -> None:
    try:
        good = fits()
    except (TypeError, ValueError):  # None, an array
        good = False
    if not good:
        shown = value if isinstance(value, numbers.Number) else shortened(repr(value))
        raise InputError(f"{name} = {shown}: must be {must}")


def selected(what: str, patterns: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the names selected by names and globs, in their order; "all" or "none" alone."""
    if list(patterns) in (["all"], ["none"]) and patterns[0] not in names:
        return tuple(names) if patterns[0] == "all" else ()
    chosen: list[str] = []
    for pattern in patterns:
        fits = [pattern] if pattern in names else fnmatch.filter(names, str(pattern))
        if not fits:
            raise InputError(choose(what, pattern, names) + ", or a glob of them, none, all")
        chosen += fits if pattern in names else [name for name in fits if name not in chosen]
    return tuple(chosen)


def numbers_like(
    name: str, value: ArrayLike, shape: tuple[int, ...], must: str = "a finite number"
) -> Array:
    """Return numbers of a shape, from one or so many; `must`: 0 or greater, or greater than 0."""
    try:
        result = np.broadcast_to(np.asarray(value, dtype=float), shape)
    except (TypeError, ValueError):
        wanted = " × ".join(map(str, shape))
        raise InputError(f"{name}: must be a number or {wanted} of them") from None
    least = 0.0 if must == "0 or greater" else -math.inf
    good = np.isfinite(result) & (result > 0 if must == "greater than 0" else result >= least)
    if not good.all():
        wrong = result[~good][0]
        too = "a finite number " if wrong == np.inf and must == "greater than 0" else ""
        raise InputError(f"{name} = {wrong:g}: must be {too}{must}")
    return result


def finite_rows(values: Array) -> Array:
    """Return which rows, (N, …), have finite numbers alone, (N,)."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


def sigmas_of(covariance: Array) -> Array:
    """Return the standard deviations, (..., n), of a covariance, (..., n, n)."""
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
