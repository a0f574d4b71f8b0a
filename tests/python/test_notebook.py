"""The documentation's notebook: its code runs, and shows what its text states."""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "notebook.md"


def test_the_notebook_runs_and_its_text_holds(tmp_path, monkeypatch):
    text = PAGE.read_text(encoding="utf-8")
    cells = re.findall(r"^```\{code-cell\} python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert len(cells) == text.count("{code-cell}") and sum(c.count("\n") for c in cells) <= 60
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    with mpl.rc_context():
        found = {}
        for cell in cells:
            exec(cell, found)
    assert found["robot"].readings == ("q1", "q2", "q3", "q4", "theta", "wire")
    rms = [
        [
            np.sqrt(np.mean(found["position_error"](known, law, found["poses"][100:]) ** 2))
            for law in found["laws"].values()
        ]
        for known in (found["robot"], found["fit"].robot)
    ]
    assert rms[0][2] < 0.7 * min(rms[0][:2])  # the own law, before the calibration
    assert np.ptp(rms[1]) < 0.01 < max(rms[1]) < 1  # mm
    assert len(found["plt"].get_fignums()) == 2
    found["plt"].close("all")
