"""Real encoders: eccentricity, noise, counts, stops."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.robot import LAWS

C1, S1, C2, S2 = 0.01, -0.02, 0.005, 0.015
KEY = f"eccentricity = [{C1}, {S1}, {C2}, {S2}]"


def error(phi):
    """Of an encoder off its centre, as defined."""
    return C1 * np.cos(phi) + S1 * np.sin(phi) + C2 * np.cos(2 * phi) + S2 * np.sin(2 * phi)


@pytest.fixture
def spoil(h4_text, load):
    """Return a function that loads an H4 with keys put after other lines of its file."""

    def with_keys(**additions: str) -> tp.Robot:
        text = h4_text
        for after, line in additions.items():
            old = {
                "chains": "[chain_defaults]",
                "theta": "gear = 4.0",
                "chain1": "anchor = [0.0, 0.06",
            }
            head, found, tail = text.partition(old[after])
            end = tail.index("\n")
            text = head + found + tail[:end] + "\n" + line + tail[end:]
        return load(text)

    return with_keys


def test_a_motors_encoder_off_its_centre_reads_its_angle_and_the_error_there(h4, spoil, table2):
    angle, robot = h4.ikm(table2), spoil(chains=KEY)
    assert robot.ikm(table2) == pytest.approx(angle + error(angle), abs=1e-14)
    offset = robot.replace({"chain2.encoder_offset": 0.3})  # the error is the angle's, not q's
    assert offset.ikm(table2) == pytest.approx(robot.ikm(table2) - [0, 0.3, 0, 0], abs=1e-14)


def test_a_sensors_error_turns_with_its_geared_shaft(spoil, table2):
    robot = spoil(theta=KEY).replace({"theta.gain": -2.0, "theta.offset": 0.1})
    theta = table2[:, 3]
    reading = -2 * (theta + error(4 * theta) / 4) - 0.1
    assert robot.rkm(table2)[:, 0] == pytest.approx(reading, abs=1e-14)
    assert robot.rkm(table2, level="full")[:, 0] == pytest.approx(reading, abs=1e-12)
    assert robot.redundant_fkm(robot.extended_positions(table2)) == pytest.approx(table2, abs=1e-12)


NOISE = {"chains": "encoder_noise = 3e-4", "theta": "noise = 5e-4"}


def test_noise_has_the_files_sigma_and_a_seed(spoil):
    robot = spoil(**NOISE)
    x = np.tile(robot.home, (20000, 1))
    readings = robot.read(x, seed=3)
    error = readings - robot.extended_positions(x)
    assert error.std(axis=0) == pytest.approx(robot.reading_sigma, rel=0.03)
    assert np.abs(error.mean(axis=0)).max() < 2e-5
    assert np.abs(np.corrcoef(error.T) - np.eye(5)).max() < 0.04
    assert np.array_equal(readings, robot.read(x, seed=3))
    assert not np.array_equal(readings, robot.read(x, seed=4))
    counts = readings / robot.resolution
    assert counts == pytest.approx(np.round(counts), abs=1e-6)


def test_without_noise_a_reading_is_the_nearest_count(h4, table2):
    for level in ("ideal", "full"):
        off = np.abs(h4.read(table2, level=level) - h4.extended_positions(table2, level=level))
        assert (off <= h4.resolution / 2 * (1 + 1e-9)).all()
    exact = h4.without_quantization()
    assert np.array_equal(exact.read(table2), exact.extended_positions(table2))


def test_a_simulations_noise_repeats_with_its_seed(h4, spoil):
    noisy = spoil(**NOISE)
    runs = [
        tp.simulate(h4, noisy, run=tp.simulation.Run(seed=seed, hold=0.0)) for seed in (1, 1, 2)
    ]
    assert np.array_equal(runs[0].q_e, runs[1].q_e)
    assert not np.array_equal(runs[0].q_e, runs[2].q_e)
    spread = (runs[0].q_e - noisy.extended_positions(runs[0].x)).std(axis=0)
    assert spread == pytest.approx(noisy.reading_sigma, rel=0.2)


@pytest.mark.parametrize("seed", [-1, 1.5, "a", 2**64])
def test_a_seed_that_is_none_is_refused(h4, seed):
    with refused(r"seed = .*: must be a whole number"):
        h4.read(h4.home, seed=seed)


@pytest.fixture
def limited(spoil):
    """Return an H4 whose first motor stops at 0.38 and 0.79 rad."""
    return spoil(chain1="limits = [0.38, 0.79]").replace({"chain1.encoder_offset": 0.2})


def test_a_pose_beyond_a_joint_limit_names_chain_position_and_limits(limited):
    where = r"chain 1: beyond a joint limit, 0.973521 of \[0.38, 0.79\]$"
    for level in ("ideal", "full"):
        with refused(where, tp.PoseError):
            limited.ikm([-0.1, 0, -0.5, 0], level=level)
        assert np.isnan(limited.ikm([-0.1, 0, -0.5, 0], level=level, errors="nan")).all()
    assert limited.ikm([0, 0, -0.5, 0])[0] == pytest.approx(0.6797 - 0.2, abs=1e-4)


def test_controllers_refuse_setpoints_beyond_a_joint_limit(limited, h4):
    beyond = [-0.1, 0, -0.5, 0]
    for law in LAWS:
        with refused(r"chain 1: beyond a joint limit, 0.97", tp.PoseError):
            tp.steady_state(limited, limited, beyond, law)
    with refused(r"end of the move: .*: chain 1: beyond a joint limit", tp.PoseError):
        tp.simulate(limited, run=tp.simulation.Run(start=[0, 0, -0.5, 0], end=beyond))


def test_a_home_beyond_a_joint_limit_makes_no_robot(spoil):
    with refused(r"home = .*: beyond a joint limit, chain 1", tp.RobotFileError):
        spoil(chain1="limits = [0.0, 0.1]")


@pytest.mark.parametrize("name", ["h4", "linear-delta", "hexaglide", "stewart"])
def test_a_shaft_counts_per_turn_and_a_slide_per_metre(name):
    robot = tp.load(name)
    for chain, step in zip(robot.spec.chain, robot.resolution, strict=False):
        whole = 2 * np.pi if chain.actuator == "revolute" else 1.0
        assert step == pytest.approx(whole / chain.encoder_counts, rel=1e-15)
