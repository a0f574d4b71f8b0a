"""Shared fixtures: robots, poses, and the size of bulk samples."""

import os
import re
from contextlib import contextmanager
from xml.etree import ElementTree

import numpy as np
import pytest

import truepose as tp
from truepose import files
from truepose.commands import calibration_figures, cli
from truepose.robot import workspace_grid
from truepose.show import terminal
from truepose.show.results import Shown


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
    """The shipped H4 on the day of its calibration: none of its conditions at work."""
    return tp.load("h4").with_file(conditions=None)


def drawn_poses(robot: tp.Robot, count: int, rng) -> np.ndarray:
    """Return poses anywhere in a robot's workspace box, by a generator or a seed."""
    box = robot.spec.workspace
    return np.random.default_rng(rng).uniform(box.minimum, box.maximum, (count, robot.n))


@contextmanager
def refused(message: str, by: type = tp.InputError):
    """Expect a refusal in one line with this message, a regular expression."""
    with pytest.raises(by, match=message) as told:
        yield told
    assert "\n" not in str(told.value)


def require_shown(result: Shown) -> None:
    """Check the table and the chart of a result that shows itself."""
    assert isinstance(result, Shown)
    table = result.table()
    page = ElementTree.fromstring(result._repr_html_().replace("&nbsp;", " "))
    (shown,) = page.iter("table")
    assert shown.findtext("caption") == table.title
    rows = [["".join(cell.itertext()) for cell in row] for row in shown.iter("tr")]
    assert rows == [list(table.header), *([*map(str, row)] for row in table.rows)]
    assert rows[1:] and all(record for record in table)
    figure = result.plot()
    try:
        assert figure.axes
        for axes in figure.axes:
            labels = {axes.get_xlabel(), axes.get_ylabel()}
            named = any("(" in label and ")" in label for label in labels) or "pose" in labels
            assert named, (result, labels)
        figure.canvas.draw()
    finally:
        figure.clear()


def with_length_errors(robot: tp.Robot, seed: int) -> tp.Robot:
    """Return a true robot whose rods and arms alone are sampled from their tolerances."""
    sampled = robot.sample(seed).parameters.items()
    return robot.replace({k: p.value for k, p in sampled if k.endswith((".rod", ".arm"))})


@pytest.fixture(scope="session")
def truth(h4) -> tp.Robot:
    """Return an H4 with errors of its rods and arms."""
    return with_length_errors(h4, seed=1)


@pytest.fixture(scope="session")
def table2(h4) -> np.ndarray:
    """Return the 625 poses of the paper's Table 2, the grid of the H4's workspace."""
    return workspace_grid(h4)


@pytest.fixture(scope="session")
def h4_text() -> str:
    """Return the H4's robot file, to spoil."""
    from truepose import robotfile

    return robotfile.shipped()["h4"].read_text(encoding="utf-8")


@pytest.fixture
def load(tmp_path):
    """Return a function that loads a robot file's text."""

    def from_text(text: str) -> tp.Robot:
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return tp.load(path)

    return from_text


# Not of the session: pytest would run all tests of one robot together, through all files again and
# again, and make what a file's tests share as often.
@pytest.fixture(params=tp.list_robots())
def any_robot(request) -> tp.Robot:
    """Return each shipped robot, without conditions: every mobility, every actuator."""
    return tp.load(request.param).with_file(conditions=None)


#: Shipped robots of chains; control, dynamics, simulation, C and drawings of chains are for these.
CHAINED = [name for name in tp.list_robots() if tp.load(name).spec.chain]


@pytest.fixture(params=CHAINED)
def chained_robot(request) -> tp.Robot:
    """Return each shipped robot of chains."""
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
    """Return the function `drawn_poses`."""
    return drawn_poses


@pytest.fixture(autouse=True)
def everything(monkeypatch):
    """Let commands print all tables, as with --all."""
    monkeypatch.setattr(terminal, "MOST", 10_000)


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


@pytest.fixture
def refusal(run):
    """Return a function that runs a command that must end with one line of error; its stderr."""

    def command(*words):
        status, out, err = run(*words)
        assert (status, out) == (2, "") and len(err.splitlines()) == 1, err
        assert err.startswith("truepose: error: ")
        return err

    return command


@pytest.fixture
def plain_page(monkeypatch):
    """Write reports without their figures: most of the time of a calibration."""
    page = f"<!-- {files.mark('report')} -->"
    monkeypatch.setattr(calibration_figures, "page", lambda *_: page)


def pytest_report_header(config):
    return f"truepose {tp.__version__}; bulk samples: {config.getoption('--count') or 'default'}"
