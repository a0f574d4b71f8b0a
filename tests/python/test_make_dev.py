"""`make dev T=header` finds a C++ test for every header."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ROOT / "include" / "truepose"
HEADERS = sorted(h.stem for h in ROOMS.glob("*/*.hpp") if h.parent.name != "offline")


def labels():
    """Return what each C++ test says that it asks about."""
    text = (ROOT / "tests" / "cpp" / "CMakeLists.txt").read_text(encoding="utf-8")
    tests = re.findall(r"^truepose_test\((test_\w+)([^)]*)\)", text, re.M)
    return {name: about.split() for name, about in tests}


@pytest.mark.parametrize("header", HEADERS)
def test_some_test_asks_about_every_header(header):
    assert any(header in about for about in labels().values()), (
        f"name {header} behind the test that asks about it, in tests/cpp/CMakeLists.txt"
    )


@pytest.mark.parametrize("name", labels())
def test_every_label_names_a_test_that_exists(name):
    assert (ROOT / "tests" / "cpp" / f"{name}.cpp").exists()
