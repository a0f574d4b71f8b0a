"""The sensor of θ of the shipped H4s: where it is mounted, and what it is worth."""

import numpy as np
import pytest

import truepose as tp


@pytest.mark.parametrize("name", ["h4", "h4-lirmm-twin"])
def test_theta_is_read_at_the_tools_pivot_joint(name):
    assert next(s for s in tp.load(name).spec.sensor if s.name == "theta").bar == 1


def test_a_log_of_the_real_encoder_is_calibrated_as_accurately_as_stated(h4, table2):
    """The encoder at lateral bar 1 on true robots at the full level."""
    rng, over, inside = np.random.default_rng(2), [], []
    for seed in range(20):
        true = h4.sample(seed).with_level("full")
        learnt, others = np.split(rng.permutation(table2)[:90], [60])
        learnt = learnt + rng.uniform(-5e-4, 5e-4, learnt.shape)
        bars = true.residual_motion(others)[:, 2]
        x, q_e = others, true.read(others, seed=seed + 100)
        assert np.abs(q_e[:, 4] - (x[:, 3] - true.parameters["theta.offset"].value)).max() > (
            0.5 * np.abs(bars).max() - 1e-4
        )  # the bar's turn is in the reading
        found = tp.calibrate(h4, true.read(learnt, seed=seed)).robot.estimate(q_e, guess=x)
        off = (found.x - x)[:, 3] / np.sqrt(found.covariance[:, 3, 3])
        over.append((off**2).mean())
        inside.append((np.abs(off) < 1.96).mean())
    assert 0.6 < np.sqrt(np.mean(over)) < 1.4
    assert np.mean(inside) > 0.85
