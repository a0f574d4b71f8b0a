"""`truepose simulate` against `tp.simulate`."""

import json

import numpy as np
import pytest
from fixtures import CHAINED

import truepose as tp
from truepose import logs
from truepose.robot import summed


def rows(said: str, name: str = "errors") -> dict[str, dict]:
    return {str(row.get("error", row.get("motor"))): row for row in json.loads(said)[name]}


@pytest.mark.parametrize("effects", ["none", "all"])
@pytest.mark.parametrize("name", CHAINED)
def test_every_robot_makes_a_move_at_the_defaults_and_rests(run, name, effects):
    status, said, err = run("simulate", name, "--effects", effects, "--format", "json")
    assert status == 0 and err.endswith("true robot sampled with seed 0: ok\n")
    errors = rows(said)
    coordinates = [coordinate for coordinate, _ in tp.load(name).coordinates]
    total = summed(tp.load(name)).name
    assert list(errors) == [*coordinates, total]
    assert 0 < errors[total]["at the end"] <= errors[total]["largest"] < 30


def test_a_nominal_robot_has_no_errors_but_its_counts(run):
    errors = rows(run("simulate", "h4", "--true", "nominal", "--format", "json")[1])
    assert errors["position"]["at the end"] < 0.2
    errors = rows(run("simulate", "h4", "--true", "h4-lirmm-twin", "--format", "json")[1])
    assert errors["position"]["at the end"] > 2


@pytest.mark.parametrize(
    ("words", "poles"),
    [
        ((), 150),
        (("--effects", "all"), tp.Controller.for_robot(tp.load("h4")).frequency),
        (("--effects", "all", "--frequency", "30"), 30),
        (("--frequency", "30"), 30),
    ],
)
def test_the_poles_are_the_papers_what_the_robot_bears_or_those_asked_for(run, words, poles):
    assert f"poles {poles:.3g} rad/s" in run("simulate", "h4", *words)[1]


def test_a_path_is_visited_and_its_log_can_be_calibrated_on(run, tmp_path):
    rng = np.random.default_rng(0)
    box = tp.load("h4").spec.workspace
    poses = rng.uniform(box.minimum, box.maximum, (40, 4))
    lines = [",".join(map(repr, pose)) for pose in poses.tolist()]
    (tmp_path / "path.csv").write_text("\n".join(["x,y,z,theta", *lines]), encoding="utf-8")
    words = ("--path", "path.csv", "-o", "log.csv", "--plot", "path.png")
    status, said, err = run("simulate", "h4", "--law", "joint", *words, "--format", "json")
    assert (status, err.splitlines()[0][-22:]) == (0, "40 of 40 poses reached")
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")
    fit = tp.calibrate(tp.load("h4"), logs.read(tp.load("h4"), tmp_path / "log.csv").readings)
    assert fit.parameters["chain1.rod"].sigma < 0.5 * tp.load("h4").parameters["chain1.rod"].sigma
    errors = rows(said)
    assert errors["x"]["rms"] >= abs(errors["x"]["mean"])
    assert "log.csv" in err


ENDS = [[0, 0, -0.4, 0], [0.1, 0, -0.4, 0.2]]
MOVES = {
    ("--circle", "0.05,2,1.5"): tp.simulation.Circle(
        centre=tp.load("h4").home, radius=0.05, frequency=2, turns=1.5
    ),
    ("--way-points", "poses.csv", "--duration", "0.3"): tp.simulation.Waypoints(
        poses=ENDS, duration=0.3
    ),
    ("--path", "timed.csv"): tp.simulation.SampledPath(
        time=[0, 0.3, 0.6], x=[ENDS[0], [0.05, 0, -0.4, 0], ENDS[1]]
    ),
    ("--to", "0.05,0,-0.4,0.1"): None,
}


@pytest.mark.parametrize("words", MOVES, ids=lambda words: words[0])
def test_it_prints_and_writes_what_the_library_simulates(run, tmp_path, words):
    """Cycle by cycle."""
    (tmp_path / "poses.csv").write_text("x,y,z,theta\n0,0,-0.4,0\n0.1,0,-0.4,0.2\n", "utf-8")
    timed = "time,x,y,z,theta\n1,0,0,-0.4,0\n1.3,0.05,0,-0.4,0\n1.6,0.1,0,-0.4,0.2\n"
    (tmp_path / "timed.csv").write_text(timed, "utf-8")
    more = ("--law", "estimated", "--seed", "4", "-o", "log.csv", "--format", "json")
    h4, (status, said, err) = tp.load("h4"), run("simulate", "h4", *words, *more)
    assert status == 0 and ", poles 150 rad/s, true robot sampled with seed 4: ok" in err
    how = tp.simulation.Run(seed=4)
    if (path := MOVES[words]) is None:
        how = tp.simulation.Run(start=[0, 0, -0.5, 0], end=[0.05, 0, -0.4, 0.1], seed=4)
    alone = tp.simulate(h4, h4.sample(4).with_level("full"), "estimated", path=path, run=how)
    np.testing.assert_array_equal(logs.read(h4, tmp_path / "log.csv").readings, alone.q_e)
    rms = 1e3 * np.sqrt((alone.error[:, 0] ** 2).mean())
    assert rows(said)["x"]["rms"] == pytest.approx(rms)
    turn, torque = np.degrees(np.abs(alone.error[:, 3]).max()), np.abs(alone.torque[:, 1]).max()
    assert rows(said)["theta"]["largest"] == pytest.approx(turn, rel=1e-9)
    assert rows(said, "motors")["2"]["largest"] == pytest.approx(torque, rel=1e-9)


