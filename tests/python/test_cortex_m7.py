"""What does an H4 cost on a Cortex-M7, and does it answer there as elsewhere? deploy/cortex-m7.

Skipped where the cross compiler or qemu are not installed.
"""

import re
import shutil
from pathlib import Path

import pytest
from compiling import told, wheels_eigen

SOURCE = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.xdist_group("cortex_m7"),
    pytest.mark.skipif(
        not all(map(shutil.which, ("make", "arm-none-eabi-g++", "qemu-system-arm"))),
        reason="no cross compiler or no qemu (Debian: gcc-arm-none-eabi libnewlib-arm-none-eabi "
        "libstdc++-arm-none-eabi-newlib qemu-system-arm)",
    ),
]


@pytest.fixture(scope="module")
def said(tmp_path_factory) -> str:
    """Return what `make -C deploy/cortex-m7` says; it fails where the self-test does."""
    folder, eigen = tmp_path_factory.mktemp("m7"), wheels_eigen() / "include" / "eigen3"
    return told("make", "-C", SOURCE / "deploy" / "cortex-m7", f"BUILD={folder}", f"EIGEN={eigen}")


def row(said: str, name: str) -> list[float]:
    """Return the numbers of a table's row."""
    (found,) = re.findall(rf"^\| {re.escape(name)} \|(.*)\|\s*$", said, flags=re.MULTILINE)
    return [float(cell) for cell in found.split("|")]


def test_it_answers_as_python_did_when_the_reference_was_written(said):
    (line,) = re.findall(r"differences from the reference.*: (.*)", said)
    differences = [int(number) for number in re.findall(r"[a-z] *(\d+)", line)]
    assert len(differences) == 7
    assert all(0 <= off <= 1000 for off in differences[:6]), line


def test_an_h4_with_control_fits_a_small_machine(said):
    assert row(said, "control")[0] <= 48
    mean, worst, stack = row(said, "control, redundant")
    assert mean <= worst <= 10_000
    assert stack <= 8192


def test_no_cycle_takes_much_longer_than_its_usual_one(said):
    for law in ("control, joint", "control, redundant", "control, Cartesian"):
        mean, worst, _ = row(said, law)
        assert worst < 1.1 * mean
