"""Error budget: what each tolerance and each reading contributes to the error of a pose.

Errors are linear in independent errors: the contributions' squares are the variance (GUM: JCGM
100:2008, 5.1).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.design.criterion import USUAL, Criterion
from truepose.design.linear import LinearErrors
from truepose.design.where import AS_BUILT, Use
from truepose.robot import (
    Robot,
    conditions,
    knowledge,
    reading_units,
    require_robot,
    summed,
    unit_of,
)
from truepose.show import PRINT, Shown, Table, tabled

#: The source of parameters that a calibration identified: their errors are correlated.
CALIBRATION = "calibration"


class Contribution(NamedTuple):
    """The contribution of one source to the position error."""

    source: str  #: entry of [tolerances], key of [conditions], "backlash", or name of a reading
    sigma: float | None  #: of each of its errors, in SI units; None: they differ
    unit: str
    error: float  #: standard deviation, rms over the poses, m
    share: float  #: of the variance
    halved: float  #: the position error by the criterion, with half of this source's σ, m


@dataclass(frozen=True, eq=False, repr=False)
class ErrorBudget(Shown):
    """Contributions to the position error, largest first."""

    robot: Robot
    state: str
    criterion: Criterion
    error: float  #: position error by the criterion, m
    sigma: float  #: standard deviation, rms over the poses, m
    contributions: list[Contribution]
    over: Array  #: (T, n) poses

    def table(self) -> Table:
        """Return a table with one row per source."""
        total = summed(self.robot)
        unit = PRINT[total.unit][1]
        rows = [
            {
                "source": one.source,
                "unit": PRINT[one.unit][1],
                "its σ": None if one.sigma is None else PRINT[one.unit][0] * one.sigma,
                f"contribution ({unit})": total.factor * one.error,
                "share (%)": 100 * one.share,
                f"error with half ({unit})": total.factor * one.halved,
            }
            for one in self.contributions
        ]
        title = f"Error budget of {self.robot.name}, {self.state}: σ of the {total.name}"
        return tabled("budget", title, rows)

    def _draw(self, figure: Any) -> None:
        total, shown = summed(self.robot), self.contributions[:20]
        figure.set_size_inches(6.4, 1.2 + 0.28 * len(shown))
        axes = figure.subplots()
        names = [one.source for one in shown]
        axes.barh(names, [total.factor * one.error for one in shown], color="C0")
        axes.invert_yaxis()
        axes.set(xlabel=f"contribution to σ of the {total.label}")
        axes.set_title(f"{self.robot.name}, {self.state}", fontsize=10, parse_math=False)
        axes.grid(axis="x", color="0.92")
        axes.set_axisbelow(True)


def error_budget(robot: Robot, use: Use = AS_BUILT, criterion: Criterion = USUAL) -> ErrorBudget:
    """Return what every tolerance and reading contributes to the position error of an estimate.

    Parameters
    ----------
    robot : Robot
        With the sensors in use.
    use : Use
        Where the accuracy counts, and what is done with the robot once before.
    criterion : Criterion
        Of the error, and of that with half of a source.

    Returns
    -------
    ErrorBudget

    Raises
    ------
    InputError
        No parameter is uncertain, or a pose is out of reach.

    Examples
    --------
    >>> import truepose as tp
    >>> budget = tp.design.error_budget(tp.load("h4"))
    >>> [(one.source, round(one.share, 2)) for one in budget.contributions[:2]]
    [('chain*.rod', 0.98), ('chain*.encoder_offset', 0.01)]
    >>> round(sum(one.share for one in budget.contributions), 12)
    1.0
    """
    require_robot(robot)
    knowledge.require_uncertain(robot)
    over, by = use.over(robot), criterion
    model = LinearErrors(robot, robot.sensors, over, use.known(robot))
    variances, sources = model.variances(), _sources(model)
    whole, found = float(variances.sum()), []
    for key in dict.fromkeys(source for source, _, _ in sources):
        own = np.array([source == key for source, _, _ in sources])
        variance = float(variances[own].sum())
        if variance > 0:
            halved = max(model.each(by, scale=np.where(own, 0.5, 1.0))) ** 0.5
            acting = zip(sources, own & (variances > 0), strict=True)
            stated = {(sigma, unit) for (_, sigma, unit), acts in acting if acts}
            sigma, unit = stated.pop() if len(stated) == 1 else (None, "")
            found.append(Contribution(key, sigma, unit, variance**0.5, variance / whole, halved))
    found.sort(key=lambda one: -one.share)
    error = max(model.each(by)) ** 0.5
    return ErrorBudget(robot, use.state, by, error, whole**0.5, found, over)


def errors_at(
    robot: Robot, poses: Array, use: Use = AS_BUILT, confidence: float | None = 0.95
) -> Array:
    """Return the position error at each pose, (T,), m; NaN where the robot cannot be."""
    knowledge.require_uncertain(robot)
    model = LinearErrors(robot, robot.sensors, poses, use.known(robot), errors="nan")
    K, L, by_u, *_ = model.estimate()
    V, U = L @ L.swapaxes(1, 2) + K @ K.swapaxes(1, 2), by_u[..., model.uniform]
    good, error = finite_rows(V), np.full(len(V), np.nan)
    error[good] = np.sqrt(Criterion("worst", confidence).kept(V[good], U[good]))
    return error


def _sources(model: LinearErrors) -> list[tuple[str, float | None, str]]:
    """Return the source of every error, its σ and unit, in the order of their variances."""
    robot = model.robot
    sources = [_parameter(robot, name) for name in model.names]
    sources += [(one.source, one.sigma, one.unit) for one in conditions.known(robot)]
    sources += [("reference pose", None, "")] * (len(model.uniform) - len(sources))
    units, readings = reading_units(robot), ["motors"] * robot.m + list(robot.sensors)
    for names, sigma in zip(
        (readings, ["backlash"] * len(units)), model.parts.tolist(), strict=True
    ):
        sources += zip(names, sigma, units, strict=True)
    return sources


def _parameter(robot: Robot, name: str) -> tuple[str, float | None, str]:
    """Return the source of a parameter's error, its σ and unit."""
    learnt, own = robot.spec.calibration, robot.spec.tolerance(name)
    if learnt is not None:
        return CALIBRATION, None, ""
    entry = next(glob for glob, entry in robot.spec.tolerances.items() if entry is own)
    return entry, robot.parameters[name].sigma, unit_of(robot, name)
