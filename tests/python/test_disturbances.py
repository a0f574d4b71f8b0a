"""The fault monitor under loose contacts and frozen encoders; disturbances of the true robot."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.commands.options import disturbances_of
from truepose.faults.monitor import HEALTH
from truepose.simulation import Run

Fault, Disturbance = tp.faults.Fault, tp.faults.Disturbance


@pytest.mark.parametrize("sensors", [["theta", "z_telemeter"], ["theta", "elbow1", "elbow3"]])
@pytest.mark.parametrize("value", [0.0, -3.0])
def test_a_loose_contact_is_no_noise(h4, sensors, value):
    robot = h4.with_sensors(*sensors)
    controller, monitor = tp.Controller.for_robot(robot), tp.FaultMonitor()
    healthy = tp.simulate(robot, controller=controller)
    for reading in (*robot.readings[: robot.n], sensors[-1]):
        contact = [  # several cycles with a value, a few without
            fault
            for at in (0.05, 0.07, 0.1, 0.12)
            for fault in (
                Fault(reading, "gain", at, 0.0, at + 0.003),
                Fault(reading, "bias", at, value, at + 0.003),
            )
        ]
        for faults in (contact, [Fault(reading, "loose", 0.05)]):
            run = tp.simulate(robot, controller=controller, faults=faults, monitor=monitor)
            assert run.failed == [reading]
            off = np.linalg.norm((run.x - healthy.x)[~run.stops, :3], axis=1)
            assert off.max() < 2e-3


@pytest.mark.parametrize("seed", range(3))
def test_a_frozen_encoder_still_fails(h4, seed):
    robot = h4.with_sensors("theta").expected()
    run = tp.simulate(
        robot, robot.sample(seed), faults=[Fault("q1", "stuck", 0.1)], monitor=tp.FaultMonitor()
    )
    assert run.failed == ["q1"]
    assert run.time[run.health[:, 0] == HEALTH.index("failed")][0] < 0.14


def test_a_payload_that_the_motors_cannot_hold_ends_the_run_with_its_log(h4):
    heavy = [Disturbance("payload", 0.1, 200.0)]
    run = tp.simulate(h4, run=Run(disturbances=heavy))
    assert run.status == run.ended and run.status.startswith("stopped after 0.3")
    assert 300 < len(run.time) < 401 and len(list(run.table())) == 5


@pytest.mark.parametrize(
    "words, said",
    [
        (("paylod", 0, 1.0), "unknown kind of disturbance 'paylod'"),
        (("payload", 0, -1.0), "size = -1.0: must be a finite number greater than 0"),
        (("payload", "now", 1.0), "payload: at = 'now': must be a finite number of at least 0"),
        (("contact", 0, None, None, [np.nan] * 4), "must be a finite number"),
        (("friction", 0, 1.0), "motor = None: of friction alone"),
        (("contact", 0, 1.0), "a contact has a force"),
        (("contact", 0.2, None, None, (1, 0, 0, 0), 0.1), "until = 0.1: of a contact"),
    ],
)
def test_a_disturbance_without_a_meaning_is_refused(words, said):
    with pytest.raises(tp.InputError) as error:
        Disturbance(*words)
    assert said in str(error.value)


@pytest.mark.parametrize(
    "disturbance, said",
    [
        (Disturbance("friction", 0, 1.0, "q9"), "unknown motor 'q9'"),
        (Disturbance("contact", 0, force=(1.0, 0.0)), "must be 4 finite numbers"),
    ],
)
def test_a_disturbance_of_another_robot_is_refused(h4, disturbance, said):
    with refused(said):
        tp.simulate(h4, run=Run(disturbances=[disturbance]))


@pytest.mark.parametrize(
    "disturbance",
    [
        Disturbance("payload", 0.1, 2.0),
        Disturbance("friction", 0, 3.0, "q1"),
        Disturbance("contact", 0.1, force=(300.0, 0.0, -5.0, 0.0), until=0.12),
    ],
    ids=str,
)
def test_the_command_line_reads_a_disturbance(disturbance):
    assert disturbances_of([str(disturbance)]) == [disturbance]


@pytest.mark.parametrize(
    "text, said",
    [("payload", "must be [MOTOR:]KIND=SIZE"), ("payload=x", "size and times must be numbers")],
)
def test_the_command_says_what_is_wrong_with_a_disturbance(refusal, text, said):
    err = refusal("simulate", "h4", "--disturbance", text)
    assert said in err
