"""Scale of motor encoders and screws."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp

#: The second one counts backwards.
GAINS = (1.002, -0.7, 1.3, 1.0, 0.9, 1.1)


def scaled(robot):
    return robot.replace({f"chain{i + 1}.gain": GAINS[i] for i in range(robot.n)})


@pytest.fixture(params=["h4", "linear-delta", "stewart", "five-bar"])
def robot(request):
    return tp.load(request.param).without_quantization()


def test_a_reading_is_gain_times_the_motors_position_less_its_offset(robot, anywhere, rng):
    robot = robot.replace({"chain2.encoder_offset": 0.01})
    x, gains = anywhere(robot, 20, rng), np.array(GAINS[: robot.n])
    offset = np.array([0, 0.01] + [0] * (robot.n - 2))
    q = robot.ikm(x)
    read = scaled(robot).ikm(x)
    assert read == pytest.approx(gains * (q + offset) - offset, abs=1e-14)
    assert scaled(robot).fkm(read, guess=x) == pytest.approx(x, abs=1e-11)
    assert scaled(robot).jacobian(x) * gains == pytest.approx(robot.jacobian(x), abs=1e-10)
    sensors = len(robot.readings) - robot.n
    if sensors:
        assert scaled(robot).rkm(x) == pytest.approx(robot.rkm(x), abs=1e-13)


def test_what_springs_and_plays_does_so_in_the_motors_own_turns(h4):
    """Compliance bends what is read by the rotor's turn, gain and all; a gain changes no motion."""
    values = {"chain1.gain": 1.3, "chain3.gain": -0.8}
    effects = tp.Effects().only("compliance", "ripple", "friction")
    runs = [
        tp.simulate(a, a, "joint", effects=effects, run=tp.simulation.Run(duration=0.1, hold=0.0))
        for a in (h4.without_quantization(), h4.without_quantization().replace(values))
    ]
    assert runs[1].x == pytest.approx(runs[0].x, abs=1e-8)


@pytest.fixture
def loosely(tmp_path):
    """A shipped robot of whose motors' gains nobody is sure, with all its sensors."""

    def load(name):
        file = tmp_path / f"{name}.toml"
        file.write_text(
            f'based_on = "{name}"\nname = "{name} with screws of its own"\n'
            '[tolerances]\n"chain*.gain" = { sigma = 1e-3 }\n'
        )
        robot = tp.load(file)
        return robot.with_sensors("all")

    return load


@pytest.mark.parametrize("name, known", [("h4", 2.5e-4), ("linear-delta", 3e-5)])
def test_a_calibration_finds_a_gain(loosely, name, known, anywhere, rng):
    """One part in a thousand, among all else that is not known: within 3.5 of the σ it states."""
    robot = loosely(name)
    x = anywhere(robot, 80, rng)
    true = robot.sample(4).replace({"chain2.gain": 1.001})
    fit = tp.calibrate(robot, true.read(x))
    for chain in range(1, robot.n + 1):
        gain = fit.parameters[f"chain{chain}.gain"]
        assert gain.sigma < known
        assert abs(gain.value - true.parameters[f"chain{chain}.gain"].value) < 3.5 * gain.sigma
    # What is promised beforehand counts the gains in.
    sure = tp.accuracy(tp.load(name).with_sensors(*robot.spec.sensors), x[:5])
    assert np.all(np.linalg.eigvalsh(tp.accuracy(robot, x[:5]) - sure) > -1e-15)
    assert np.trace(tp.accuracy(robot, x[:5])[0]) > np.trace(sure[0])


def test_gains_are_learnt_online(loosely, anywhere, rng):
    robot = loosely("linear-delta")
    true = robot.expected().replace({"chain2.gain": 1.001})
    learner = tp.OnlineCalibrator(robot)
    for line in true.read(anywhere(robot, 150, rng)):
        learner.observe(line)
    gain = learner.parameters["chain2.gain"]
    assert abs(gain.value - 1.001) < 4 * gain.sigma < 5e-4


def test_a_file_that_says_nothing_of_gains_knows_them(h4):
    gain = h4.parameters["chain1.gain"]
    assert (gain.value, gain.mean, gain.sigma) == (1, 1, 0)


def test_a_motor_that_reads_nothing_is_refused(h4, tmp_path):
    with refused(r"^chain3.gain = 0: must not be 0: the reading"):
        h4.replace({"chain3.gain": 0})
