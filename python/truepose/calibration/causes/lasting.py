"""The machine as it reads in a log's last row, where a mistake changed its readings for good."""

import itertools
from collections.abc import Iterator
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
    log, motor, others = of.given.log, fit.robot.spec.of_motor, fit.others
    if all(each.lasts is None and each.leans is None for each in of.each):
        return fit, log
    keys = [(motor(k, "gain"), motor(k, "encoder_offset")) for k in range(fit.robot.m)]
    keys += [(f"{name}.gain", f"{name}.offset") for name in fit.robot.sensors]
    parameters = list(dict.fromkeys([*fit.names, *itertools.chain(*keys)]))
    gains, offsets = np.array([[parameters.index(key) for key in pair] for pair in keys]).T
    every = [*parameters, *others]
    acting = [  # the mistake undone first acts last
        (each, every.index(each.influence) if each.influence else 0) for each in reversed(of.each)
    ]

    def kept(values: Array) -> Iterator[tuple[Array, Array]]:
        for each, k in acting:
            if each.lasts is None:
                continue
            one, none = np.ones(len(keys)), np.zeros(len(keys))
            if not each.influence:
                yield each.lasts, none
            elif each.size and each.size.gain:
                yield one + each.lasts * values[k] / (1 - values[k]), none
            else:
                yield one, each.lasts * values[k]

    def after(values: Array) -> Array:
        result = values.copy()
        for factor, shift in kept(values):
            result[gains] *= factor
            result[offsets] = factor * result[offsets] - shift
        return result

    def values_of(robot: Robot, amounts: list[float]) -> Array:
        return np.array([*(robot.parameters[name].mean for name in parameters), *amounts])

    values = values_of(fit.robot, [other.value for other in others.values()])
    uncertain = np.array([name in {*fit.names, *others} for name in every])
    some = np.flatnonzero(uncertain | (after(values) != values))
    names = [every[k] for k in some[: -len(others) or None]]
    p, q = len(fit.names), len(names)

    def robot_of(robot: Robot, values: Array, covariance: Array) -> tuple[Robot, Array, Array]:
        by = STEP * np.eye(len(values))[uncertain]
        T = np.array([after(values + d) - after(values - d) for d in by]).T[some] / (2 * STEP)
        joint = T @ covariance @ T.T + np.diag(EXACT**2 * ~uncertain[some])
        sigma = sigmas_of(joint[:q, :q])
        root = sigma[:, None] * np.linalg.cholesky(joint[:q, :q] / np.outer(sigma, sigma))
        before = robot.spec.calibration
        result = calibrated(
            robot,
            dict(zip(names, after(values)[some].tolist(), strict=False)),
            root,
            f"{before.source if before else ''}; as it reads in the log's last row",
            np.array([*before.model_error.values()]) if before else None,
        )
        for each, k in acting:
            result = each.leans(result, values[k]) if each.leans else result
        return result, joint, T

    robot, joint, T = robot_of(fit.robot, values, fit.joint_covariance)
    usual = values_of(fit.prior, [other.prior for other in others.values()])
    prior, prior_covariance, _ = robot_of(fit.prior, usual, joint_prior(fit))
    readings = log.readings.copy()
    for each, k in acting:
        if each.influence and each.lasts is not None:
            readings -= values[k] * np.asarray(each.given.influences[-1].pattern)
    for factor, shift in kept(values):
        readings = factor * readings + shift
    seen = fit.registration
    fit = replace(
        fit,
        robot=robot,
        prior=prior,
        names=tuple(names),
        prior_covariance=prior_covariance[:q, :q],
        joint_covariance=joint,
        registration=seen and replace(seen, cross=T[:q, :p] @ seen.cross),
    )
    return fit, replace(log, readings=readings)
