"""Isolation of a faulty reading by evidence over many poses."""

import itertools
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, Level, finite_rows
from truepose.calibration.parity import gate, parity, whitened
from truepose.exceptions import InputError
from truepose.faults.limits import FALSE_ALARM, require_inside
from truepose.robot import Robot, flattened, reading_axes, reading_units, require_robot
from truepose.show import Cell, Shown, Table, number, ranges

#: Errors of a reading: constant, or proportional to itself.
KINDS = ("bias", "gain")


@dataclass(frozen=True)
class Hypothesis:
    """Single fault of one reading, of one kind, in all rows."""

    reading: str
    kind: str  #: of `KINDS`
    size: float  #: most likely; m or rad of a bias, excess over 1 of a gain
    sigma: float  #: of the size; inf: no row determines it
    chi2: float  #: residual χ² under this hypothesis

    def __str__(self) -> str:
        return f"{self.reading} {self.kind}"


@dataclass(frozen=True, repr=False)
class Isolation(Shown):
    """Likelihood of each single-fault hypothesis given rows of readings."""

    robot: Robot
    level: Level
    false_alarm: float  #: probability that a healthy robot counts as faulty
    lines: int  #: rows used
    left_out: int  #: rows without a pose
    chi2: float  #: of the parities if all readings are healthy
    freedom: int  #: its degrees of freedom
    limit: float  #: threshold of a fault
    hypotheses: tuple[Hypothesis, ...]  #: most likely first

    @property
    def faulty(self) -> bool:
        """Whether the readings contradict each other more than chance and geometry allow."""
        return self.chi2 > self.limit

    @property
    def may_be(self) -> tuple[Hypothesis, ...]:
        """Hypotheses that explain the rows and that no test distinguishes from the most likely.

        Empty: no fault, or no single fault explains the rows.
        """
        if not self.faulty:
            return ()
        rest = 1e-9 * self.chi2  # one equation: an explanation leaves only rounding errors
        if self.freedom > 1:
            rest = gate(self.false_alarm, self.freedom - 1)
        near = self.hypotheses[0].chi2 + gate(self.false_alarm, 1)
        return tuple(h for h in self.hypotheses if h.chi2 <= min(rest, near))

    @property
    def readings(self) -> tuple[str, ...]:
        """Readings of which one may be faulty; a single one is isolated."""
        return tuple(dict.fromkeys(h.reading for h in self.may_be))

    def table(self) -> Table:
        """Return one row a hypothesis, the likeliest first."""
        axes = {axis.name: axis for axis in reading_axes(self.robot)}
        rows, may_be = [], self.may_be
        for h in self.hypotheses:
            _, factor, unit = axes[h.reading] if h.kind == "bias" else ("", 100.0, "%")
            size = factor * h.size
            shown = Cell(f"{number(size)} {unit}", {"size": size, "unit": unit})
            sure = "yes" if h in may_be else "no"
            rows.append([h.reading, h.kind, shown, number(factor * h.sigma), number(h.chi2), sure])
        header = ["reading", "kind", "size", "σ", "χ² left", "may be it"]
        title = f"One reading alone is wrong, in all of {self.lines} lines"
        return Table("hypotheses", title, header, rows)

    def _draw(self, figure: Any) -> None:
        may_be = self.may_be
        series: dict[str, dict[str, list[float]]] = {"may be it": {}, "is not": {}}
        for h in self.hypotheses:
            series["may be it" if h in may_be else "is not"][str(h)] = [0, h.chi2, h.chi2]
        (axes,) = ranges(figure, {"χ² left unexplained (–)": series}, "hypothesis")
        axes.axvline(self.chi2, color="k", lw=0.9)
        axes.axvline(self.limit, color="k", lw=0.9, ls=":")
        words = "line: χ² without a fault; dotted: limit of a healthy robot"
        figure.suptitle(f"{self.robot.name}: {words}", fontsize=9, parse_math=False)


