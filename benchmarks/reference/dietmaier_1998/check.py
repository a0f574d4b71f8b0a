"""Dietmaier's hexapod (1998): a Stewart-Gough platform with 40 real postures."""

from pathlib import Path

import numpy as np
from rows import Row, numbers, table

import truepose as tp

HERE = Path(__file__).parent


def rows() -> list[Row]:
    """Compare."""
    columns = table(HERE / "geometry.csv")
    robot = tp.load(HERE / "robot.toml")
    legs = numbers(columns, "length")[:, 0]
    base = numbers(columns, "base_x", "base_y", "base_z")
    typed = [[robot.parameters[f"chain{k}.base.{c}"].value for c in "xyz"] for k in range(1, 7)]
    modes = robot.assembly_modes(legs, seed=0)
    apart = np.linalg.norm(modes.x[:, None] - modes.x, axis=2)
    np.fill_diagonal(apart, np.inf)
    lengths = robot.ikm(modes.x)
    return [
        Row("base joints, table against robot file", 0, float(np.abs(base - typed).max()), 0),
        Row("real postures", 40, len(modes), 0),
        Row("number that the completeness estimate expects", 40, modes.expected, 0),
        Row("leg lengths there, worst error", 0, float(np.abs(lengths - legs).max()), 1e-9),
        Row("postures closer than 0.001 to another", 0, int((apart.min(axis=1) < 1e-3).sum()), 0),
    ]
