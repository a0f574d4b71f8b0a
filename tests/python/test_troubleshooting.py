"""Messages of the troubleshooting page: each is raised as the page quotes it."""

import re
from pathlib import Path

import numpy as np
import pytest
from fixtures import drawn_poses, refused
from typer.testing import CliRunner

import truepose as tp
from truepose.commands.cli import app
from truepose.robot import frames

PAGE = Path(__file__).parents[2] / "docs" / "troubleshooting.md"
QUOTED = re.findall(r"^\| `([^`]+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def robot_file(tmp_path, old, new):
    path = tmp_path / "robot.toml"
    tp.load("h4").save(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    raise tp.RobotFileError(CliRunner().invoke(app, ["check", str(path)]).output.strip())


def log(column, change):
    h4 = tp.load("h4")
    poses = drawn_poses(h4, 50, 0)
    readings = dict(zip(h4.readings, h4.read(poses, 0).T, strict=True))
    tp.calibrate(h4, readings | {column: change(readings[column])})


def motors_alone(_):
    delta = tp.load("delta")
    columns = np.tile(delta.ikm(delta.home)[:, None], (1, 9))
    tp.calibrate(delta, dict(zip(delta.readings, columns, strict=True)))


def law_without_sensor(_):
    delta = tp.load("delta")
    tp.steady_state(delta, delta, delta.home, "tej")


def tracked(name, change):
    """Calibrate by a tracker whose measurement is changed."""
    robot = tp.load(name).with_sensors("roll", "pitch")
    box, rng = robot.spec.workspace, np.random.default_rng(0)
    x = rng.uniform(box.minimum, box.maximum, (40, robot.n))
    measured = change(x + rng.normal(0, 2e-5, x.shape), rng)
    log = dict(zip(robot.readings, robot.read(x, 0).T, strict=True))
    names = (f"measured_{name}" for name, _ in robot.coordinates)
    tp.calibrate(robot, log | dict(zip(names, measured.T, strict=True)))


def as_euler_angles(x, _):
    turns = frames.rotation(x[:, 3:])
    pitch = -np.arcsin(turns[:, 2, 0])
    roll, yaw = (np.arctan2(*of) for of in (turns[:, 2, [1, 2]].T, turns[:, [1, 0], 0].T))
    return np.column_stack([x[:, :3], roll, pitch, yaw])


CAUSES = {
    "unknown key": lambda folder: robot_file(folder, "arm = 0.26", "arn = 0.26"),
    "did you mean mm": lambda folder: robot_file(folder, "arm = 0.26", "arm = 260"),
    "unreachable": lambda _: tp.load("h4").ikm([0, 0, -2, 0]),
    "needs a redundant sensor": law_without_sensor,
    "in degrees": lambda _: log("q1", np.degrees),
    "sign": lambda _: log("q1", np.negative),
    "stuck": lambda _: log("theta", lambda column: np.full_like(column, 0.1)),
    "against no mistake": lambda _: log("q1", lambda column: column + 0.09),
    "are Euler angles": lambda _: tracked("stewart", as_euler_angles),
    "times their noise": lambda _: tracked("stewart", lambda x, rng: rng.permutation(x)),
    "motors determine only the pose": motors_alone,
    "would need": lambda _: tp.simulate(tp.load("h4"), run=tp.simulation.Run(duration=0.02)),
    "cannot hold": lambda _: tp.Controller.for_robot(tp.load("h4"), period=0.02),
}


def test_the_page_has_every_cause_once():
    assert len(QUOTED) == len(CAUSES)


@pytest.mark.parametrize("words", CAUSES)
def test_a_message_is_raised_as_the_page_quotes_it(words, tmp_path):
    (quoted,) = (message for message in QUOTED if words in message)
    with refused(re.escape(quoted).replace("…", "(?s:.*)"), tp.TrueposeError):
        CAUSES[words](tmp_path)
