"""Error budget: what each tolerance and each reading contributes to the error of a pose.

With m readings of σ 1, y = H_x dx + B u + ε, u the parameters in units of their σ. Q spans what H_x
does not reach; Qᵀy of a self-calibration's poses v leaves u an information J = I + Σ BᵀQQᵀB, and

    u - û = J⁻¹ u - J⁻¹ Σ BᵀQQᵀ ε_v,     dx̂ - dx = K (B (u - û) + ε),

K by weighted least squares. Both are linear in independent errors: the contributions' squares are
the variance (GUM: JCGM 100:2008, 5.1). Conditions at work are in u; no calibration depends on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from truepose.arguments import Array, Errors, require
from truepose.design.criterion import USUAL, Criterion
from truepose.design.where import AS_BUILT, Known, Use
from truepose.robot import conditions, knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import reading_units, summed, unit_of
from truepose.show.results import Shown
from truepose.show.table import Table, number
from truepose.show.units import PRINT

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
        total, rows = summed(self.robot), []
        for one in self.contributions:
            factor, unit = PRINT[one.unit]
            stated = None if one.sigma is None else factor * one.sigma
            sizes = total.factor * one.error, 100 * one.share, total.factor * one.halved
            rows.append([one.source, unit, number(stated), *map(number, sizes)])
        unit = PRINT[total.unit][1]
        title = f"Error budget of {self.robot.name}, {self.state}: σ of the {total.name}"
        header = [
            "source",
            "unit",
            "its σ",
            f"contribution ({unit})",
            "share (%)",
            f"error with half ({unit})",
        ]
        return Table("budget", title, header, rows)

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
    require(robot, Robot, "robot", "truepose.load(name)")
    over = use.over(robot)
    model, by = _Linear(robot, over, use.known(robot)), criterion
    every = np.ones(len(model.sources))
    variances, *errors = model.errors(every)
    whole, found = float(variances.sum()), []
    for key in dict.fromkeys(source for source, _, _ in model.sources):
        own = np.array([source == key for source, _, _ in model.sources])
        variance = float(variances[own].sum())
        if variance > 0:
            _, *halved = model.errors(np.where(own, 0.5, 1.0))
            own_of = [one for one in model.sources if one[0] == key and one[1] != 0]
            stated = {(sigma, unit) for _, sigma, unit in own_of}
            sigma, unit = stated.pop() if len(stated) == 1 else (None, "")
            error, share = variance**0.5, variance / whole
            found.append(Contribution(key, sigma, unit, error, share, by.squared(*halved) ** 0.5))
    found.sort(key=lambda one: -one.share)
    error = by.squared(*errors) ** 0.5
    return ErrorBudget(robot, use.state, by, error, whole**0.5, found, over)


def errors_at(
    robot: Robot, poses: Array, use: Use = AS_BUILT, confidence: float | None = 0.95
) -> Array:
    """Return the position error at each pose, (T,), m; NaN where the robot cannot be."""
    model = _Linear(robot, poses, use.known(robot), "nan")
    L, N, U, _ = model.moments(np.ones(len(model.sources)))
    V = L @ L.swapaxes(1, 2) + N
    good, error = np.isfinite(V).all(axis=(1, 2)), np.full(len(V), np.nan)
    error[good] = np.sqrt(Criterion("worst", confidence).kept(V[good], U[good]))
    return error


class _Linear:
    """Errors of estimates at poses as linear functions of independent errors of σ 1."""

    def __init__(self, robot: Robot, over: Array, known: Known, errors: Errors = "raise"):
        visited, touched, reference_sigma = known
        knowledge.require_uncertain(robot)
        names = knowledge.learnable(robot)
        model, level, n = robot.expected(), robot.highest_level, robot.n * len(touched)
        stated = knowledge.stated_sigma(robot, None)
        prior = knowledge.beside_root(knowledge.root(robot, names), conditions.sigmas(robot))
        root = np.pad(prior, ((0, 0), (0, n)))

        def rows(x: Array, when: conditions.When) -> tuple[Array, Array]:
            H, B = knowledge.linearized(model, x, names, errors, level)
            by = conditions.columns(model, x, model.is_full(level), when)
            return H / stated[:, None], (np.concatenate([B, by], axis=2) / stated[:, None]) @ root

        self.H, self.B = rows(over, "work")
        H, B = rows(visited, "calibration")
        if n:  # its pose is known, or among the unknowns
            there, own = rows(touched, "reference")
            own[0, :, -n:] += there[0] * np.asarray(reference_sigma)
            H, B = np.concatenate([H, 0 * there]), np.concatenate([B, own])
        self.earlier = H, B
        self.columns = summed(robot).columns
        self.uniform = np.pad(knowledge.uniform(robot, names), (0, n))
        #: Of every error: its source, σ and unit. Parameters, conditions, the touched pose,
        #: readings, their backlash.
        self.sources = [_parameter(robot, name) for name in names]
        self.sources += [(one.source, one.sigma, one.unit) for one in conditions.known(robot)]
        self.sources += [("reference pose", None, "")] * n
        motors, units = ["motors"] * robot.n + list(robot.sensors), reading_units(robot)
        half = robot.backlash / 2
        rest = np.sqrt(np.maximum(stated**2 - half**2, 0.0))
        self.sources += [*zip(motors, rest.tolist(), units, strict=True)]
        self.sources += [*zip(["backlash"] * len(half), half.tolist(), units, strict=True)]
        #: (2 (n + r), n + r) share of the last errors in the variance of each reading.
        self.parts = np.vstack([np.diag(own**2 / stated**2) for own in (rest, half)])
        #: Share of noise in the variance of each reading.
        self.random = knowledge.noise_share(robot)

    def errors(self, scale: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return the position's variance by each error, then :meth:`moments`."""
        of_readings, seen, K, L, by_u, random = self._estimate(scale)
        by_readings = (np.einsum("tcp,vmp->tcvm", by_u, seen) ** 2).sum(axis=2) + K**2
        by_readings = by_readings.sum(axis=(0, 1)) / of_readings[:, 0] ** 2
        of_sources = scale[by_u.shape[-1] :] ** 2 * (self.parts @ by_readings)
        parts = (by_u**2).sum(axis=(0, 1)), of_sources
        return np.concatenate(parts) / len(K), *self._moments(K, L, by_u, random)

    def moments(self, scale: Array) -> tuple[Array, Array, Array, Array]:
        """Return the arguments of a :class:`Criterion`; `scale` multiplies each error's σ."""
        _, _, *estimate = self._estimate(scale)
        return self._moments(*estimate)

    def _moments(
        self, K: Array, L: Array, by_u: Array, random: Array
    ) -> tuple[Array, Array, Array, Array]:
        transposed = K.swapaxes(1, 2)
        return L, K @ transposed, by_u[..., self.uniform], K * random @ transposed

    def _estimate(self, scale: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Return σ of the readings, what these show of u, K, L, the errors by u, noise's share."""
        p = self.B.shape[-1]
        of_u, of_readings = scale[:p], np.sqrt(scale[p:] ** 2 @ self.parts)[:, None]
        H, B = self.H / of_readings, self.B * of_u / of_readings
        before, earlier = self.earlier[0] / of_readings, self.earlier[1] * of_u / of_readings
        seen = earlier - before @ (np.linalg.pinv(before) @ earlier)
        J = np.eye(p) + np.einsum("vmp,vmk->pk", earlier, seen)
        G = np.linalg.inv(np.linalg.cholesky(J)).T
        L = B @ G
        weighted = np.linalg.solve(L @ L.swapaxes(1, 2) + np.eye(len(of_readings)), H)
        weighted = weighted.swapaxes(1, 2)
        K = np.linalg.solve(weighted @ H, weighted)[:, self.columns]
        L = K @ L
        random = scale[p : p + len(self.random)] ** 2 * self.random / of_readings[:, 0] ** 2
        return of_readings, seen, K, L, L @ G.T, random  # (T, c, p): J⁻¹ = G Gᵀ


def _parameter(robot: Robot, name: str) -> tuple[str, float | None, str]:
    """Return the source of a parameter's error, its σ and unit."""
    learnt, own = robot.spec.calibration, robot.spec.tolerance(name)
    if learnt is not None:
        return CALIBRATION, None, ""
    entry = next(glob for glob, entry in robot.spec.tolerances.items() if entry is own)
    return entry, robot.parameters[name].sigma, unit_of(robot, name)
