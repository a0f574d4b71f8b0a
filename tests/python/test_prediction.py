"""Output and refusals of `truepose accuracy`."""

import re

import numpy as np
import pytest

import truepose as tp
from truepose.commands import accuracy
from truepose.design import prediction
from truepose.robot import summed
from truepose.robot.maps import workspace_slice


def test_default_sets_are_none_those_in_use_each_further_one_and_all(h4):
    sets = prediction.sensor_sets(h4)
    assert sets[:3] == [(), ("theta",), ("theta", "z_telemeter")]
    assert set(sets[-1]) == {s.name for s in h4.spec.sensor} and len(set(sets)) == len(sets)
    for robot in map(tp.load, tp.list_robots()):
        sets = prediction.sensor_sets(robot)
        assert all(robot.with_sensors(*names).r == len(names) for names in sets)
        kinds = {s.name: s.kind for s in robot.spec.sensor if s.name not in robot.sensors}
        for kind in kinds.values():
            assert (*robot.sensors, *(name for name in kinds if kinds[name] == kind)) in sets


def test_every_robot_has_its_prediction(any_robot, anywhere, rng):
    """More is never worse: a row's σ is at most that of motors alone; learning helps or not."""
    poses = anywhere(any_robot, 30, rng)
    found = prediction.predict(
        any_robot, poses=poses, calibrated=True, reference_pose=any_robot.home
    )
    assert list(found.sigma) == [
        "as built",
        "as built, referenced",
        "self-calibrated",
        "self-calibrated, referenced",
    ]
    for sigma in found.sigma.values():
        assert sigma.shape == (len(found.sets), any_robot.n + 1) and (sigma > 0).all()
    drawn, learnt = found.sigma["as built"], found.sigma["self-calibrated"]
    assert (drawn <= drawn[0] * (1 + 1e-6)).all() and (learnt <= drawn * (1 + 1e-6)).all()


def test_the_rows_are_root_mean_squares_of_the_bound(h4, table2):
    poses = table2[::50]
    found = prediction.predict(h4, [["theta"]], poses)
    variance = np.einsum("kii->ki", tp.accuracy(h4, poses)).mean(axis=0)
    assert found.sigma["as built"][0, :4] == pytest.approx(np.sqrt(variance))
    assert found.sigma["as built"][0, 4] == pytest.approx(np.sqrt(variance[:3].sum()))
    (table,) = accuracy.tables(found)
    assert table.header == ["sensors", "x (mm)", "y (mm)", "z (mm)", "theta (°)", "position (mm)"]
    assert float(table.rows[0][4]) == pytest.approx(np.degrees(np.sqrt(variance[3])), rel=1e-2)


def test_unreachable_corners_of_a_workspace_are_left_out_and_counted(h4):
    box = h4.spec.workspace.model_copy(update={"minimum": (-1.0, -0.1, -0.45, -0.5)})
    robot = h4.with_file(workspace=box)
    found = prediction.predict(robot, [["theta"]])
    assert found.left_out > 100 and len(found.poses) + found.left_out == 625
    assert np.isfinite(found.sigma["as built"]).all()


def test_the_command_prints_a_table_of_sensor_sets(run):
    status, out, err = run("accuracy", "delta", "--calibrated", "--reference-pose", "0,0,-0.2")
    assert (status, err) == (0, "")
    for words in ("as built", "self-calibrated", "self-calibrated, referenced", "motors alone"):
        assert words in out
    assert "elbow2" in out and "all 4" in out and "125 poses of a grid over the workspace" in out


def test_the_command_takes_sets_poses_and_a_level(run, tmp_path, table2):
    path = tmp_path / "poses.csv"
    lines = [",".join(map(str, pose)) for pose in table2[::25]]
    path.write_text("x, y, z, theta\n" + "\n".join(lines) + "\n", encoding="utf-8")
    words = ("--sensors", "theta", "--sensors", "theta,z_telemeter", "--sensors", "none")
    status, out, err = run("accuracy", "h4", *words, "--poses", path, "--level", "full")
    assert (status, err) == (0, "")
    bound = out[out.index("bound of the pose") :]
    rows = [line.split() for line in bound.splitlines() if re.search(r"\d\.\d+ +\d", line)]
    assert [row[0] for row in rows] == ["theta", "theta,", "motors"]
    P = tp.accuracy(tp.load("h4"), table2[::25], level="full")
    position = 1e3 * np.sqrt(np.einsum("kii->ki", P)[:, :3].sum(axis=1).mean())
    assert float(rows[0][-1]) == pytest.approx(position, rel=1e-2)
    assert "25 poses of" in out


