"""What may an argument be: arrays, seeds, fractions?"""

from __future__ import annotations

import numbers
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.exceptions import InputError

Array = NDArray[np.float64]
Errors = Literal["raise", "nan"]
Level = Literal["ideal", "full"]


def check_real(values: object, name: str) -> None:
    """Refuse what would lose its mask or its imaginary part on its way into the core.

    Raises
    ------
    InputError
        A masked array, or a list of them; complex numbers.
    """
    parts = values if isinstance(values, list | tuple) else (values,)
    parts = [part for part in parts if isinstance(part, np.ndarray | np.generic)]
    if any(isinstance(part, np.ma.MaskedArray) for part in parts):
        raise InputError(f"{name}: a masked array: fill what is masked (NaN), or leave it out")
    if any(map(np.iscomplexobj, parts)):
        raise InputError(f"{name}: complex numbers: must be real")


def numbers_of(values: ArrayLike, name: str) -> Array:
    """Return real numbers as an array.

    Examples
    --------
    >>> import numpy as np
    >>> numbers_of(np.ma.masked_invalid([0.1, np.nan]), "x")
    Traceback (most recent call last):
    truepose.exceptions.InputError: x: a masked array: fill what is masked (NaN), or leave it out
    """
    check_real(values, name)
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be numbers") from None


def check_seed(seed: int) -> int:
    """Return a seed that the core's generator takes."""
    if not (isinstance(seed, (int, np.integer)) and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed!r}: must be a whole number from 0 to 2^64 - 1")
    return int(seed)


def fraction(name: str, value: float) -> None:
    """Raise InputError unless the value is a number from 0 to 1."""
    if not (isinstance(value, numbers.Real) and 0 <= value <= 1):
        raise InputError(f"{name} = {value}: must be a number from 0 to 1")
