"""Cost and answers of an H4 on a Cortex-M7. examples/cortex-m7.

Skipped where the cross compiler or qemu are not installed.
"""

import re
import shutil
from pathlib import Path

import pytest
from compiling import told

SOURCE = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.skipif(
        not all(map(shutil.which, ("make", "arm-none-eabi-g++", "qemu-system-arm"))),
        reason="no cross compiler or no qemu (Debian: gcc-arm-none-eabi libnewlib-arm-none-eabi "
        "libstdc++-arm-none-eabi-newlib qemu-system-arm)",
    ),
]


def board(folder: Path, *options: str) -> str:
    """Return what `make -C examples/cortex-m7` says; it fails where the self-test does."""
    return told("make", "-C", SOURCE / "examples" / "cortex-m7", f"BUILD={folder}", *options)


@pytest.fixture(scope="module")
def said(tmp_path_factory) -> str:
    """Return what is said in double precision."""
    return board(tmp_path_factory.mktemp("m7"))


def row(said: str, name: str) -> list[float]:
    """Return the numbers of a table's row."""
    (found,) = re.findall(rf"^\| {re.escape(name)} \|(.*)\|\s*$", said, flags=re.MULTILINE)
    return [float(cell) for cell in found.split("|")]


def test_it_answers_as_python_does(said):
    (line,) = re.findall(r"differences from the reference.*: (.*)", said)
    differences = [int(number) for number in re.findall(r"[a-z] *(\d+)", line)]
    assert len(differences) == 7
    assert all(0 <= off <= 1000 for off in differences[:6]), line


def test_an_h4_with_control_fits_a_small_machine(said):
    assert row(said, "control")[0] <= 108
    mean, worst, stack = row(said, "control, TEJ")
    assert mean <= worst <= 10_000
    assert stack <= 16_000


def test_in_single_precision_an_h4_fits_a_board_without_a_double_unit(said, tmp_path):
    single = board(tmp_path, "SINGLE=1")
    for entry in ("IKM", "FKM, from the last cycle's pose", "TEJ", "control, TEJ"):
        assert row(single, entry)[0] < row(said, entry)[0]
    assert row(single, "control")[0] <= 104
    assert row(single, "control, TEJ")[0] <= 8_000
    assert row(single, "TEJ, full feed-forward")[0] <= 14_000
    calls = told("arm-none-eabi-nm", "--undefined-only", *tmp_path.glob("*/*.o"))
    assert "sinf" in calls and not re.search(r"__aeabi_(d|\w+2d\b)", calls)  # no double anywhere


def test_an_ankle_answers_there_as_elsewhere_and_its_poses_cost_less_than_an_h4s(said, tmp_path):
    ankle = board(tmp_path, "ROBOT=g1_ankle")
    assert "FAILED" not in ankle
    for entry in ("IKM", "FKM, from the last cycle's pose", "estimate"):
        assert row(ankle, entry)[0] < row(said, entry)[0]
    assert row(ankle, "and the joints' torques there")[0] <= 14_000
    assert row(ankle, "control, TEJ")[0] <= 15_000


def test_no_cycle_takes_much_longer_than_its_usual_one(said):
    for law in ("control, joint", "control, TEJ", "control, Cartesian"):
        mean, worst, _ = row(said, law)
        assert worst < 1.1 * mean
