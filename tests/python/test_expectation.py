"""Predicted error of poses predicted by the motors."""

import numpy as np
import pytest

from truepose.calibration.expectation import expect
from truepose.robotfile.schema import CalibrationSection

ERROR = 0.01  # rad


@pytest.fixture
def known(h4):
    """Return an H4 known exactly but for what the ideal level leaves out of each reading."""
    name = "chain1.rod"
    exact = h4.with_file(tolerances={})
    return exact.with_calibration(
        CalibrationSection(
            source="a test",
            parameters=(name,),
            mean=(h4.parameters[name].value,),
            root=((1e-12,),),
            model_error=dict.fromkeys(h4.readings, ERROR),
        )
    )


def test_what_the_ideal_level_leaves_out_counts_in_what_is_expected(known):
    x = [0.05, 0.02, -0.4, 0.2]
    readings = known.extended_positions([x], level="ideal")
    seen = expect(known, readings, level="ideal")
    H_x, _ = known.linearize(x, level="ideal")
    leaks = np.append(-H_x[4:] @ np.linalg.inv(H_x[:4]), 1.0)  # of each reading, into what is left
    noise = np.hypot(known.reading_sigma, ERROR)
    assert seen.residual == pytest.approx(0, abs=1e-9)
    assert seen.sigma[0, 0] == pytest.approx(np.linalg.norm(leaks * noise), rel=1e-6)
    assert expect(known, readings, level="full").sigma[0, 0] < 0.2 * seen.sigma[0, 0]
