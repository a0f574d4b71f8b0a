"""Reference results. Every verdict holds, and a wrong figure fails."""

import dataclasses

import pytest
import run as reference
from rows import Row, worst


@pytest.mark.parametrize("folder", reference.folders())
def test_no_verdict_fails(folder):
    rows = reference.check(folder)
    assert rows and [row for row in rows if row.verdict == "FAILED"] == []


def test_a_difference_needs_a_reason_and_stays_within_its_bound():
    row = Row("length", 1.0, 1.2, 0.1)
    assert row.verdict == "FAILED"
    explained = dataclasses.replace(row, explained="a typing error", bound=0.3)
    assert explained.verdict == "explained"
    assert dataclasses.replace(explained, cause_known=False).verdict == "open"
    assert dataclasses.replace(explained, bound=0.15).verdict == "FAILED"
    assert dataclasses.replace(explained, computed=float("nan")).verdict == "FAILED"


def test_the_worst_entry_is_shown_and_shapes_must_agree():
    row = worst("lengths", [1.0, 2.0, 3.0], [1.0, 2.5, 3.1], 1.0)
    assert (row.printed, row.computed) == (2.0, 2.5)
    with pytest.raises(ValueError, match="print as many"):
        worst("lengths", [1.0], [1.0, 2.0], 1.0)


def test_the_table_shows_every_row_and_its_exit_status_a_failure(monkeypatch, capsys):
    assert reference.main(["dietmaier_1998"]) == 0
    assert "real postures" in capsys.readouterr().out
    monkeypatch.setattr(reference, "check", lambda _: [Row("length", 1.0, 1.2, 0.1)])
    assert reference.main(["dietmaier_1998"]) == 1
    assert "FAILED" in capsys.readouterr().out


def test_an_unknown_reference_is_refused_with_the_known_ones():
    with pytest.raises(SystemExit, match="no such reference; there are dietmaier_1998"):
        reference.check("nobody_1900")
