"""Results of functions whose numbers no command prints, as they were before."""

import numpy as np
import pytest
from answers import answer, page

import truepose as tp


def some(robot, count=3, seed=1):
    """Return poses of a robot's workspace."""
    box = robot.spec.workspace
    low, high = np.array(box.minimum), np.array(box.maximum)
    return np.random.default_rng(seed).uniform(
        0.8 * low + 0.2 * high, 0.2 * low + 0.8 * high, (count, robot.n)
    )


def tried(function, *words, **options):
    """Return an answer, or the message of its refusal."""
    try:
        return function(*words, **options)
    except tp.TrueposeError as error:
        return str(error)


@pytest.mark.parametrize("name", ["h4", "delta", "par4", "stewart", "neck", "3rrr"])
def test_kinematics(kept, name):
    robot = tp.load(name).sample(1)
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


@pytest.mark.parametrize("name", ["h4", "par4", "neck", "3rpr", "stewart", "linear-delta"])
def test_drawing(kept, name):
    robot = tp.load(name).sample(2)
    found = {"plot": robot.plot(some(robot, 1)[0]), "table": robot.table()}
    found |= {"sigma": robot.reading_sigma, "resolution": robot.resolution}
    found |= {
        "expected": robot.expected(),
        "sample": robot.sample(4),
        "payload": tried(robot.with_payload, (1.0, -2.0, -30.0)),
        "gravity": robot.with_gravity((1.0, 0.0, -9.0)),
    }
    kept(answer(found))


@pytest.mark.parametrize("name", ["h4", "neck", "stewart"])
def test_effects(kept, name):
    robot, effects = tp.load(name), tp.Effects()
    found = {"warm": effects.geometry(robot, 1800.0, seed=2), "growth": effects.growth(robot)}
    found["allowed"] = effects.allowed_for(robot)
    for group in tp.Effects.groups():
        found[group] = effects.only(group).allowed_for(robot)
    kept(answer(found))


def delayed(robot, *names):
    """Return a robot whose sensors are slow and delayed."""
    sensors = tuple(
        s.model_copy(update={"sample_period": 0.004, "latency": 0.006}) if s.name in names else s
        for s in robot.spec.sensor
    )
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors})).with_sensors(*names)


@pytest.mark.parametrize("law", ["joint", "tej", "cartesian", "weighted", "estimated"])
def test_laws(kept, law):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    truth, found = h4.sample(3), {}
    controller = tp.Controller(law=law, integral=2.0, gains="diagonal", feed_forward="gravity")
    for name, options in {
        "plain": {"hold": 0.02},
        "integral": {"controller": controller, "hold": 0.02},
        "effects": {"effects": tp.Effects(), "time": 600.0, "hold": 0.02, "seed": 3},
    }.items():
        found[name] = tried(tp.simulate, h4, truth, **{"controller": law, **options})
    slow = delayed(tp.load("h4"), "theta", "z_telemeter")
    found["delayed"] = tp.simulate(slow, slow.sample(3), law, hold=0.02, effects=tp.Effects())
    found["neck"] = tp.simulate(tp.load("neck"), tp.load("neck").sample(3), law, hold=0.02)
    kept(answer({name: numbers(run) for name, run in found.items()}))


def numbers(run):
    """Return the arrays of a simulation, and what it says."""
    if isinstance(run, str):
        return run
    return [run.x, run.torque, run.q_e.ravel(), run.motor_error.ravel(), run.status, run.table()]


@pytest.mark.parametrize("name", ["h4", "stewart", "3rrr", "neck"])
def test_steady_state(kept, name):
    robot = tp.load(name)
    truth, x, found = robot.sample(2), some(robot, 4), {}
    for law in ("joint", "tej", "cartesian", "weighted", "estimated"):
        found[law] = tried(tp.steady_state, robot, truth, x, law)
    found["gravity"] = tried(tp.steady_state, robot, truth, x, gravity=True)
    kept(answer(found))


