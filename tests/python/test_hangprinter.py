"""Frames of cables from logs of examples/hangprinter: anchors from motor angles."""

import re
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.calibration import CalibrationOptions

FOLDER = Path(__file__).parents[2] / "examples" / "hangprinter"
DEGREE = 0.05133
COLUMNS = ", ".join(
    [f"q{k} = {name} * {DEGREE / (1 + (k == 4))} mm" for k, name in enumerate("abcd", 1)]
    + [f"measured_{name} = {name} * mm" for name in "xyz"]
)


@pytest.mark.parametrize(
    ("file", "log", "columns", "unit"),
    [
        ("robot.toml", "angles.csv", COLUMNS, 1e-3),
        ("four-cables.toml", "four-cables.csv", None, 1),
    ],
)
def test_anchors_are_found_within_their_sigma(file, log, columns, unit):
    robot = tp.load(FOLDER / file)
    text = (FOLDER / log).read_text(encoding="utf-8")
    truth = re.search(r"simulated anchors, m?m: (.*)", text)[1]
    true = np.reshape([float(v) for v in re.findall(r"-?\d[\d.]*", truth)], (4, -1)) * unit
    rows = tp.logs.read(robot, FOLDER / log, columns)
    known = CalibrationOptions(registration="known")
    if rows.measured is None:
        fit = tp.calibrate(robot, rows)
    else:
        fit = tp.calibrate(
            robot, rows.readings, measured=rows.measured, measured_sigma=2e-3, options=known
        )
    assert fit.causes.verdict == "none"
    free = [name for name in fit.parameters if ".base." in name]
    assert len(free) == (12 if columns else 5)
    for name in free:
        chain, axis = int(name[5]) - 1, "xyz".index(name[-1])
        of = fit.parameters[name]
        assert abs(of.value - true[chain, axis]) < 3 * of.sigma
        assert of.sigma < 0.2 * robot.parameters[name].sigma
