"""Which control laws are there? The paper's three, and those that weigh the readings."""

from __future__ import annotations

from typing import Literal, get_args

Law = Literal["joint", "redundant", "cartesian", "weighted", "estimated"]
LAWS: tuple[Law, ...] = get_args(Law)