def test_path_accuracy(kept):
    h4, delta = tp.load("h4"), tp.load("delta")
    circle = tp.simulation.Circle(centre=h4.home, radius=0.05, frequency=1.5, turns=1.2)
    line = tp.simulation.Line(start=some(delta)[0], end=some(delta)[1], duration=0.3)
    way = tp.simulation.Waypoints(poses=some(delta, 4), duration=0.2)
    found = {
        "circle": tp.simulation.path_accuracy(h4, circle, h4.sample(2), runs=3, points=40),
        "speed": tp.simulation.path_accuracy(h4, circle, h4.sample(2), speed=0.5, runs=2),
        "line": tp.simulation.path_accuracy(
            delta, line, delta.sample(2), runs=3, points=40, effects=tp.Effects()
        ),
        "way": tp.simulation.path_accuracy(delta, way, delta.sample(2), runs=2, points=40),
    }
    found |= {f"table {name}": result.table() for name, result in found.items()}
    kept(answer(found))


@pytest.mark.parametrize("law", ["joint", "tej", "weighted"])
def test_margins_of(kept, law):
    h4 = tp.load("h4").sample(2)
    slow = delayed(tp.load("h4"), "theta").sample(2)
    found = {}
    for name, robot, effects in (
        ("h4", h4, None),
        ("slow", slow, tp.Effects()),
        ("neck", tp.load("neck").sample(2), tp.Effects().only("delay")),
    ):
        asked = tp.Controller(law=law, frequency=50, velocity_bandwidth=400, damping=0.8)
        margins = tp.control.stability_margins(robot, asked, effects, poses=some(robot, 2))
        found[name] = [margins.loops, margins.loci, margins.dither, margins.limit_cycle]
        found[f"{name} shown"] = [margins.stable, margins.table()]
    found["chosen"] = tried(
        tp.Controller.for_robot, h4, tp.Effects().only("delay", "friction"), law
    )
    kept(answer(found))


@pytest.mark.parametrize("name", ["h4", "x1-ankle"])
def test_detectability(kept, name):
    robot = tp.load(name)
    found = tp.faults.detectability(robot, some(robot, 6), false_alarm=1e-4, power=0.8, moving=30)
    after = tp.faults.detectability(robot, some(robot, 6), some(robot, 12, 5), level="ideal")
    kept(answer([found, found.table(), after]))


@pytest.mark.parametrize("fault", ["theta:bias=0.03", "q2:gain=1.02", "z_telemeter:sign", ""])
def test_isolation_of(kept, fault):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter", "wire1", "wire2")
    q_e = h4.sample(3).read(some(h4, 15), seed=2)
    k = h4.readings.index(fault.partition(":")[0]) if fault else 0
    q_e[:, k] = {"b": q_e[:, k] + 0.03, "g": 1.02 * q_e[:, k], "s": -q_e[:, k], "": q_e[:, k]}[
        fault.partition(":")[2][:1]
    ]
    kept(answer(tp.faults.isolate(h4, q_e)))


@pytest.mark.parametrize(
    "fault",
    [
        "theta:stuck@0.08",
        "q2:bias=0.05@0.05",
        "z_telemeter:dropout@0.1",
        "theta:spike=0.2@0.1",
        "q1:drift=1@0.02",
        "wire1:delay=0.01@0.05",
    ],
)
def test_fault_monitor(kept, fault):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter", "wire1")
    reading, _, rest = fault.partition(":")
    kind, _, rest = rest.partition("@")
    kind, _, size = kind.partition("=")
    asked = tp.faults.Fault(reading, kind, at=float(rest), size=float(size) if size else None)
    monitor, found = tp.FaultMonitor(effects=tp.Effects().only("delay")), {}
    law = {"q1": "tej", "q2": "weighted", "wire1": "estimated"}.get(reading, "joint")
    run = tp.simulate(h4, h4.sample(2), law, faults=[asked], watch=monitor, hold=0.1)
    found["run"] = [*numbers(run), run.health.sum(axis=0), run.stops.sum(), run.symptom.sum(axis=0)]
    found["review"] = monitor.review(h4, run.q_e[:120], run.x_d[:120])
    kept(answer(found))


