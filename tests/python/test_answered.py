"""After a calibration every robot's estimates converge, whichever of its sensors are in use."""

import numpy as np
import pytest
from fixtures import drawn_poses

import truepose as tp

CALIBRATED_ON = 60


def sets(name):
    """Return the sensor sets of a robot: each alone, all, its own, those of the pages."""
    robot = tp.load(name)
    known = tuple(sensor.name for sensor in robot.spec.sensor)
    pages: list[tuple[str, ...]] = []
    if name == "h4":
        elbows, wires = (tuple(k for k in known if k.startswith(s)) for s in ("elbow", "wire"))
        others = (("z_telemeter",), elbows, wires, ("pivot2",), ("pivot2", "z_telemeter"))
        pages = [("theta", *more) for more in others]
    return sorted({s for s in [*((k,) for k in known), known, robot.sensors, *pages] if s})


def poses_of(true, count, seed):
    """Return poses of the workspace that the true robot reaches."""
    x = drawn_poses(true, 2 * count, seed)
    return x[np.isfinite(true.ikm(x, errors="nan")).all(axis=1)][:count]


@pytest.mark.parametrize(
    ("name", "sensors"), [(name, used) for name in tp.list_robots() for used in sets(name)]
)
def test_every_estimate_of_a_calibrated_robot_converges(name, sensors, request):
    """Noise-free readings and counts, 400 of each set; --count 10000 for the whole check."""
    count = request.config.getoption("--count") or 400
    robot = tp.load(name).with_sensors(*sensors)
    true = robot.sample(np.random.SeedSequence(17)).with_level(robot.highest_level)
    known = tp.calibrate(robot, true.read(poses_of(true, CALIBRATED_ON, 0), seed=1)).robot
    x = poses_of(true, count // 2, 1)
    for readings in (true.extended_positions(x), true.read(x, seed=2)):
        answer = known.estimate(readings, guess=x, errors="nan")
        lost = np.flatnonzero(answer.status != "ok")
        assert not len(lost), (answer.status[lost[0]], x[lost[0]], len(lost))


@pytest.mark.parametrize("sensors", [("theta",), ("theta", "z_telemeter")])
def test_a_par4_that_was_calibrated_comes_to_rest_under_its_estimates(sensors):
    robot = tp.load("par4").with_sensors(*sensors)
    true = robot.sample(np.random.SeedSequence(17)).with_level("full")
    known = tp.calibrate(robot, true.read(poses_of(true, CALIBRATED_ON, 0), seed=1)).robot
    x = poses_of(true, 50, 1)
    assert np.isfinite(tp.steady_state(known, true, x, "estimated")).all()
