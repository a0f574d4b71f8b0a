"""Build-up of a spool's line, found by calibration."""

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.calibration import CalibrationOptions

#: 1 mm of line on a radius of 25 mm.
BUILDUP = 1e-3 / (4 * np.pi * 0.025**2)


def spooled(tmp_path, extra=""):
    """A hexapod on six spools, whose build-up is known to 3 % of a metre's."""
    source = tp.load("stewart").spec._text
    source = source.replace(
        "[chain_defaults]\n", f"[chain_defaults]\nspool_buildup = {BUILDUP!r}\n{extra}"
    )
    source = source.replace(
        "[tolerances]", '[tolerances]\n"chain*.spool_buildup" = { sigma = 0.03 }'
    )
    (tmp_path / "spools.toml").write_text(source, encoding="utf-8")
    return tp.load(tmp_path / "spools.toml")


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_a_leg_is_as_long_as_its_spool_has_let_out(tmp_path, level):
    plain, robot = tp.load("stewart").with_sensors(), spooled(tmp_path).with_sensors()
    x = robot.home + np.random.default_rng(1).uniform(-0.03, 0.03, (20, 6))
    v, legs = robot.ikm(x, level=level), plain.ikm(x, level=level)
    assert legs == pytest.approx(v + BUILDUP * v**2, abs=1e-12)
    assert robot.fkm(v, guess=x, level=level) == pytest.approx(x, abs=1e-9)


def test_a_spool_is_calibrated_saved_and_loaded(tmp_path):
    robot = spooled(tmp_path).with_sensors("roll", "pitch")
    true = robot.replace(
        {f"chain{k}.spool_buildup": BUILDUP + 0.02 * (-1) ** k for k in range(1, 7)}
    )
    rng = np.random.default_rng(4)
    x = drawn_poses(robot, 80, rng)
    fit = tp.calibrate(
        robot,
        true.extended_positions(x),
        measured=x,
        options=CalibrationOptions(registration="known"),
    )
    for k in range(1, 7):
        of = fit.parameters[f"chain{k}.spool_buildup"]
        assert abs(of.value - true.parameters[f"chain{k}.spool_buildup"].value) < 3 * of.sigma
        assert of.verdict == "identified"
    fit.robot.save(tmp_path / "calibrated.toml")
    again = tp.load(tmp_path / "calibrated.toml")
    assert again.parameters == fit.robot.parameters


def test_an_arm_has_no_spool(tmp_path):
    source = tp.load("h4").spec._text.replace(
        "[chain_defaults]\n", "[chain_defaults]\nspool_buildup = 0.1\n"
    )
    if "[chain_defaults]\n" not in source:
        source = source.replace("[[chain]]\n", "[[chain]]\nspool_buildup = 0.1\n", 1)
    (tmp_path / "h4.toml").write_text(source, encoding="utf-8")
    with refused("'spool_buildup' is for prismatic and telescopic", tp.RobotFileError):
        tp.load(tmp_path / "h4.toml")
    assert "chain1.spool_buildup" not in tp.load("h4").parameters
