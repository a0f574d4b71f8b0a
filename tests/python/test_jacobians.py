"""J and the TEJ of the H4, as its derivation states them."""

import numpy as np
import pytest


def test_jacobian_is_as_well_conditioned_as_the_derivation_says(h4, table2):
    scaled = h4.jacobian(table2) * np.array([1, 1, 1, 0.1])[:, None]
    condition = np.linalg.cond(scaled)
    assert (condition.min(), condition.max()) == pytest.approx((2.4, 4.4), abs=0.1)


def test_without_sensors_the_tej_changes_nothing(delta, anywhere, rng):
    M, M_plus = delta.tej(anywhere(delta, 10, rng))
    assert np.array_equal(M, M_plus) and np.array_equal(M[0], np.eye(3))


def test_j_squared_of_theta_spans_what_the_derivation_says(h4, table2):
    """|j|², j the θ row of J, decides what the TEJ leaves of a θ error: 1/(1 + |j|²)."""
    squared = (h4.jacobian(table2)[:, 3] ** 2).sum(axis=-1)
    assert [squared.min(), squared.max()] == pytest.approx([8, 38], abs=0.5)
    assert np.median(squared) == pytest.approx(13, abs=0.5)
