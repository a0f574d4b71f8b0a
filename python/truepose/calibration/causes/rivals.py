"""Explanations that a slip must beat: a step at the middle, errors that persist over rows."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from truepose.arguments import Array, finite_rows
from truepose.calibration.causes.hypothesis import LN_RATE, Case, Hypothesis
from truepose.calibration.causes.rows import steps
from truepose.calibration.expectation import poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import patterns
from truepose.calibration.parity import parity
from truepose.robot import knowledge, reading_units
from truepose.show import PRINT

#: Thresholds between two sides, from the middle, over a quantity's range.
BANDS = 0.04 * np.linspace(-1, 1, 5)
#: Persisting errors: correlations of consecutive rows; variances over that of independent errors;
#: σ of these over the stated one.
CORRELATIONS = (0.5, 0.8, 0.95, 0.995)
PERSISTING = (0.0, 0.5, 2.0, 8.0, 32.0, 128.0)
NOISE = np.geomspace(0.5, 8.0, 9)


def sided(case: Case) -> Iterator[Hypothesis]:
    """Columns that read otherwise on one side of the machine, alone or all of a kind alike.

    A side is that of a coordinate's middle or zero, or where one reading exceeds another.
    """
    robot, read = case.robot.expected(), case.log.readings
    x, box = poses_of(robot, read[:, : robot.m]), robot.spec.workspace
    if box is None or not len(x):
        return
    names, units = case.log.names, reading_units(robot)
    quantities = [
        (name, unit, x[:, k], {0.0, (low + high) / 2, float(robot.home[k])})
        for k, ((name, unit), low, high) in enumerate(
            zip(robot.coordinates, box.minimum, box.maximum, strict=True)
        )
    ]
    quantities += [
        (f"{names[j]} - {names[k]}", units[j], read[:, j] - read[:, k], {0.0})
        for j in range(len(names))
        for k in range(j + 1, len(names))
        if units[j] == units[k]
    ]
    found: dict[bytes, tuple[Array, str]] = {}
    for k, (name, unit, value, middles) in enumerate(quantities):
        span = float(np.ma.ptp(np.ma.masked_invalid(value)) or 0.0)
        for middle in middles:
            factor, said = PRINT[unit]
            text = f"where {name} is above about {factor * middle:.4g} {said}"
            near = value[np.abs(value - middle) < span * BANDS[-1]] if k < robot.m else []
            for at in (*(middle + span * BANDS), *near):
                mask = np.asarray(value > at)
                if 1 < mask.sum() < len(mask) - 1:
                    found.setdefault(mask.tobytes(), (mask, text))
    masks = np.array([mask for mask, _ in found.values()])
    texts = [text for _, text in found.values()]
    for which, k, step in steps(case, masks):
        text = f"{which}: reads otherwise {texts[k]}, by"
        yield replace(step, text=text, log_odds=LN_RATE - math.log(len(masks)))


def over_persisting(
    case: Case, of: Hypothesis, fit: Calibration, slip: Hypothesis, rows: Array | None
) -> float:
    """Return the log odds of a slip, against none, if errors may persist from row to row.

    `fit` is that under `of`, one of whose mistakes is `slip`; of a long log some `rows` count.
    Errors have a white part and, in one column or all, one of correlation ρ^|i - j| between rows i
    and j. The marginal likelihood, to first order about the fit, is the largest over both parts.
    """
    robot = fit.robot
    names = knowledge.uncertain(fit.prior)
    rows = np.arange(len(fit.x)) if rows is None else rows
    good = finite_rows(np.hstack([fit.x, fit.residuals]))
    rows = rows[good[rows]]
    if robot.r == 0 or len(rows) < 4:
        return math.inf
    A = parity(robot, fit.x[rows], fit.level, model_error=False).signature
    H_xi = knowledge.linearized(robot, fit.x[rows], names, "nan", fit.level)[1]
    acting = [*case.influences, *of.influences]
    by = A @ patterns(robot, acting, len(fit.x))[rows]
    known = [fit.parameters[name] for name in names] + [fit.influences[of.name] for of in acting]
    moved = np.array([p.value - p.prior for p in known])
    H = np.concatenate([A @ H_xi, by], axis=2)
    y = (A @ fit.residuals[rows][..., None])[..., 0] + H @ moved
    sigma = np.array([of.amount[1] for of in acting])
    root = knowledge.beside_root(knowledge.root(fit.prior, names), sigma)
    A, F = A * knowledge.reading_sigma(robot), H @ root
    own = len(names) + [of is slip.influences[-1] for of in acting].index(True)
    others = [k for k in range(len(known)) if k != own]
    F = F[..., [*others, own]].reshape(-1, len(known))
    with_it, without = _likelihoods(A, F, y.ravel(), rows)
    odds = slip.log_odds - (slip.first.log_odds if slip.first else 0.0)
    return float(with_it - without) + odds


def _likelihoods(A: Array, F: Array, y: Array, rows: Array) -> tuple[float, float]:
    """Return the largest log likelihoods with all unknowns, and without the last one."""
    best, every = np.full(2, -np.inf), A.shape[2]
    apart = np.abs(np.subtract.outer(rows, rows))
    for columns in [slice(None), *(slice(k, k + 1) for k in range(every))]:
        alike = np.einsum("iak,jbk->iajb", A[..., columns], A[..., columns])
        for rho in CORRELATIONS:
            K = (alike * (rho**apart)[:, None, :, None]).reshape(len(y), len(y))
            share, Q = np.linalg.eigh(K)
            z, G = Q.T @ y, Q.T @ F
            for persisting in PERSISTING:
                rate = LN_RATE if persisting else 0.0
                v = 1 + persisting * np.maximum(share, 0.0)
                W = (G.T / v) @ G
                b, c, logs = (G.T / v) @ z, (z**2 / v).sum(), np.log(v).sum() / 2
                for s in NOISE:
                    C = np.linalg.cholesky(W / s**2 + np.eye(len(W)))
                    t = np.linalg.solve(C, b / s**2) ** 2
                    fits = rate - (c / s**2) / 2 - logs - len(y) * math.log(s)
                    diagonal = np.log(np.diag(C))
                    both = [
                        fits + t[:k].sum() / 2 - diagonal[:k].sum() for k in (len(t), len(t) - 1)
                    ]
                    best = np.maximum(best, both)
    return best[0], best[1]
