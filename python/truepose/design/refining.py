"""Continuous refinement of planned poses within the workspace box.

With the weights M of the gains, the criterion tr(M Σ) of n poses has the derivative
-2 Σ_k (C_k Σ M Σ) · dC_k by the rows C_k of each pose k, whose derivatives by the pose are
differences. A pose that cannot be reached adds no information, so that no step ends there.
"""

from collections.abc import Callable

import numpy as np

from truepose.arguments import Array
from truepose.design.exchange import posterior

#: Rounds, each with the weights of the poses before it, and largest number of steps of one.
ROUNDS, STEPS = 2, 30
#: Step of a difference, as a share of the box.
SHIFT = 1e-4
#: Share of the box in some coordinate by which poses differ at least: readings of equal poses have
#: equal counts, which add nothing.
APART = 0.01


def refined(
    x: Array,
    low: Array,
    high: Array,
    rows: Callable[[Array], Array],
    information: Array,
    weights: Callable[[Array], Array],
) -> Array:
    """Return poses (n, c) in the box from `low` to `high` with a smaller criterion, apart.

    `rows` gives those of poses, (n, r, p), zero where one cannot be reached; `weights` M for a root
    of Σ; `information` is the prior Σ⁻¹.
    """
    from scipy.optimize import minimize

    n, c = x.shape
    size = np.where(high > low, high - low, 1.0)
    u = begin = (x - low) / size

    def cost(flat: Array, M: Array, unit: float) -> tuple[float, Array]:
        u = flat.reshape(n, c)
        h = np.where(u < 0.5, SHIFT, -SHIFT)  # stays in the box
        shifted = u[:, None] + h[:, :, None] * np.eye(c)
        every = rows(low + size * np.concatenate([u[:, None], shifted], axis=1).reshape(-1, c))
        C, *moved = every.reshape(n, c + 1, *every.shape[1:]).swapaxes(0, 1)
        G = posterior(information, C, range(n))
        A = C @ (G @ G.T) @ M @ (G @ G.T)
        slope = np.zeros((n, c))
        for k, D in enumerate(moved):
            there = D.any(axis=(1, 2))
            slope[there, k] = -2 * ((D - C) * A).sum(axis=(1, 2))[there] / h[there, k]
        return float(np.vdot(M @ G, G)) / unit, slope.ravel() / unit

    bounds = [(0.0, float(b > a)) for a, b in zip(low, high, strict=True)] * n
    for _ in range(ROUNDS):
        M = weights(posterior(information, rows(low + size * u), range(n)))
        unit = cost(u.ravel(), M, 1.0)[0]
        found = minimize(
            cost, u.ravel(), (M, unit), jac=True, method="L-BFGS-B", bounds=bounds,
            options={"maxiter": STEPS},
        )  # fmt: skip
        if found.fun < 1:
            u = found.x.reshape(n, c)
    return low + size * _apart(u, begin)


def _apart(u: Array, begin: Array) -> Array:
    """Return poses of which those that came too close to an earlier one are where they began."""
    u = u.copy()
    while True:
        near = np.tril(np.abs(u[:, None] - u).max(axis=-1) < APART, -1).any(axis=1)
        back = near & (u != begin).any(axis=1)
        if not back.any():
            return u
        u[back] = begin[back]
