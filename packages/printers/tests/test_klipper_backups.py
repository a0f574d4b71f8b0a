"""Several files of one printer, and of others."""

import numpy as np
import pytest
from printer_files import made_printer, text_of

from truepose.exceptions import InputError
from truepose_printers import backups
from truepose_printers.assessment import MM, assess

SESSIONS = 40


def session(kinematics, truth_seed, seed, name, endstop=0.0):
    """Assess heights of one made printer, read anew, perhaps with another nozzle."""
    printer, truth = made_printer(kinematics, truth_seed)
    p = truth.p.copy()
    p[-3:] += endstop
    heights = truth.readings.heights_only()
    touched = np.round(printer.delta.positions(truth.p, heights.height_steps)[0], 6)
    touched[:, 2] = 0.04 * MM * np.random.default_rng(seed).standard_normal(len(touched))
    steps = np.round(printer.delta.steps(p, touched))
    return assess(text_of(printer, heights._replace(height_steps=steps)), name)


def test_sessions_of_one_printer_agree_though_its_nozzle_was_changed():
    said = []
    for seed in range(SESSIONS // 2):
        first = session("delta", seed, 100 + seed, "a.cfg")
        second = session("delta", seed, 200 + seed, "b.cfg", endstop=0.3 * MM)
        said += [p.agrees for p in (backups.predict(first, second), backups.predict(second, first))]
    assert np.mean(said) > 0.97


def test_another_printers_file_is_named():
    mine = [session("delta", 1, seed, f"{seed}.cfg") for seed in (1, 2)]
    other = session("delta", 2, 3, "other.cfg")
    table, verdict = backups.judged([*mine, other])
    assert verdict.startswith("other.cfg: agrees with no other file")
    assert [row[4] for row in table.rows].count("yes") == 2
    assert backups.judged(mine)[1].startswith("The files agree")
    assert backups.judged([mine[0], other])[1].startswith("The files disagree")
    with pytest.raises(InputError, match="not the same printer"):
        backups.judged([mine[0], session("rotary_delta", 0, 0, "rotary.cfg")])
