"""The machine as it reads in a log's last row, where a mistake changed its readings for good."""

from dataclasses import replace

import numpy as np

from truepose.arguments import Array, sigmas_of
from truepose.calibration.causes.hypothesis import Hypothesis
from truepose.calibration.fit import Calibration, joint_prior
from truepose.logs import Log
from truepose.robot import Robot
from truepose.robotfile.schema import CalibrationSection

#: σ of a gain or an offset without uncertainty, which keeps a covariance regular.
EXACT = 1e-9
#: Step of central differences.
STEP = 1e-6


def as_read(fit: Calibration, of: Hypothesis) -> tuple[Calibration, Log]:
    """Return the calibration of the machine as it reads in the last row, and the log as it is read.

    Gains, offsets and gravity of the robot take what the mistakes changed for good: reading =
    factor · (gain · value - offset) + shift.
    """
    names, others = list(fit.names), list(fit.others)
    p, width = len(names), fit.robot.m + fit.robot.r
    acting = [
        (each, others.index(each.influences[-1].name) if each.influences else -1)
        for each in of.each
        if each.reads or each.leans
    ]
    if not acting:
        return fit, of.log

    def change(amounts: Array) -> tuple[Array, Array]:
        factor, shift = np.ones(width), np.zeros(width)
        for each, k in reversed(acting):  # the mistake undone first acts last
            if each.reads:
                scale, step = each.reads(amounts[k] if k >= 0 else 0.0)
                factor, shift = factor * scale, shift * scale + step
        return factor, shift

    amounts = np.array([known.value for known in fit.others.values()])
    factor, shift = change(amounts)
    named = fit.robot.spec.of_motor
    motors = [(named(k, "gain"), named(k, "encoder_offset")) for k in range(fit.robot.m)]
    keys = [*motors, *((f"{name}.gain", f"{name}.offset") for name in fit.robot.sensors)]
    scaled = [name for k in np.flatnonzero(factor != 1) for name in keys[k]]
    moved = [keys[k][1] for k in np.flatnonzero(shift)]
    every = list(dict.fromkeys([*names, *scaled, *moved]))

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
        own = [name not in names for name in every]
        joint[range(len(own)), range(len(own))] += EXACT**2 * np.array(own)
        block = joint[: len(every), : len(every)]
        sigma = sigmas_of(block)
        root = sigma[:, None] * np.linalg.cholesky(block / np.outer(sigma, sigma))
        learnt = robot.spec.calibration or CalibrationSection(parameters=(), mean=(), root=())
        section = learnt.model_copy(
            update={
                "source": f"{learnt.source}; as it reads in the log's last row",
                "parameters": tuple(every),
                "mean": tuple(after(robot, unknowns)[: len(every)].tolist()),
                "root": tuple(tuple(row[: k + 1]) for k, row in enumerate(root.tolist())),
            }
        )
        robot = robot.with_calibration(section)
        for each, k in acting:
            robot = each.leans(robot, unknowns[p + k]) if each.leans else robot
        return robot, joint, T

    values = np.array([*(fit.robot.parameters[name].value for name in names), *amounts])
    usual = [
        *(fit.prior.parameters[n].mean for n in names),
        *(o.prior for o in fit.others.values()),
    ]
    robot, joint, T = robot_of(fit.robot, values, fit.joint_covariance)
    prior, prior_covariance, _ = robot_of(fit.prior, np.array(usual), joint_prior(fit))
    readings = of.log.readings - sum(
        amounts[k] * np.asarray(each.influences[-1].pattern)
        for each, k in acting
        if k >= 0 and each.reads
    )
    q = len(every)
    fit = replace(
        fit,
        robot=robot,
        prior=prior,
        names=tuple(every),
        covariance=joint[:q, :q],
        prior_covariance=prior_covariance[:q, :q],
        beside=joint[q:],
        registration=fit.registration
        and replace(fit.registration, cross=T[:q, :p] @ fit.registration.cross),
    )
    return fit, replace(of.log, readings=factor * readings + shift)
