"""Calibration from differences between visited poses."""

import dataclasses

import numpy as np
import pytest
from fixtures import drawn_poses, refused
from posteriors import changes, maximum_a_posteriori

import truepose as tp
from truepose.calibration import (
    CalibrationOptions,
    DistanceMeasurements,
    PlaneContacts,
    RepeatedPoses,
)
from truepose.calibration.bound import after_visiting

TOOL = (0.01, -0.02, -0.03)


def printer():
    """A linear Delta whose motors are all that is read."""
    return tp.load("linear-delta").with_sensors()


def on_the_bed(rng, count, height=0.0):
    """Places on a bed of 100 mm radius."""
    radius, turn = 0.1 * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    z = np.full(count, height)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])


#: Prior σ of the differences' own unknowns: h, a and b of the bed, a print's scale and width.
FREE = np.array([0.01, 0.01, 0.01, 0.003, 0.2e-3])
NAMES = ["plane.height", "plane.slope.x", "plane.slope.y", "distances.scale", "distances.width"]


def printed(rng, x, own, sigma=2e-5):
    """Measure a print of the first 12 places, and touch the bed at all the others."""
    h, a, b, scale, width = own
    touched = np.arange(12, len(x))
    above = x[touched, 2] - h - x[touched, :2] @ (a, b) + sigma * rng.standard_normal(len(touched))
    pairs = np.array([(i, j) for i in range(12) for j in range(i) if (i + j) % 4 == 1])
    times = np.array([1.0, 0.0, -1.0])[np.arange(len(pairs)) % 3]
    length = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    measured = (1 + scale) * length + times * width + sigma * rng.standard_normal(len(pairs))
    return [
        PlaneContacts(
            lines=touched, sigma=sigma, above=above, height=(0, FREE[0]), slope_sigma=FREE[1]
        ),
        DistanceMeasurements(
            pairs=pairs,
            measured=measured,
            sigma=sigma,
            scale=(0, FREE[3]),
            width=(0, FREE[4]),
            times=times,
        ),
    ]


def test_it_is_the_maximum_a_posteriori_over_everything_at_once():
    """A hexapod's poses, geometry, plane, scale, width and tool's point against scipy's."""
    robot = tp.load("stewart").with_sensors("roll")
    rng = np.random.default_rng(8)
    x = drawn_poses(robot, 7, rng) * [1, 1, 1, 0.5, 0.5, 0.5]
    q_e = robot.sample(3).read(x)
    R = [frame[:3, :3] for frame in tp.robot.frames.frames(robot, x)]
    p = x[:, :3] + np.einsum("kij,j->ki", R, TOOL)
    pairs = np.array([(0, 1), (1, 2), (3, 1), (0, 4), (5, 6)])
    apart = p[pairs[:, 0]] - p[pairs[:, 1]]
    length = np.linalg.norm(apart, axis=1)
    plane = PlaneContacts(
        lines=[0, 2, 5],
        sigma=[1e-5, 2e-5, 1e-5],
        above=p[[0, 2, 5], 2] - 0.002 - 0.003 * p[[0, 2, 5], 0] + 3e-5 * rng.standard_normal(3),
        height=(0.0, 0.01),
        slope_sigma=0.01,
        tool=(0, 0, 0),
        tool_sigma=0.05,
    )
    distances = DistanceMeasurements(
        pairs=pairs,
        measured=0.997 * length + 4e-4 + 2e-5 * rng.standard_normal(5),
        sigma=2e-5,
        scale=(0.0, 0.005),
        width=(0.0, 1e-3),
        tool=(0, 0, 0),
        tool_sigma=0.05,
    )
    revisits = RepeatedPoses(pairs=[(6, 3)], apart=p[6] - p[3], sigma=5e-5)

    def further(w, x):
        p = x[:, :3] + np.einsum("kij,j->ki", tp.robot.frames.frames(robot, x)[:, :3, :3], w[:3])
        length = np.linalg.norm(p[pairs[:, 0]] - p[pairs[:, 1]], axis=1)
        height = p[[0, 2, 5], 2] - w[3] - p[[0, 2, 5], :2] @ w[4:6]
        return (
            (plane.above - height) / plane.sigma,
            (distances.measured - (1 + w[6]) * length - w[7]) / distances.sigma,
            (np.subtract(revisits.apart, x[6, :3] - x[3, :3])) / revisits.sigma,
        )

    free = [0.05, 0.05, 0.05, 0.01, 0.01, 0.01, 0.005, 1e-3]
    u, at, covariance, cost = maximum_a_posteriori(robot, q_e, free, further)
    measured = [plane, distances, revisits]
    options = CalibrationOptions(cause="ignore", loss="squares")  # one revisit contradicts all
    fit = tp.calibrate(robot, q_e, differences=measured, options=options)
    tool, bed = ("tool.x", "tool.y", "tool.z"), ("height", "slope.x", "slope.y")
    own = [*tool, *(f"plane.{name}" for name in bed), "distances.scale", "distances.width"]
    assert list(fit.others) == own
    change, stated = changes(fit)
    assert change == pytest.approx(u, abs=2e-4)
    assert fit.x == pytest.approx(at, abs=3e-7)
    assert fit.cost == pytest.approx(cost, rel=1e-6)
    assert stated == pytest.approx(covariance, abs=2e-4)


def scene(seed, count=40):
    """A printer, the poses of a log of it, its readings, and what its owner measured."""
    robot, rng = printer(), np.random.default_rng(seed)
    true = robot.sample(seed)
    own = FREE * rng.standard_normal(5)
    x = on_the_bed(rng, count)
    x[12:, 2] = own[0] + x[12:, :2] @ own[1:3]
    return robot, true, true.read(x), own, printed(rng, x, own)


