"""Results of laws, margins, moves and faults, as they were before."""

import numpy as np
import pytest
from answers import answer, numbers, some, tried

import truepose as tp


@pytest.mark.parametrize("name", ["h4", "neck", "stewart"])
def test_effects(kept, name):
    robot, effects = tp.load(name).with_file(conditions=None), tp.Effects()
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
def test_laws(kept, h4, law):
    h4 = h4.with_sensors("theta", "z_telemeter")
    truth, found = h4.sample(3), {}
    controller = tp.Controller(law=law, integral=2.0, gains="diagonal", feed_forward="gravity")
    for name, options in {
        "plain": {"hold": 0.02},
        "integral": {"controller": controller, "hold": 0.02},
        "effects": {"effects": tp.Effects(), "time": 600.0, "hold": 0.02, "seed": 3},
    }.items():
        found[name] = tried(tp.simulate, h4, truth, **{"controller": law, **options})
    slow = delayed(h4, "theta", "z_telemeter")
    found["delayed"] = tp.simulate(
        slow, slow.sample(3), law, effects=tp.Effects(), run=tp.simulation.Run(hold=0.02)
    )
    found["neck"] = tp.simulate(
        tp.load("neck"), tp.load("neck").sample(3), law, run=tp.simulation.Run(hold=0.02)
    )
    kept(answer({name: numbers(run) for name, run in found.items()}))


@pytest.mark.parametrize("name", ["h4", "stewart", "neck"])
def test_steady_state(kept, name):
    robot = tp.load(name).with_file(conditions=None)
    truth, x, found = robot.sample(2), some(robot, 4), {}
    for law in ("joint", "tej", "cartesian", "weighted", "estimated"):
        found[law] = tried(tp.steady_state, robot, truth, x, law)
    found["gravity"] = tried(tp.steady_state, robot, truth, x, gravity=True)
    kept(answer(found))


def test_path_accuracy(kept, h4):
    delta = tp.load("delta")
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
def test_margins_of(kept, h4, law):
    h4 = h4.sample(2)
    slow = delayed(h4, "theta").sample(2)
    found = {}
    for name, robot, effects in (
        ("h4", h4, None),
        ("slow", slow, tp.Effects()),
        ("neck", tp.load("neck").sample(2), tp.Effects().only("delay")),
    ):
        asked = tp.Controller(
            law=law, frequency=50, velocity_bandwidth=400, damping=0.8, integral=2.0
        )
        margins = tp.control.stability_margins(robot, asked, effects, poses=some(robot, 2))
        found[name] = [margins.loops, margins.loci, margins.dither, margins.limit_cycle]
        found[f"{name} shown"] = [margins.stable, margins.kept]
    found["chosen"] = tried(
        tp.Controller.for_robot, h4, tp.Effects().only("delay", "friction"), law
    )
    kept(answer(found))


@pytest.mark.parametrize("fault", ["theta:bias=0.03", "q2:gain=1.02", "z_telemeter:sign", ""])
def test_isolation_of(kept, h4, fault):
    h4 = h4.with_sensors("theta", "z_telemeter", "wire1", "wire2")
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
def test_fault_monitor(kept, h4, fault):
    h4 = h4.with_sensors("theta", "z_telemeter", "wire1")
    reading, _, rest = fault.partition(":")
    kind, _, rest = rest.partition("@")
    kind, _, size = kind.partition("=")
    asked = tp.faults.Fault(reading, kind, at=float(rest), size=float(size) if size else None)
    monitor, found = tp.FaultMonitor(effects=tp.Effects().only("delay")), {}
    law = {"q1": "tej", "q2": "weighted", "wire1": "estimated"}.get(reading, "joint")
    run = tp.simulate(
        h4, h4.sample(2), law, faults=[asked], monitor=monitor, run=tp.simulation.Run(hold=0.1)
    )
    found["run"] = [*numbers(run), run.health.sum(axis=0), run.stops.sum(), run.symptom.sum(axis=0)]
    found["review"] = monitor.review(h4, run.q_e[:120], run.x_d[:120])
    kept(answer(found))


def test_online(kept, h4):
    h4 = h4.with_sensors("theta", "z_telemeter")
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


def test_detectability(kept, h4):
    robot = h4
    found = tp.faults.detectability(robot, some(robot, 6), false_alarm=1e-4, power=0.8, moving=30)
    after = tp.faults.detectability(robot, some(robot, 6), some(robot, 12, 5), level="ideal")
    kept(answer([found, found.table(), after]))