def test_a_path_of_poses_refuses_a_safety_shell_and_a_fault_after_its_last_pose(
    run, refusal, tmp_path
):
    (tmp_path / "path.csv").write_text("x,y,z,theta\n0,0,-0.4,0\n0,0,-0.42,0\n", "utf-8")
    words = ("simulate", "h4", "--path", "path.csv", "--fault")
    assert run(*words, "theta:bias=0.01@1.2")[0] == 0
    assert "--safety: only for moves and paths in time" in refusal(
        "simulate", "h4", "--path", "path.csv", "--safety"
    )
    assert "after the end of the run, 1.8 s" in refusal(*words, "theta:bias=0.01@2")


def test_poses_out_of_reach_are_told_and_left_empty(run, refusal, tmp_path):
    (tmp_path / "path.csv").write_text("x,y,z\n0,0,-0.2\n0,0,-3\n", encoding="utf-8")
    status, said, _ = run("simulate", "delta", "--path", "path.csv", "-o", "log.csv")
    assert status == 0 and "1 of 2 poses reached; pose 1: " in said
    assert (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()[-1].startswith("1.0,,")
    (tmp_path / "path.csv").write_text("x,y,z\n0,0,-3\n", encoding="utf-8")
    assert "delta: 0 of 1 poses reached; pose 0: " in refusal(
        "simulate", "delta", "--path", "path.csv"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--law", "tejs"), "--law"),
        (("--effects", "gravity"), "--effects: unknown effect 'gravity' (choices: all, none, "),
        (("--to", "1,2"), "--to 1,2: must be 4 numbers, x,y,z,theta (m, rad)"),
        (("--to", "0,0,-3,0"), "h4: end of the move: pose x = [0, 0, -3, 0]: chain 1: unreachable"),
        (("--path", "p.csv", "--to", "0,0,-0.4,0"), "--path: defines all poses"),
        (("--circle", "0.05"), "--circle 0.05: must be radius, turns per second, and turns"),
        (("--circle", "0.05,2", "--path", "p.csv"), "--path, --circle: name one of them"),
        (("--circle", "0.05,2", "--to", "0,0,-0.4,0"), "--circle: defines all poses: leave"),
        (("--circle", "0.1,9", "--from", "0,0,-0.42,0"), "h4: path at t = 0.043 s: motor 2 would"),
        (("--circle", "0.5,0.1"), "h4: path at t = 0 s: pose x = [0.5, 0, -0.4, 0]: chain"),
        (("--duration", "0"), "duration = 0.0: must be"),
        (("--duration", "1", "--circle", "0.05,2"), "--duration: --circle and a --path with times"),
        (("--fault", "theta:stuck@1"), "theta:stuck@1: begins after the end of the run, 0.4 s"),
        (("--forces",), "--forces: only with --monitor"),
        (
            ("--start-test", "--fault", "q1:swap=q2"),
            "--start-test: truepose start-test ROBOT is in the package truepose-safety",
        ),
        (("-o", "log.xyz"), "log.xyz: unknown ending '.xyz'"),
        (("--true", "h5"), "unknown robot 'h5'"),
        (("--true", "delta"), "unknown sensor 'theta'"),
    ],
)
def test_what_cannot_be_simulated_is_one_line(refusal, words, said):
    assert said in refusal("simulate", "h4", *words)


@pytest.mark.parametrize(
    "words, said",
    [
        (("--monitor", "--forces"), "--forces: the observer of external forces is in the package"),
        (("--safety",), "--safety: the safety shell is in the package truepose-safety: in a"),
    ],
)
def test_what_supervises_a_run_is_in_a_package(refusal, monkeypatch, words, said):
    monkeypatch.setattr("truepose.commands.simulate.plugins", lambda group: {})
    assert said in refusal("simulate", "h4", *words)
