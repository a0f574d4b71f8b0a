"""The machine as it reads in a log's last row, where a mistake changed its readings for good."""

from dataclasses import replace

import numpy as np

from truepose.arguments import Array, sigmas_of
from truepose.calibration.causes.hypothesis import Hypothesis
from truepose.calibration.fit import Calibration, joint_prior
from truepose.calibration.learnt import calibrated
from truepose.logs import Log
from truepose.robot import Robot

#: σ of a gain or an offset without uncertainty, which keeps a covariance regular.
EXACT = 1e-9
#: Step of central differences.
STEP = 1e-6


def as_read(fit: Calibration, of: Hypothesis) -> tuple[Calibration, Log]:
    """Return the calibration of the machine as it reads in the last row, and the log as it is read.

    Gains, offsets and gravity of the robot take what the mistakes changed for good: reading =
    factor · (gain · value - offset) + shift.
    """
    names, others, m = list(fit.names), list(fit.others), fit.robot.m
    acting = [
        (each, others.index(each.influences[-1].name) if each.influences else -1)
        for each in of.each
        if each.lasts is not None or each.leans
    ]
    if not acting:
        return fit, of.log
    known = [*fit.parameters.values(), *fit.others.values()]
    values, usual = np.array([(of.value, of.prior) for of in known]).T
    p = len(names)

    def change(amounts: Array) -> tuple[Array, Array]:
        factor, shift = np.ones(m + fit.robot.r), np.zeros(m + fit.robot.r)
        for each, k in reversed(acting):  # the mistake undone first acts last
            if each.lasts is None:
                continue
            if k < 0:
                scale, step = each.lasts, 0 * shift
            elif each.size and each.size.gain:
                scale, step = 1 + each.lasts * amounts[k] / (1 - amounts[k]), 0 * shift
            else:
                scale, step = 1 + 0 * factor, each.lasts * amounts[k]
            factor, shift = factor * scale, shift * scale + step
        return factor, shift

    factor, shift = change(values[p:])
    named = fit.robot.spec.of_motor
    keys = [(named(k, "gain"), named(k, "encoder_offset")) for k in range(m)]
    keys += [(f"{name}.gain", f"{name}.offset") for name in fit.robot.sensors]
    changed = [keys[k][0] for k in np.flatnonzero(factor != 1)]
    changed += [keys[k][1] for k in np.flatnonzero((factor != 1) | (shift != 0))]
    every = list(dict.fromkeys([*names, *changed]))
    q = len(every)

    def after(robot: Robot, unknowns: Array) -> Array:
        known = {name: robot.parameters[name].mean for name in every}
        known |= zip(names, unknowns[:p].tolist(), strict=True)
        by, step = change(unknowns[p:])
        for k, (gain, offset) in enumerate(keys):
            if gain in known:
                known[gain] *= by[k]
            if offset in known:
                known[offset] = by[k] * known[offset] - step[k]
        return np.array([*known.values(), *unknowns[p:]])

    def robot_of(robot: Robot, unknowns: Array, covariance: Array) -> tuple[Robot, Array, Array]:
        by = STEP * np.eye(len(unknowns))
        T = np.array([after(robot, unknowns + d) - after(robot, unknowns - d) for d in by]).T
        T /= 2 * STEP
        joint = T @ covariance @ T.T
        joint[range(p, q), range(p, q)] += EXACT**2
        sigma = sigmas_of(joint[:q, :q])
        root = sigma[:, None] * np.linalg.cholesky(joint[:q, :q] / np.outer(sigma, sigma))
        before = robot.spec.calibration
        result = calibrated(
            robot,
            dict(zip(every, after(robot, unknowns).tolist(), strict=False)),
            root,
            f"{before.source if before else ''}; as it reads in the log's last row",
            np.array([*before.model_error.values()]) if before else None,
        )
        for each, k in acting:
            result = each.leans(result, unknowns[p + k]) if each.leans else result
        return result, joint, T

    robot, joint, T = robot_of(fit.robot, values, fit.joint_covariance)
    prior, prior_covariance, _ = robot_of(fit.prior, usual, joint_prior(fit))
    readings = of.log.readings - sum(
        values[p + k] * np.asarray(each.influences[-1].pattern)
        for each, k in acting
        if k >= 0 and each.lasts is not None
    )
    seen = fit.registration
    fit = replace(
        fit,
        robot=robot,
        prior=prior,
        names=tuple(every),
        prior_covariance=prior_covariance[:q, :q],
        joint_covariance=joint,
        registration=seen and replace(seen, cross=T[:q, :p] @ seen.cross),
    )
    return fit, replace(of.log, readings=factor * readings + shift)
