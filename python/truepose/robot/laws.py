"""Which control laws are there? The paper's three, and those that weigh the readings."""

from __future__ import annotations

from typing import Literal

from truepose import _core

Law = Literal["joint", "redundant", "cartesian", "weighted", "estimated"]
LAWS: tuple[Law, ...] = tuple(_core.laws)