def isolate(
    robot: Robot,
    readings: ArrayLike,
    level: Level | None = None,
    model_error: bool = True,
    *,
    false_alarm: float | None = None,
) -> Isolation:
    """Find the faulty reading from rows at many poses, by a bank of hypotheses.

    With one redundant sensor a single pose detects a fault but does not isolate it. A faulty
    reading contradicts the others by b times its signature, which changes with the pose in its own
    way. Each hypothesis has its own b; the geometry is common to all (Willsky and Jones, A
    generalized likelihood ratio approach to the detection and estimation of jumps in linear
    systems, 1976).

    Parameters
    ----------
    robot : Robot
        The assumed robot: with its tolerances, or calibrated before the fault.
    readings : array_like, shape (N, n + r)
        m and rad, of the motors, then of the sensors in use; rows with NaN are excluded.
    level : {"ideal", "full"}, optional
        Model level; by default :attr:`Robot.highest_level`.
    model_error : bool
        Whether the ideal level's model error counts.
    false_alarm : float, optional
        Probability that a healthy robot counts as faulty, and that one hypothesis is taken for
        another; by default that of one false alarm in 1000 hours at 1 kHz.

    Raises
    ------
    InputError
        No redundant sensor is in use, or no row has a pose.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> h4 = tp.load("h4").with_file(conditions=None)  # one redundant sensor; as calibrated
    >>> there = h4.read(workspace_grid(h4)[::6], seed=1)
    >>> learnt = tp.calibrate(h4, there).robot
    >>> tp.faults.isolate(learnt, there).faulty
    False
    >>> there[:, 2] += np.radians(0.5)
    >>> found = tp.faults.isolate(learnt, there)
    >>> found.readings, round(float(np.degrees(found.may_be[0].size)), 1)
    (('q3',), 0.5)
    """
    require_robot(robot)
    alpha = FALSE_ALARM if false_alarm is None else false_alarm
    require_inside("false_alarm", alpha, 0, 1)
    if not robot.r:
        raise InputError(f"{robot.name}: no redundant sensor in use: isolation needs one")
    level = robot.highest_level if level is None else level
    model = robot.expected().with_level(level)
    rows, _ = flattened(model, readings, robot.m + robot.r, "readings", "nan")
    evidence = partial(_evidence, model, model_error)
    used, y, columns = evidence(rows)
    if not used.any():
        raise InputError(f"readings: none of {len(rows)} rows has a pose")
    rows, total = rows[used], float(y @ y)
    limit = gate(alpha, robot.r * len(rows))
    bank = [
        _next(Hypothesis(name, kind, 0.0, math.inf, total), y, columns[:, k])
        for k, (kind, name) in enumerate(itertools.product(KINDS, robot.readings))
    ]
    bank.sort(key=lambda h: h.chi2)
    # Linearize without the fault: a large one is nonlinear.
    for k in [*range(_LIKELY)] * _AGAIN if total > limit else ():
        h = bank[k]
        c = robot.readings.index(h.reading)
        healthy = rows.copy()
        healthy[:, c] = rows[:, c] - h.size if h.kind == "bias" else rows[:, c] / (1 + h.size)
        there, left, others = evidence(healthy)
        if there.all():
            column = others[:, c + KINDS.index(h.kind) * len(robot.readings)]
            bank[k] = _next(h, left, column)
    bank.sort(key=lambda h: h.chi2)
    freedom, left_out = robot.r * len(rows), int((~used).sum())
    return Isolation(robot, level, alpha, len(rows), left_out, total, freedom, limit, tuple(bank))


#: Number of hypotheses that are linearized again, and how often.
_LIKELY, _AGAIN = 4, 2


def _next(h: Hypothesis, y: Array, column: Array) -> Hypothesis:
    """Take the step that minimizes the residual of y, of variance 1."""
    information = float(column @ column)
    if not information:
        return h
    step = float(column @ y) / information
    left = y - step * column
    return replace(h, size=h.size + step, sigma=1 / math.sqrt(information), chi2=float(left @ left))


def _evidence(model: Robot, model_error: bool, rows: Array) -> tuple[Array, Array, Array]:
    """Return which rows have a pose, their parities and hypotheses' columns, of variance 1."""
    poses = model.fkm(rows[:, : model.m], errors="nan")
    # Singular poses have no parity.
    regular = finite_rows(model.linearize(poses, "nan")[0])
    used = np.asarray(regular & finite_rows(rows))
    if not used.any():
        return used, np.zeros(0), np.zeros((0, 0))
    poses, rows = poses[used], rows[used]
    found = parity(model, poses, model_error=model_error)
    error = rows - model.extended_positions(poses)
    for k, unit in enumerate(reading_units(model)[model.m :], model.m):
        if unit == "rad":  # whole turns of a sensor are no fault
            turn = 2 * math.pi * abs(model.parameters[f"{model.readings[k]}.gain"].value)
            error[:, k] -= turn * np.round(error[:, k] / turn)
    B = found.geometry.reshape(-1, found.geometry.shape[-1])
    G, by = found.signature, rows[:, None]
    sides = (G, G * by, G @ error[..., None])  # of a bias, of a gain, of the readings
    rest = whitened(np.column_stack([side.reshape(len(B), -1) for side in sides]), B)
    return used, rest[:, -1], rest[:, :-1]