def test_online(kept):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    q_e = h4.sample(5).read(some(h4, 25), seed=6)
    found = {}
    for name, options in {
        "plain": {},
        "drift": {"drift": {"chain1.encoder_offset": 1e-6, "theta.offset": 1e-6}},
        "ideal": {"level": "ideal", "model_error": "off", "gate": 3.0},
    }.items():
        online = tp.OnlineCalibrator(h4, **options)
        before = online.observe(q_e[:20])
        wrong = online.observe(q_e[20:] + np.array([0, 0.1, 0, 0, 0, 0]))
        online.replay(q_e[:20], 1)
        found[name] = [before, wrong, online, online.robot]
    kept(answer(found))


@pytest.mark.parametrize("case", ["known", "tracker", "contacts", "loads", "homings", "rehomed"])
def test_calibration_of(kept, case):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    truth, x, of = h4.sample(5), some(h4, 20), tp.calibration
    q_e, options = truth.read(x, seed=6), {}
    if case == "known":
        options = {"measured": x, "measured_sigma": 5e-5, "registration": "known", "loss": "huber"}
    elif case == "tracker":
        options = {
            "measured": x + np.array([1.0, 2.0, 0.5, 0.0]),
            "measured_sigma": 2e-5,
            "measured_angle_sigma": 1e-3,
            "registration": of.Registration(),
            "level": "full",
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
    elif case == "loads":
        options = {"loads": of.Payloads(force=np.tile([0, 0, -20.0], (20, 1)))}
    elif case == "homings":
        options = {"influences": of.homings(h4, np.repeat([0, 1], 10), 0.01), "loss": "student"}
    elif case == "rehomed":
        h4 = of.rehomed(tp.calibrate(h4, truth.read(some(h4, 30, 7), seed=7)).robot, 0.02)
    fit = tp.calibrate(h4, q_e, **options)
    shown = fit.plot() if case == "tracker" else ""
    kept(answer([fit, fit.robot, shown]))


def test_accuracy_of(kept):
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
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


def test_planned_poses(kept):
    h4, design = tp.load("h4").sample(1), tp.design
    candidates = some(h4, 40, 3)
    plan = tp.plan_poses(h4, 5, candidates=candidates, poses=some(h4, 8), reference_pose=h4.home)
    measured = design.CandidatePoses(
        poses=candidates, measured_sigma=3e-5, measured_angle_sigma=1e-3
    )
    seen = tp.plan_poses(h4, 4, candidates=measured, poses=some(h4, 8), seen=True)
    fit = tp.calibrate(h4, h4.sample(3).read(some(h4, 12, 9), seed=3))
    after = tp.plan_poses(h4, 4, candidates=candidates, after=fit, poses=some(h4, 8))
    kept(answer([plan, seen, after, plan.table()]))


def test_selected_sensors(kept):
    h4 = tp.load("h4")
    prices = {s.name: 50.0 + 7 * k for k, s in enumerate(h4.spec.sensor)}
    found = [
        tp.select_sensors(h4, prices, poses=some(h4, 8), budget=200.0),
        tp.select_sensors(h4, prices, poses=some(h4, 8), target=2.5e-3, survives=True),
        tp.select_sensors(
            h4,
            prices,
            poses=some(h4, 8),
            calibrated_on=some(h4, 10, 4),
            must=["theta"],
            budget=170.0,
            reference_pose=h4.home,
            reference_sigma=1e-4,
        ),
    ]
    kept(answer([*found, found[0].table()]))


@pytest.mark.parametrize("name", ["h4", "linear-delta"])
def test_compliance(kept, name):
    robot = tp.load(name)
    chains = tuple(
        c.model_copy(
            update={"rod_compliance": 2e-7, "motor_compliance": 1e-5}
            if hasattr(c, "rod_compliance")
            else {}
        )
        for c in robot.spec.chain
    )
    soft = tp.Robot(robot.spec.model_copy(update={"chain": chains}))
    x = some(soft)
    found = {
        "compliant": soft.is_compliant,
        "compliance": soft.compliance,
        "stiff": soft.stiff.fkm(soft.ikm(x)),
        "fkm": tried(soft.fkm, soft.ikm(x)),
        "loaded": tried(soft.with_payload((0.0, 0.0, -50.0)).ikm, x),
        "sigma": tried(tp.accuracy, soft, x),
    }
    kept(answer(found))


@pytest.mark.parametrize("name", ["3rpr", "h4", "neck"])
def test_mujoco(kept, name):
    plant = pytest.importorskip("truepose.integrations.mujoco.plant").MujocoPlant
    robot = tp.load(name)
    truth = robot.sample(1)
    x = some(robot, 2)
    held = plant(truth).settle_at(truth.ikm(x))
    brief = plant(truth, tp.Effects(), hold=0.05, longest=0.05, duration=0.1, seed=2)
    found = brief.visit(robot, x[:1], tp.Controller.for_robot(robot, tp.Effects(), law="joint"))
    kept(answer([held.frame, held.x, found.x, found.q_e]))


def test_studies(kept):
    found = [
        tp.monte_carlo("rest", ["h4", "delta"], 3, grid={"law": ["joint"]}, workers=0, seed=2),
        tp.monte_carlo("calibration", "x1-ankle", 3, grid={"poses": [6]}, workers=0),
    ]
    kept(answer([[study.columns, study.table()] for study in found]))


def test_workbench_state(kept):
    from truepose.integrations.workbench import answers, motion, playback, state, words

    h4 = tp.load("h4")
    now = state.begin(h4).with_drawn_errors(seed=1).sent([0.03, -0.05, -0.42, 0.2])
    rests, bounds = answers.rests(now), answers.bounds(now.robot)
    run = motion.run(now, "tej", [tp.faults.Fault("theta", "stuck", at=0.2)])
    played = playback.calibrated(playback.simulated_log(now, poses=20))
    covariance = answers.covariance(now, "as built")
    found = [
        rests,
        bounds,
        answers.conditioning_map(now, points=7),
        numbers(run),
        answers.ellipsoid(h4, covariance)[0],
        answers.position_error(now, "tej", some(h4)),
        answers.predicted(h4, some(h4), some(h4, 8)),
        answers.skeletons(now, h4.home, 5.0),
        state.pose_range(h4),
        state.motor_range(h4),
        now.errors,
        state.groups(h4),
        [played.before.residual, played.after.residual, played.pose(3)],
    ]
    colours = dict.fromkeys(rests, "#123456")
    pages = [
        words.laws(rests, colours),
        words.pose(now, 20.0),
        words.accuracy(h4, bounds),
        words.bill(h4, answers.price(h4)),
        words.errors(now),
        words.residuals(played, 2),
        words.conditioning(h4.conditioning(now.x_d)),
        words.lights(motion.lights(run, 300)),
    ]
    kept(answer(found) + "\n".join(map(page, pages)))


def test_paper(kept, h4, truth, table2):
    from truepose.paper import article, experiment, twin, virtual_experiment
    from truepose.paper.vision import Setup, Vision

    x = table2[::40]
    found = experiment.run(h4, experiment.draw_robots(h4, 2, seed=3), x)
    held = twin.shipped()
    seen = virtual_experiment.run(held.plant(), h4, Vision(Setup()), x[:4])
    printed = [
        article.table3(),
        article.table3_as_printed(),
        article.simulation_errors(),
        twin.printed(),
        held.truth,
        held.setup,
    ]
    runs = [[run.measured, run.estimated, run.q_e] for run in seen.values()]
    kept(
        answer(
            [
                found.errors,
                found.tables,
                experiment.theta_law(h4, x),
                runs,
                printed,
                [article.paper_directions(h4, k) for k in range(2)],
            ]
        )
    )
