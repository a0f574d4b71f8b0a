"""Calibrations by scipy: one dense least squares over all unknowns at once."""

import numpy as np
from scipy.optimize import least_squares

from truepose.robot import knowledge


def maximum_a_posteriori(robot, q_e, free=(), further=lambda w, x: ()):
    """Return unknowns in units of their prior σ, poses, the covariance of these unknowns, the cost.

    Unknowns are the robot's parameters, then w of prior mean 0 and σ `free`; `further(w, x)` are
    residuals beside the readings'.
    """
    names, sigma = knowledge.uncertain(robot), knowledge.reading_sigma(robot)
    prior, x = robot.parameters, robot.expected().fkm(q_e[:, : robot.n])
    own, p = len(names), len(names) + len(free)

    def residual(unknowns):
        at = unknowns[p:].reshape(x.shape)
        u = zip(names, unknowns[:own], strict=True)
        moved = robot.replace({n: prior[n].mean + prior[n].sigma * v for n, v in u})
        off = (q_e - moved.extended_positions(at, level=robot.highest_level)) / sigma
        more = further(np.asarray(free) * unknowns[own:p], at)
        return np.concatenate([off.ravel(), *more, unknowns[:p]])

    start = np.concatenate([np.zeros(p), x.ravel()])
    scale = np.concatenate([np.ones(p), np.full(x.size, 1e-4)])
    found = least_squares(
        residual, start, jac="3-point", x_scale=scale, xtol=1e-14, ftol=1e-15, gtol=1e-12
    )
    covariance = np.linalg.inv(found.jac.T @ found.jac)[:p, :p]
    return found.x[:p], found.x[p:].reshape(x.shape), covariance, 2 * found.cost


def changes(fit):
    """Return every unknown's change, and their joint covariance, in units of the prior σ."""
    every = [*fit.parameters.values(), *fit.others.values()]
    sigma = np.array([of.prior_sigma for of in every])
    change = [of.value - of.prior for of in every] / sigma
    return change, fit.joint_covariance / np.outer(sigma, sigma)