def test_a_printer_learns_from_touches_and_callipers_alone():
    """Its parameters, the bed's and the print's, are all within the covariance that is stated."""
    nees = []
    for seed in range(25):
        robot, true, q_e, own, differences = scene(seed)
        fit = tp.calibrate(robot, q_e, differences=differences)
        between, unknowns = fit.differences, fit.differences.unknowns
        assert list(unknowns) == [NAMES[k] for k in range(5)] and not between.doubt
        error = [p.value - true.parameters[name].value for name, p in fit.parameters.items()]
        error = np.array([*error, *([p.value for p in unknowns.values()] - own)])
        nees.append(error @ np.linalg.solve(fit.joint_covariance, error))
        sizes = [(of.left_out / of.left_out_sigma) ** 2 for of in between.each]
        assert 0.5 < np.mean(sizes) < 2
    freedoms = len(error)
    assert np.mean(nees) / freedoms == pytest.approx(1, abs=4 * np.sqrt(2 / freedoms / len(nees)))


def test_the_bound_says_beforehand_what_differences_will_teach():
    robot, _, _, _, _ = scene(0)
    x = on_the_bed(np.random.default_rng(1), 40)
    differences = printed(np.random.default_rng(1), x, np.zeros(5))
    exact = robot.expected().extended_positions(x)
    fit = tp.calibrate(robot, exact, differences=differences)
    root = after_visiting(robot, x, "full", differences=differences)
    scale = np.sqrt(np.outer(*2 * [np.diag(fit.covariance)]))
    assert (root @ root.T) / scale == pytest.approx(fit.covariance / scale, abs=2e-3)
    alone, after = (
        np.trace(tp.accuracy(robot, x[:5], **kwargs), axis1=1, axis2=2)
        for kwargs in ({}, {"calibrated_on": x, "differences": differences})
    )
    assert (after < 0.2 * alone).all()


def test_a_print_that_shrank_and_arms_that_are_long_are_told_apart_by_touches_only_in_part():
    """The scale of all arms and the print's shrinkage: among the combinations known least."""
    robot, _, q_e, _, differences = scene(2)
    fit = tp.calibrate(robot, q_e, differences=differences)
    terms = [set(terms) for _, terms in fit.worst_known(40)]
    assert any("distances.scale" in some for some in terms)


@pytest.mark.parametrize("loss", ["squares", "student"])
def test_a_calliper_typed_wrong_is_named(loss):
    robot, _, q_e, _, (plane, distances) = scene(4)
    measured = distances.measured.copy()
    measured[5] += 0.010
    wrong = dataclasses.replace(distances, measured=measured)
    fit = tp.calibrate(
        robot, q_e, differences=[plane, wrong], options=CalibrationOptions(loss=loss)
    )
    i, j = distances.pairs[5]
    (doubt,) = fit.differences.doubt
    start = f"distances: {1e3 * measured[5]:.3f} mm, lines {i} and {j}: +"
    assert doubt.startswith(start) and any(note.startswith(start) for note in fit.notes)
    off = fit.differences.found[1]
    assert abs(off.left_out[5] - 0.010) < 4 * off.left_out_sigma[5]
    if loss == "student":
        assert off.weight[5] < 0.1
        right = tp.calibrate(
            robot, q_e, differences=[plane, distances], options=CalibrationOptions(loss=loss)
        )
        for name, p in right.parameters.items():
            assert abs(fit.parameters[name].value - p.value) < 0.3 * p.sigma


def test_without_readings_of_a_line_its_differences_are_left_out():
    robot, _, q_e, _, differences = scene(7)
    q_e[3, 0] = np.nan
    fit = tp.calibrate(robot, q_e, differences=differences)
    gone = (differences[1].pairs == 3).any(axis=1)
    assert gone.any() and (np.isnan(fit.differences.found[1].residual) == gone).all()


LINES = np.arange(12, 40)


@pytest.mark.parametrize(
    ("difference", "message"),
    [
        (
            PlaneContacts(lines=[40], sigma=1e-5),
            r"^plane: lines: line 40: must be 0 to 39$",
        ),
        (
            PlaneContacts(lines=[0.5], sigma=1e-5),
            r"^plane: lines: must be numbers of lines from 0",
        ),
        (
            PlaneContacts(lines=LINES, sigma=0),
            r"^plane: sigma = 0: must be greater than 0",
        ),
        (
            PlaneContacts(lines=LINES, sigma=1, above=[1, 2]),
            r"^plane: above: must be a number or",
        ),
        (PlaneContacts(lines=LINES, sigma=1, axis="w"), r"^plane: unknown axis 'w'"),
        (
            PlaneContacts(lines=LINES, sigma=1, height=(0, -1)),
            r"^plane: height: σ = -1",
        ),
        (
            DistanceMeasurements(pairs=[(1, 1)], measured=[1], sigma=1),
            r"^distances: pairs: line 1 twice",
        ),
        (
            DistanceMeasurements(pairs=[(1, 2)], measured=[-1], sigma=1),
            r"^distances: measured = -1",
        ),
        (
            RepeatedPoses(pairs=[1, 2], sigma=1),
            r"^revisits: pairs: must be numbers of lines",
        ),
        (
            "plane",
            r"^differences: str: must be a PlaneContacts, DistanceMeasurements or RepeatedPoses$",
        ),
    ],
)
def test_wrong_differences_are_refused_in_one_line(difference, message):
    robot, _, q_e, _, _ = scene(0)
    with refused(message):
        tp.calibrate(robot, q_e, differences=[difference])
