"""What do the tests share? Robots, poses, and the size of bulk samples."""

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from linuxcnc_modules import Module

import truepose as tp
from truepose import files
from truepose.commands import calibration_figures, cli
from truepose.paper import article


def pytest_addoption(parser):
    parser.addoption(
        "--count",
        type=int,
        help="poses in bulk samples (default 100000; the full check is --count=1000000), and "
        "robots in trials of calibrations (default 30; at most 400, the full check)",
    )


#: Reasons of skips for want of a package or a tool, which the extra `dev` and `.ci/run` bring.
WANTING = re.compile("import|installed|Debian|compiler|needs (?!pip)|drives")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Where CI is set, nothing is skipped for want of a package or a tool."""
    report = yield
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else ""
    if report.skipped and os.environ.get("CI") and WANTING.search(reason):
        report.outcome, report.longrepr = "failed", f"in CI: {reason}"
    return report


@pytest.fixture(scope="session")
def count(request) -> int:
    return request.config.getoption("--count") or 100_000


@pytest.fixture(scope="session")
def robots_drawn(request) -> int:
    """How many robots a trial of calibrations draws."""
    return min(request.config.getoption("--count") or 30, 400)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20050418)


@pytest.fixture(scope="session")
def h4() -> tp.Robot:
    return tp.load("h4")


@pytest.fixture(scope="session")
def truth(h4) -> tp.Robot:
    """Return an H4 with geometric errors from the paper's ranges."""
    return tp.with_paper_errors(h4, seed=1)


@pytest.fixture(scope="session")
def table2() -> np.ndarray:
    return article.table2()


@pytest.fixture(scope="session")
def h4_text() -> str:
    """Return the H4's robot file, to spoil."""
    from truepose import robotfile

    return robotfile.shipped()["h4"].read_text(encoding="utf-8")


# Not of the session: pytest would run all tests of one robot together, through all files again and
# again, and make what a file's tests share as often.
@pytest.fixture(params=tp.robots())
def any_robot(request) -> tp.Robot:
    """Return each shipped robot: every mobility, every actuator."""
    return tp.load(request.param)


@pytest.fixture(scope="session")
def delta() -> tp.Robot:
    """Return a robot without sensors and without bars."""
    return tp.load("delta")


@pytest.fixture(scope="session")
def stewart() -> tp.Robot:
    """Return a robot of six degrees of freedom, without arms."""
    return tp.load("stewart")


@pytest.fixture(scope="session")
def anywhere():
    """Return a function that draws poses from a robot's workspace box."""

    def draw(robot: tp.Robot, count: int, rng: np.random.Generator) -> np.ndarray:
        box = robot.spec.workspace
        return rng.uniform(box.minimum, box.maximum, size=(count, robot.n))

    return draw


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Return a function that runs `truepose` in an empty folder: status, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def command(*words):
        monkeypatch.setattr("sys.argv", ["truepose", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return (left.value.code or 0, *capsys.readouterr())

    return command


@pytest.fixture(scope="session")
def reproduction():
    """Return the paper, run end to end with one robot."""
    from truepose.paper.reproduce import reproduce

    return reproduce(1, seed=3)


@pytest.fixture
def plain_page(monkeypatch):
    """Write reports without their figures: most of the time of a calibration."""
    page = f"<!-- {files.mark('report')} -->"
    monkeypatch.setattr(calibration_figures, "page", lambda *_: page)


@pytest.fixture(scope="session")
def components(tmp_path_factory) -> Path:
    """Return a folder with LinuxCNC's components, built; `make linuxcnc` makes what they link."""
    root = Path(__file__).parents[2]
    library = Path(os.environ.get("TRUEPOSE_LIBRARY", root / "build/c/libtruepose.a"))
    if shutil.which("halcompile") is None:
        pytest.skip("LinuxCNC is not installed (Debian: linuxcnc-uspace linuxcnc-uspace-dev)")
    if not library.exists():
        pytest.skip("libtruepose.a is not built: `make linuxcnc` builds it, and runs this")
    work = tmp_path_factory.mktemp("components")
    for source in (root / "deploy/linuxcnc").glob("*"):
        if source.suffix in (".c", ".h") or source.name == "Makefile":
            shutil.copy(source, work)
    places = [f"LIBRARY={library.resolve()}", f"INCLUDE={root / 'include'}"]
    subprocess.run(["make", "-s", "-C", work, *places], check=True)
    return work


@pytest.fixture(scope="session")
def hal(tmp_path_factory):
    """Return what stands for LinuxCNC's HAL (tests/linuxcnc/stub_hal.c)."""
    library = tmp_path_factory.mktemp("hal") / "libhal.so"
    source = Path(__file__).parents[1] / "linuxcnc/stub_hal.c"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    hal = ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    hal.stub_pin.restype = ctypes.c_void_p
    return hal


@pytest.fixture
def ours(hal, tmp_path, components):
    """Load a module of ours anew: one that is loaded twice from one file is the same one."""

    def load(name="truepose_kins", **parameters):
        copy = tmp_path / f"{name}{len(list(tmp_path.iterdir()))}.so"
        shutil.copy(components / f"{name}.so", copy)
        return Module(hal, copy, **parameters)

    return load


def pytest_report_header(config):
    return f"truepose {tp.__version__}; bulk samples: {config.getoption('--count') or 'default'}"
