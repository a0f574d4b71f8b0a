"""The examples and their output."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SHOWN = {
    "01_kinematics.py": ["<truepose.Robot h4", "motors, degrees:", "FKM(IKM(x)) - x", "(1000, 4)"],
    "02_extended_error.py": [
        "error of the motors, degrees: 0.0",
        "error of θ's encoder",
        "joint  ",
        "tej  ",
        "cartesian  position",
    ],
    "03_simulate_the_move.py": ["ideal robot        end:  0.000 mm", "cartesian", "(401, 5)"],
    "04_the_625_poses.py": ["625 poses", "joint  ", "tej  ", "of θ's sum of squares"],
    "05_your_own_robot.py": ["my-delta: translation", "unknown key 'rd'", "round trip", "e-1"],
    "07_stability_margin.py": ["comes to rest", "compliance", "tej", "swings by"],
    "06_calibrate.py": ["row 18: 1 outlier", "chain1.rod ", "identified", "calibrated position"],
}


def test_every_example_is_run_here_and_listed():
    found = {path.name for path in EXAMPLES.glob("*.py")}
    assert found == set(SHOWN)
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert all(f"({name})" in listed for name in found)


@pytest.mark.parametrize("name", SHOWN)
def test_an_example_runs_and_shows_what_it_is_about(name, tmp_path):
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-X", "utf8", EXAMPLES / name],
        cwd=tmp_path,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    for text in SHOWN[name]:
        assert text in ran.stdout
    assert not list(tmp_path.iterdir())
