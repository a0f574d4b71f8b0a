"""Results of functions of a robot, a design and a calibration, as they were before."""

import numpy as np
import pytest
from answers import answer, some, tried

import truepose as tp


@pytest.mark.parametrize("name", ["h4", "delta", "stewart", "neck", "3rrr"])
def test_kinematics(kept, name):
    robot = (
        tp.load(name).with_file(conditions=None).sample(1).with_level(None)
    )  # each method at its own level
    x = some(robot)
    q, found = robot.ikm(x), {}
    for method in (
        "jacobian",
        "conditioning",
        "extended_positions",
        "linearize",
        "tej",
        "gyro",
        "residual_motion",
        "rod_forces",
        "weighted_tej",
        "skeleton",
        "mass_matrix",
    ):
        found[method] = tried(getattr(robot, method), x)
    torque = np.linspace(-1, 2, robot.n)
    for method in ("motor_torque", "joint_torque"):
        found[method] = tried(getattr(robot, method), x, torque)
    rate, speed = np.linspace(-0.3, 0.2, robot.n), np.linspace(-1, 2, robot.n)
    found["inverse_dynamics"] = tried(robot.inverse_dynamics, x, rate, speed)
    found["acceleration"] = tried(robot.acceleration, x, rate, torque)
    for law in ("joint", "tej", "cartesian", "weighted", "estimated"):
        found[law] = tried(robot.cross_sensitivity, x, law)
    found |= {"q": q, "fkm": robot.fkm(q), "read": robot.read(x, seed=3), "rkm": robot.rkm(x)}
    found["estimate"] = robot.estimate(robot.read(x, seed=3))
    found["ideal"] = robot.with_level("ideal").fkm(q)
    found["assembly_modes"] = tried(robot.with_level("ideal").assembly_modes, q[0], 300)
    kept(answer(found))


@pytest.mark.parametrize("name", ["h4", "par4", "neck", "3rpr", "linear-delta"])
def test_robot(kept, name):
    robot = tp.load(name).with_file(conditions=None).sample(2)
    found = {
        "table": robot.table(),
        "sigma": robot.reading_sigma,
        "resolution": robot.resolution,
        "expected": robot.expected(),
        "sample": robot.sample(4),
        "payload": tried(robot.with_payload, (1.0, -2.0, -30.0)),
    }
    kept(answer(found))


@pytest.mark.parametrize("case", ["known", "tracker", "contacts", "plain", "homings", "rehomed"])
def test_calibration_of(kept, h4, case):
    h4 = h4.with_sensors("theta", "z_telemeter")
    truth, x, of = h4.sample(5), some(h4, 20), tp.calibration
    q_e, options = truth.read(x, seed=6), {}
    if case == "known":
        how = of.CalibrationOptions(registration="known")
        options = {"measured": x, "measured_sigma": 5e-5, "options": how}
    elif case == "tracker":
        options = {
            "measured": x + np.array([1.0, 2.0, 0.5, 0.0]),
            "measured_sigma": 2e-5,
            "options": of.CalibrationOptions(
                measured_angle_sigma=1e-3, registration=of.Registration(), level="full"
            ),
        }
    elif case == "contacts":
        options = {
            "differences": [
                of.PlaneContacts(
                    lines=[0, 3, 5, 7],
                    above=x[[0, 3, 5, 7], 2],
                    sigma=2e-5,
                    slope_sigma=0.01,
                    tool=(0, 0, -0.02),
                    tool_sigma=1e-3,
                ),
                of.RepeatedPoses(
                    pairs=[(1, 2), (4, 6)], apart=x[[1, 4], :3] - x[[2, 6], :3], sigma=5e-5
                ),
                of.DistanceMeasurements(
                    pairs=[(8, 9), (10, 11)],
                    sigma=3e-5,
                    scale=(0.0, 1e-3),
                    measured=np.linalg.norm(x[[8, 10], :3] - x[[9, 11], :3], axis=1),
                ),
            ]
        }
    elif case == "homings":
        earlier = of.homings(h4, np.repeat([0, 1], 10), 0.01)
        options = {"influences": earlier, "options": of.CalibrationOptions()}
    elif case == "rehomed":
        h4 = of.rehomed(tp.calibrate(h4, truth.read(some(h4, 30, 7), seed=7)).robot, 0.02)
    fit = tp.calibrate(h4, q_e, **options)
    kept(answer([fit, fit.robot]))


def test_accuracy_of(kept, h4):
    h4 = h4.with_sensors("theta", "z_telemeter")
    x, found = some(h4, 4), {}
    for name, options in {
        "built": {},
        "calibrated": {"calibrated_on": some(h4, 12, 4), "relative_to": h4.home},
        "referenced": {"reference_pose": h4.home, "reference_sigma": 1e-4, "level": "ideal"},
        "bare": {"model_error": False, "level": "ideal"},
    }.items():
        found[name] = tp.accuracy(h4, x, **options)
    found["table"] = found["calibrated"].table()
    kept(answer(found))


def test_planned_poses(kept, h4):
    h4, design = h4.sample(1).with_level(None), tp.design
    candidates = some(h4, 40, 3)

    def use(**known):
        return design.Use(poses=some(h4, 8), **known)

    plan = tp.plan_poses(h4, 5, candidates=candidates, use=use(reference_pose=h4.home))
    measured = design.CandidatePoses(
        poses=candidates, measured_sigma=3e-5, measured_angle_sigma=1e-3
    )
    seen = tp.plan_poses(h4, 4, candidates=measured, use=use(), seen=True)
    fit = tp.calibrate(h4, h4.sample(3).read(some(h4, 12, 9), seed=3))
    after = tp.plan_poses(h4, 4, candidates=candidates, after=fit, use=use())
    kept(answer([plan, seen, after, plan.table()]))


def test_selected_sensors(kept, h4):
    prices = {s.name: 50.0 + 7 * k for k, s in enumerate(h4.spec.sensor)}
    of = tp.design.Use
    found = [
        tp.select_sensors(h4, prices, use=of(poses=some(h4, 8)), budget=200.0),
        tp.select_sensors(h4, prices, use=of(poses=some(h4, 8)), target=2.5e-3, survives=True),
        tp.select_sensors(
            h4,
            prices,
            must=["theta"],
            budget=170.0,
            use=of(
                poses=some(h4, 8),
                calibrated_on=some(h4, 10, 4),
                reference_pose=h4.home,
                reference_sigma=1e-4,
            ),
        ),
    ]
    kept(answer([*found, found[0].table()]))


def test_studies(kept):
    found = [
        tp.monte_carlo("rest", ["h4", "delta"], 3, grid={"law": ["joint"]}, workers=0, seed=2),
        tp.monte_carlo("calibration", "x1-ankle", 3, grid={"poses": [6]}, workers=0),
    ]
    kept(answer([[study.columns, study.table()] for study in found]))
