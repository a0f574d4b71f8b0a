"""The library of printers (truepose/printers.h), by ctypes: text in, JSON out, and kinematics."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arguments import Array

_LIBRARY = ctypes.CDLL(str(next(Path(__file__).parent.glob("*truepose_printers.*"))))
#: Largest answer, bytes: a configuration has at most 1 MB.
_MOST = 1 << 24
#: Numbers of truepose_printer_options.
_OPTIONS = 12


def answer(text: str, options: Sequence[float] = ()) -> dict[str, Any]:
    """Return the answer to a text; `options` as truepose_printer_options, those left out 0."""
    data, found = text.encode(), ctypes.create_string_buffer(_MOST)
    used = _LIBRARY.truepose_printer(
        data,
        ctypes.c_size_t(len(data)),
        (ctypes.c_double * _OPTIONS)(*options),
        found,
        ctypes.c_size_t(_MOST),
    )
    return dict(json.loads(found.raw[:used]))


@dataclass(frozen=True)
class Delta:
    """Kinematics of a delta printer; parameters p as `theta` in answers, m and rad."""

    rotary: bool
    step: Array  #: (3,) motion of carriage or arm per step, m or rad

    def _each(self, name: str, p: Array, rows: Array, *results: Array) -> None:
        arrays = [np.ascontiguousarray(array, dtype=float) for array in (self.step, p, rows)]
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*arrays, *results)]
        getattr(_LIBRARY, name)(int(self.rotary), ctypes.c_size_t(len(arrays[2])), *pointers)

    def positions(self, p: Array, steps: Array) -> tuple[Array, Array]:
        """Return the nozzle at steps down from the endstops, (N, 3), and ∂x/∂p, (N, 3, P)."""
        x, slopes = np.empty((len(steps), 3)), np.empty((len(steps), 3, len(p)))
        self._each("truepose_printer_positions", p, steps, x, slopes)
        return x, slopes

    def steps(self, p: Array, x: Array) -> Array:
        """Return the steps down from the endstops with the nozzle at x, (N, 3)."""
        steps = np.empty((len(x), 3))
        self._each("truepose_printer_steps", p, x, steps)
        return steps
