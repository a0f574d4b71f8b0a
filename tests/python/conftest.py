"""What do the tests share? Robots, poses, and the size of bulk samples."""

import numpy as np
import pytest

import truepose as tp
from truepose import paper_data

FIVE_BAR = """
name = "five-bar"
mobility = "planar_translation"
home = [0.0, 0.3]
workspace = { minimum = [-0.08, 0.25], maximum = [0.08, 0.35] }
every_chain = { actuator = "revolute", arm = 0.2, rod = 0.25, axis = [0, 0, 1], anchor = [0, 0, 0] }
chain = [
  { base = [-0.1, 0, 0], working_mode = 1 },
  { base = [0.1, 0, 0], working_mode = -1 },
]
"""

DELTA = """
name = "delta"
mobility = "translation"
home = [0.0, 0.0, -0.45]
workspace = { minimum = [-0.1, -0.1, -0.5], maximum = [0.1, 0.1, -0.4] }
every_chain = { actuator = "revolute", arm = 0.2, rod = 0.45 }

[[chain]]
base = [0.15, 0, 0]
zero = [1, 0, 0]
axis = [0, 1, 0]
anchor = [0.05, 0, 0]

[[chain]]
base = [-0.075, 0.1299038105676658, 0]
zero = [-0.5, 0.8660254037844386, 0]
axis = [-0.8660254037844386, -0.5, 0]
anchor = [-0.025, 0.0433012701892219, 0]

[[chain]]
base = [-0.075, -0.1299038105676658, 0]
zero = [-0.5, -0.8660254037844386, 0]
axis = [0.8660254037844386, -0.5, 0]
anchor = [-0.025, -0.0433012701892219, 0]
"""


def hexapod() -> str:
    """Return the robot file of a 6-UPS: legs in pairs, from a wide base to a small platform."""
    lines = [
        'name = "hexapod"',
        'mobility = "spatial"',
        "home = [0, 0, -0.6, 0, 0, 0]",
        "every_chain = { actuator = 'telescopic' }",
        "[workspace]",
        "minimum = [-0.1, -0.1, -0.7, -0.2, -0.2, -0.2]",
        "maximum = [0.1, 0.1, -0.5, 0.2, 0.2, 0.2]",
    ]
    for leg in range(6):
        pair, side = 120 * (leg // 2), 1 if leg % 2 else -1
        below, above = np.radians(pair + 15 * side), np.radians(pair + 50 * side)
        base = [0.5 * float(f(below)) for f in (np.cos, np.sin)]
        anchor = [0.25 * float(f(above)) for f in (np.cos, np.sin)]
        lines += ["[[chain]]", f"base = {[*base, 0.0]}", f"anchor = {[*anchor, 0.0]}"]
    return "\n".join(lines)


ROBOTS = {"delta": DELTA, "hexapod": hexapod(), "five-bar": FIVE_BAR}


def pytest_addoption(parser):
    parser.addoption(
        "--count",
        type=int,
        default=100_000,
        help="poses in bulk samples; the full check is --count=1000000",
    )


@pytest.fixture(scope="session")
def count(request) -> int:
    return request.config.getoption("--count")


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
    return paper_data.table2()


@pytest.fixture(scope="session")
def h4_text() -> str:
    """Return the H4's robot file, to spoil."""
    from truepose import robot_file

    return robot_file.shipped()["h4"].read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def hexapod_text() -> str:
    return ROBOTS["hexapod"]


@pytest.fixture(params=["h4", *ROBOTS])
def any_robot(request, tmp_path) -> tp.Robot:
    """Return an H4, and robots of other mobilities and actuators from files of their own."""
    if request.param == "h4":
        return tp.load("h4")
    path = tmp_path / "robot.toml"
    path.write_text(ROBOTS[request.param], encoding="utf-8")
    return tp.load(path)


@pytest.fixture
def delta(tmp_path) -> tp.Robot:
    """Return a robot without sensors and without bars."""
    path = tmp_path / "delta.toml"
    path.write_text(DELTA, encoding="utf-8")
    return tp.load(path)


@pytest.fixture(scope="session")
def anywhere():
    """Return a function that draws poses from a robot's workspace box."""

    def draw(robot: tp.Robot, count: int, rng: np.random.Generator) -> np.ndarray:
        box = robot.spec.workspace
        return rng.uniform(box.minimum, box.maximum, size=(count, robot.n))

    return draw


def pytest_report_header(config):
    return f"truepose {tp.__version__}; bulk samples of {config.getoption('--count')} poses"
