"""The paper's tables as data.

Source: F. Marquet, O. Company, S. Krut, F. Pierrot, *Enhancing Parallel Robots Accuracy with
Redundant Sensors*.
"""

from __future__ import annotations

import csv
import itertools
from importlib import resources

import numpy as np

from truepose.arguments import Array
from truepose.control.controller import Controller
from truepose.robot.laws import Law

GEAR = 4  #: The tool turns four times as far as the nacelle.
QUANTITIES = ("x", "y", "z", "theta", "norm_xyz")
STATISTICS = ("average", "peak_to_peak", "sum_sq", "average_abs")


def control(law: Law) -> Controller:
    """Return the simulations' control: a PD on each motor, its poles assumed at 150 rad/s.

    Examples
    --------
    >>> from truepose.paper import article
    >>> article.control("joint").gains
    'diagonal'
    """
    return Controller(law=law, frequency=150.0, velocity_bandwidth=1500.0, gains="diagonal")


def _rows(name: str) -> list[dict[str, str]]:
    text = (resources.files("truepose") / "paper" / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


def table2() -> Array:
    """Return the 625 poses of Table 2, shape (625, 4): m and the *nacelle's* θ in rad.

    Examples
    --------
    >>> from truepose.paper import article
    >>> article.table2().shape
    (625, 4)
    """
    axes = []
    for row in _rows("table2_locations"):
        low, high, step = (float(row[key]) for key in ("minimum", "maximum", "step"))
        values = np.linspace(low, high, round((high - low) / step) + 1)
        axes.append(values / 1000 if row["unit"] == "mm" else values / GEAR)
    return np.array(list(itertools.product(*axes)))


def table3() -> dict[str, dict[tuple[str, str], float]]:
    """Table 3: {law: {(quantity, statistic): value}}, laws "usual" and "redundant"; mm, deg."""
    return {
        law: {key: float(text) for key, text in entries.items()}
        for law, entries in table3_as_printed().items()
    }


def table3_as_printed() -> dict[str, dict[tuple[str, str], str]]:
    """Table 3 with the digits that the paper prints: 0.5 and 13.0, neither 0.500 nor 13.

    Examples
    --------
    >>> from truepose.paper import article
    >>> article.table3_as_printed()["usual"]["theta", "average_abs"]
    '0.5'
    """
    result: dict[str, dict[tuple[str, str], str]] = {"usual": {}, "redundant": {}}
    for row in _rows("table3_experiment"):
        for law, entries in result.items():
            for statistic in STATISTICS:
                if text := row[f"{statistic}_{law}"]:
                    entries[row["quantity"], statistic] = text
    return result


def simulation_errors() -> dict[str, tuple[float, float]]:
    """Ranges of the geometric errors of the paper's simulations, m."""
    return {
        row["parameter"]: (float(row["minimum"]) / 1000, float(row["maximum"]) / 1000)
        for row in _rows("simulation_errors")
    }
