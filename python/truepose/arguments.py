"""Is an argument what a function takes?"""

from __future__ import annotations

import numbers

import numpy as np

from truepose.exceptions import InputError


def check_seed(seed: int) -> int:
    """Return a seed that the core's generator takes."""
    if not (isinstance(seed, (int, np.integer)) and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed!r}: must be a whole number from 0 to 2^64 - 1")
    return int(seed)


def fraction(name: str, value: float) -> None:
    """Raise InputError unless the value is a number from 0 to 1."""
    if not (isinstance(value, numbers.Real) and 0 <= value <= 1):
        raise InputError(f"{name} = {value}: must be a number from 0 to 1")
