"""Output and status of check, new and info."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import truepose as tp
from truepose import moved
from truepose.commands import cli, info


@pytest.mark.parametrize("name", tp.list_robots())
def test_a_starter_file_of_every_kind_passes_the_check(run, name, tmp_path):
    assert run("new", name, "-o", "mine.toml")[0] == 0
    status, out, err = run("check", "mine.toml")
    robot = tp.load(tmp_path / "mine.toml")
    assert (status, err) == (0, "")
    assert out.startswith(f"mine.toml: mine, n = {robot.n} freedoms, m = {robot.m} motors, r = ")
    assert f"{len(robot.parameters)} parameters" in out
    assert "readings at home: q1 = " in out and "reached and regular" in out
    assert robot.parameters == tp.load(name).parameters
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8").startswith(f"# A {name} to start")


def test_new_overwrites_nothing(run, tmp_path):
    (tmp_path / "delta.toml").write_text("mine", encoding="utf-8")
    status, _, err = run("new", "delta")
    assert (status, err) == (
        2,
        "truepose: error: delta.toml: exists and is not overwritten; choose another file with -o\n",
    )
    assert (tmp_path / "delta.toml").read_text(encoding="utf-8") == "mine"


def test_new_knows_its_kinds_and_its_folders(run):
    assert "unknown robot 'detla'; did you mean 'delta'? (choices: " in run("new", "detla")[2]
    assert "cannot be written: No such file" in run("new", "delta", "-o", "no/where.toml")[2]


def test_check_tells_every_problem_at_once_with_its_line(run, h4_text, tmp_path):
    spoiled = {
        "home = [0.0, 0.0, -0.4, 0.0]": "home = [0.0, 0.0]",
        "arm = 0.26 ": "am = 0.26 ",
        "rod = 0.48 ": "rod = -0.48 ",
        "axis = [0.0, 1.0, 0.0]": "axis = [0.0, 2.0, 0.0]",
        'mobility = "schoenflies"': 'mobility = "spatial"',
        "sigma = 0.0003": "sgma = 0.0003",
        "gear = 4.0": 'gear = "4"',
        '"z_telemeter"': '"theta"',
    }
    for old, new in spoiled.items():
        assert old in h4_text
        h4_text = h4_text.replace(old, new, 1)
    (tmp_path / "bad.toml").write_text(h4_text, encoding="utf-8")
    status, out, err = run("check", "bad.toml")
    assert (status, out) == (2, "")
    lines = h4_text.splitlines()
    found = []
    for problem in err.splitlines():
        name, number, what = problem.split(":", 2)
        assert name == "bad.toml"
        found.append((lines[int(number) - 1].split(" #")[0].strip(), what.strip()))
    expected = [
        ('mobility = "spatial"', "spatial has 6 freedoms: give 6 chains, not 4"),
        ("home = [0.0, 0.0]", "home needs 6 coordinates, has 2"),
        ("minimum = [-0.1", "workspace.minimum needs 6 coordinates, has 4"),
        ("am = 0.26", "chain_defaults.am: unknown key 'am'; did you mean 'arm'? (choices: "),
        ("rod = -0.48", "chain_defaults.rod = -0.48: input should be greater than 0"),
        ("axis = [0.0, 2.0, 0.0]", "chain.1.axis = [0.0, 2.0, 0.0]: must have length 1, has 2"),
        ('gear = "4"', "sensor.1.gear = '4': input should be a valid number"),
        ('name = "theta"', "two sensors have the same name: theta"),
        ('"chain*.base.*" = { sgma', "tolerances.chain*.base.*.sgma: unknown key 'sgma'"),
    ]
    for line, what in expected:
        assert any(a.startswith(line) and b.startswith(what) for a, b in found), (line, what, err)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('"chain*.rod"', '"chian*.rod"', r"bad.toml:\d+: tolerances: unknown parameter 'chian\*"),
        ('["theta"]', '["tetha", "x"]', r"(?s)bad.toml:9: unknown sensor 'tetha'.*sensor 'x'"),
        ("-0.4, 0.0]", "-4.0, 0.0]", r"bad.toml:7: h4: home = .*: unreachable, chain 1"),
        ("home =", "home", r"bad.toml:7: not TOML"),
    ],
)
def test_check_tells_what_only_the_mechanism_shows(run, h4_text, tmp_path, old, new, line):
    (tmp_path / "bad.toml").write_text(h4_text.replace(old, new, 1), encoding="utf-8")
    status, _, err = run("check", "bad.toml")
    assert status == 2 and re.match(line, err), err


def test_check_points_into_a_pattern_once(run, tmp_path):
    run("new", "par4", "-o", "bad.toml")
    path = tmp_path / "bad.toml"
    text = path.read_text(encoding="utf-8").replace("bar = [1, 2]", "bar = [1, 2, 1]")
    path.write_text(text.replace("bar = [2, 1]", "bar = [2, 0]"), encoding="utf-8")
    lines = [n for n, line in enumerate(text.splitlines(), 1) if line.startswith("bar = [")]
    _, _, err = run("check", "bad.toml")
    assert err.splitlines() == [
        f"bad.toml:{lines[0]}: chain.1.bar = [1, 2, 1]: give one value, or 2, one a copy",
        f"bad.toml:{lines[1]}: chain.2.bar = 0: input should be greater than or equal to 1",
    ]


def test_check_of_a_file_based_on_another(run, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('based_on = "delta"\n[parameters]\n"chain1.rd" = 1\n', encoding="utf-8")
    assert run("check", path)[2].startswith(f"{path}:3: parameters: unknown parameter 'chain1.rd'")
    path.write_text('based_on = "dleta"\n', encoding="utf-8")
    assert run("check", path)[2].startswith(f"{path}:1: based_on: unknown robot 'dleta'; did you")


@pytest.mark.parametrize(
    "command", ["check", "new", "info", "accuracy", "margins", "plan", "design", "calibrate"]
)
def test_help_has_an_example(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0 and f"Example: truepose {command}" in re.sub(r"\s+", " ", out)


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize(
    "command", ["list", "margins", "plan", "design", "simulate", "simulate-log"]
)
def test_the_examples_of_the_help_run(run, command):
    told = get_command(cli.app).commands[command].help.partition("Example: ")[2]
    examples = re.findall(r"\*\*truepose (.+?)\*\*", told, re.DOTALL)
    assert examples[0].startswith(command)
    for line in examples:
        assert run(*line.split())[0] == 0


def test_the_shipped_robots_are_listed_for_people_and_for_programs(run):
    _, said, _ = run("list")
    row = next(line for line in said.splitlines() if line.startswith("delta "))
    assert row.split("  ")[0] == "delta" and "3 revolute" in row and "z_telemeter, elbow*" in row
    listed = {row["robot"]: row for row in json.loads(run("list", "--format", "json")[1])["robots"]}
    assert list(listed) == tp.list_robots()
    for name, row in listed.items():
        robot = tp.load(name)
        assert (row["n"], row["mobility"]) == (robot.n, robot.spec.mobility)
        used, spare = row["sensors in use"].split(), row["further sensors"].split()
        assert sorted(used + spare) == sorted(sensor.name for sensor in robot.spec.sensor)
        assert "assumed" in row["numbers from"] and row["full level"] == robot.full.reason


@pytest.mark.parametrize("name", tp.list_robots())
def test_info_prints_the_figures_of_every_robot(run, name):
    status, out, err = run("info", name, "--samples", "500")
    assert (status, err) == (0, "")
    first, unit = tp.load(name).coordinates[0]
    workspace = f"workspace {first}"
    for word in ("degrees of freedom", "actuators", "redundant sensors", workspace, "motor 1"):
        assert word in out
    assert "100 % of 500 poses, seed 0" in out and f"fastest motor at 1 {unit}/s" in out


def test_info_draws_the_conditioning_map(run, tmp_path):
    assert run("info", "five-bar", "--samples", "100", "--plot", "map.png")[0] == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert "--plot no/map.png: cannot be written" in run("info", "h4", "--plot", "no/map.png")[2]
    assert "unknown ending '.xyz' (choices: .png" in run("info", "h4", "--plot", "map.xyz")[2]


def test_info_needs_a_workspace(run, tmp_path, h4_text):
    a, b = h4_text.index("[workspace]"), h4_text.index("[chain_defaults]")
    (tmp_path / "mine.toml").write_text(h4_text[:a] + h4_text[b:], encoding="utf-8")
    said = "h4: no [workspace] minimum, maximum in its file"
    assert run("info", "mine.toml")[2] == f"truepose: error: {said}\n"


def test_the_condition_number_and_the_speeds_are_those_of_one_pose_by_hand(h4):
    """A box of one pose: no statistics, only J."""
    x = np.array([0.05, -0.02, -0.42, 0.3])
    box = h4.spec.workspace.model_copy(update={"minimum": tuple(x), "maximum": tuple(x)})
    robot = h4.with_file(workspace=box)
    figures = info.measure(robot, samples=3)
    K = np.linalg.inv(h4.jacobian(x))
    scaled = np.diag([1, 1, 1, info.LENGTH]) @ h4.jacobian(x)
    assert figures.condition == pytest.approx([np.linalg.cond(scaled)] * 3)
    assert figures.moving.value == pytest.approx(np.linalg.norm(K[:, :3], axis=1).max())
    assert figures.turning.value == pytest.approx(np.abs(K[:, 3]).max())
    assert figures.turning.motor == np.abs(K[:, 3]).argmax() + 1
    assert figures.moving.pose == pytest.approx(x)
    assert figures.q_min == pytest.approx(h4.ikm(x)) == figures.q_max


def test_what_is_out_of_reach_lowers_the_fraction_and_greys_the_map(h4):
    box = h4.spec.workspace
    wide = box.model_copy(update={"minimum": (-1.0, *box.minimum[1:])})
    robot = h4.with_file(workspace=wide)
    assert 0.1 < info.measure(robot, samples=2000).reachable < 0.9
    x, condition = info.condition_map(robot, points=21)
    assert x[0, 0, 0] == -1 and x[-1, -1, 1] == 0.1
    assert np.isnan(condition[:, 0]).all() and np.isfinite(condition[:, -1]).all()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("truepose si", ["simulate", "simulate-log"]),
        ("truepose info hexa", ["hexa", "hexaglide"]),
        ("truepose calibrate ste", ["stewart"]),
        ("truepose new lin", ["linear-delta"]),
        ("truepose simulate h4 --true no", ["nominal"]),
        ("truepose simulate-log h4 --effects ecc", ["eccentricity"]),
        ("truepose simulate h4 --law car", ["cartesian"]),
        ("truepose simulate h4 --fault theta:dr", ["theta:dropout", "theta:drift"]),
        ("truepose simulate h4 --fault th", []),
        ("truepose info my_ro", []),  # the shell then offers files
    ],
)
def test_a_shell_completes_commands_robots_and_choices(run, monkeypatch, line, words):
    monkeypatch.setenv("_TRUEPOSE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
    assert run()[1].split() == words


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_of_each_shell_can_be_shown(run, monkeypatch, shell):
    monkeypatch.setenv("_TRUEPOSE_COMPLETE", f"source_{shell}")
    status, shown, _ = run()
    assert status == 0 and f"_TRUEPOSE_COMPLETE=complete_{shell}" in shown


def test_python_m_truepose_is_the_command_line():
    words = [sys.executable, "-m", "truepose", "list", "--help"]
    shown = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert "Usage: truepose list" in shown


@pytest.mark.parametrize("page", ["docs/get-started.md", "docs/calibration.md"])
def test_a_page_shows_commands_that_there_are(run, page):
    text = (Path(__file__).parents[2] / page).read_text(encoding="utf-8")
    shown = set(re.findall(r"^    (?:\.venv/bin/)?truepose ([a-z-]+)", text, re.M))
    assert shown
    for command in shown - moved.COMMANDS.keys():  # those of packages: their own tests
        assert run(command, "--help")[0] == 0