@pytest.mark.parametrize("law", ["joint", "tej", "weighted", "estimated"])
@pytest.mark.parametrize("name", ["h4", "3rrr", "g1-ankle"])
def test_the_predicted_error_of_a_law_is_that_of_sampled_robots(name, law, anywhere, rng):
    robot = tp.load(name)  # with sensors that have counts, and no noise that is not sampled here
    robot = robot.with_sensors(*("*_encoder" if name == "g1-ankle" else "all",))
    x = anywhere(robot, 5, rng)
    squares = []
    for seed in range(200):
        away = tp.steady_state(robot, robot.sample(seed), x, law) - x
        squares.append((away[:, summed(robot).columns] ** 2).sum(axis=1).mean())
    sampled = np.sqrt(np.mean(squares))  # to 1/sqrt(2 · 200 · a few) of itself
    assert prediction.steady_state_error(robot, x, law) == pytest.approx(sampled, rel=0.12)


@pytest.mark.parametrize("referenced", [False, True])
def test_the_overview_names_the_best_law_sensors_and_poses(run, h4, referenced):
    home = h4.home if referenced else None
    found = prediction.predict(h4, [["theta"], ["theta", "wire*"]], reference_pose=home)
    table, _ = prediction.overview(found)
    half = np.random.default_rng(0).permutation(found.poses)[:40]
    columns = {"40 poses (mm)": half} | ({"referenced (mm)": None} if referenced else {})
    for record, names in zip(table.records(), (["theta", "wire*"], ["theta"]), strict=True):
        for column, visited in columns.items():  # the best first
            known = tp.accuracy(h4.with_sensors(*names), found.poses, visited, home).rms
            assert record[column] == pytest.approx(1e3 * known)
    words = ("--sensors", "theta", *(("--reference-pose", "0,0,-0.4,0") if referenced else ()))
    out = " ".join(run("accuracy", "h4", *words)[1].split())
    assert re.search(rf"on 160 poses{' and referenced' * referenced}, theta: \d\.\d+ mm", out)
    assert bool(re.search(r"Referenced, theta: 0\.\d+ mm", out)) == referenced
    assert "the bound uses the mean: chain1.arm" in out


def test_the_command_draws_a_map(run, refusal, tmp_path):
    words = ("--sensors", "theta,z_telemeter", "--plot", "map.png", "--calibrated")
    assert run("accuracy", "h4", *words)[0] == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert "--plot no/map.png: cannot be written" in refusal(
        "accuracy", "h4", "--sensors", "theta", "--plot", "no/map.png"
    )


def test_the_map_shows_the_bound(h4):
    x = workspace_slice(h4, 11)
    found = tp.accuracy(h4, x)
    figure = found.plot()
    title = figure.subfigs[0].get_suptitle()
    assert title.startswith("h4, as built\nslice through home")
    sigma = 1e3 * np.sqrt(np.einsum("ijkk->ijk", found)[..., :3].sum(axis=-1))
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((0, sigma.max()), rel=1e-6)
    row, column = np.unravel_index(sigma.argmax(), sigma.shape)
    ring = figure.axes[0].lines[-1]
    assert np.ravel(ring.get_data()) == pytest.approx(1e3 * x[row, column, :2])
    assert figure.subfigs[1].get_suptitle() == "sensors in use: theta"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("h4", "--sensors", "tetha"), "unknown sensor 'tetha'; did you mean 'theta'?"),
        (("h4", "--sensors", "theta,theta"), "a sensor is named twice: theta, theta"),
        (("h4", "--reference-pose", "0,0,-0.4"), "must be 4 numbers, x,y,z,theta (m, rad)"),
        (("h4", "--reference-pose", "0,0,high,0"), "must be 4 numbers, x,y,z,theta (m, rad)"),
        (("h4", "--reference-pose", "0,0,-4,0"), "pose x = [0, 0, -4, 0]: chain 1: unreachable"),
        (("h4", "--level", "real"), "'--level': 'real' is not one of 'ideal', 'full'"),
        (("h4", "--poses", "none.csv"), "none.csv: cannot be read: No such file"),
        (("h4", "--poses", "columns.csv"), "columns.csv: no column 'z' (choices: x, y, theta)"),
        (("h4", "--poses", "words.csv"), "words.csv: line 3: theta = 'left': must be a number"),
        (("h4", "--poses", "short.csv"), "short.csv: line 2: 3 cells, must be 4"),
        (("h4", "--poses", "empty.csv"), "empty.csv: no line of values"),
    ],
)
def test_a_question_that_cannot_be_answered_is_one_line(refusal, tmp_path, words, message):
    header = "x,y,z,theta\n"
    (tmp_path / "columns.csv").write_text("x,y,theta\n0,0,0\n")
    (tmp_path / "words.csv").write_text(header + "0,0,-0.4,0\n0,0,-0.4,left\n")
    (tmp_path / "short.csv").write_text(header + "0,0,-0.4\n")
    (tmp_path / "empty.csv").write_text(header)
    assert message in refusal("accuracy", *words)
