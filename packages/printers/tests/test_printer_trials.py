"""Coverage of printers' stated σ. Of printers drawn from what is assumed of them."""

import numpy as np
import pytest
from printer_files import made_printer, text_of
from printer_trials import trials

from truepose_printers.assessment import assess


@pytest.mark.parametrize(
    ("kinematics", "distances"), [("delta", True), ("delta", False), ("rotary_delta", True)]
)
def test_estimates_lie_within_their_sigma(kinematics, distances, robots_drawn):
    """`python packages/printers/tests/printers.py` takes hundreds, of other noise too."""
    count = robots_drawn
    ran = [trial for trial in trials(kinematics, count, seed=7, distances=distances) if trial]
    assert len(ran) == count  # none without an answer
    inside = np.mean([trial.inside for trial in ran], axis=0)
    assert (inside > 0.91 - 3.29 * np.sqrt(0.95 * 0.05 / count)).all()
    error, bound = (np.mean([getattr(t, of) for t in ran], axis=0) for of in ("error", "bound"))
    one_or_two = 1.5  # directions that a printer's error mostly has
    assert np.sqrt(error / bound) == pytest.approx(1, abs=4 / np.sqrt(2 * count * one_or_two))


def test_readings_that_scatter_more_make_a_larger_sigma():
    printer, truth = made_printer(seed=3)
    heights = truth.readings.heights + 2e-4 * np.cos(np.pi * np.arange(7))
    warped = truth.readings._replace(heights=heights)
    calm, rough = (assess(text_of(printer, r)) for r in (truth.readings, warped))
    assert "Too few readings to judge" in calm.answer["words"][-2]
    assert rough.noise("heights") > 2 * calm.noise("heights")
