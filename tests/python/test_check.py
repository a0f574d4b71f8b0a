"""Warnings of `truepose check` on valid robot files."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from fixtures import refused

import truepose as tp
from truepose import robotfile
from truepose.commands.robots import check, remarks, warnings
from truepose.robot import reading_units

_LENGTHS = ("base", "anchor", "arm", "rod", "pivot", "rod_spacing", "home", "minimum", "maximum")
_LENGTHS += ("origin", "length")
#: Tables whose lengths are changed.
_TABLES = ("chain", "body", "closure")


@pytest.fixture
def checked(tmp_path):
    """Return a function that writes a robot file and checks it: robot, problems in one string."""

    def checked_text(text: str):
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        robot, problems = check(path)
        assert (robot is None) == bool(problems)
        return robot, "\n".join(problems).replace(str(path), "FILE")

    return checked_text


def text_of(name: str) -> str:
    return robotfile.shipped()[name].read_text(encoding="utf-8")


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


def in_millimetres(data, angles):
    """Multiply every length; of poses the coordinates that are no angles."""
    if not isinstance(data, dict):
        return [in_millimetres(part, angles) for part in data] if data else data
    result = {key: value for key, value in data.items() if key not in _LENGTHS}
    for key, value in data.items():
        if isinstance(value, dict) or (value and isinstance(value, list) and key in _TABLES):
            result[key] = in_millimetres(value, angles)
        elif key in _LENGTHS:
            size = 1000 * np.array(value, dtype=float)
            if key in ("home", "minimum", "maximum"):
                size[angles] /= 1000
            result[key] = size.tolist()
    if "bar" in data and isinstance(data["bar"], list) and isinstance(data["bar"][0], dict):
        result["bar"] = [bar | {"pivot": 1000 * bar["pivot"]} for bar in data["bar"]]
    return result


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ("[0.3, 0.5]", ""),
        (
            "[300.0, 500.0]",
            "reads 400.00 mm at home, beyond its range 300000.00 mm to 500000.00 mm",
        ),
    ],
)
def test_home_beyond_a_sensors_range_is_remarked(checked, ends, said):
    text = changed(text_of("h4"), "resolution = 20e-6", f"range = {ends}\nresolution = 20e-6")
    robot, _ = checked(changed(text, '["theta"]', '["z_telemeter"]'))
    remarked = "\n".join(line for line in warnings(robot) if "range" in line)
    assert remarked == (f"sensor z_telemeter: {said}" if said else "")


@pytest.mark.parametrize("name", tp.list_robots())
def test_a_robot_in_millimetres_is_asked_for(checked, name):
    data = tomllib.loads(text_of(name))
    angles = [unit == "rad" for _, unit in tp.load(name).coordinates]
    robot, told = checked(tomlkit.dumps(in_millimetres(data, angles)))
    assert robot is None and re.search(r"FILE:\d+: .*\d m: did you mean mm\? -?\d+", told), told


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("h4", "limits = [-0.5236, 1.5708]", "limits = [-30, 90]", "degrees? -0.5236, 1.571 rad"),
        ("h4", "arm = 0.26 ", "yaw = 10.0\narm = 0.26 ", "degrees? 0.1745 rad"),
        ("h4", "-0.4, 0.0]", "-0.4, 20.0]", "home: the platform's angle = 20 rad: more than a"),
        ("h4", "-0.45, -0.5235987755982988]", "-0.45, -30]", "workspace.minimum: the platform's"),
        ("hexa", "-0.45, 0.4, 0.4, 0.4]", "-0.45, 20, 20, 20]", "degrees? 0.3491, 0.3491, 0.3491"),
    ],
)
def test_angles_in_degrees_are_asked_for(checked, name, old, new, told):
    robot, lines = checked(changed(text_of(name), old, new))
    assert robot is None and told in lines, lines


@pytest.mark.parametrize("name", ["q1", "q12", "measured_x", "chain1", "bar2", "time", "torque3"])
def test_a_sensor_cannot_have_a_name_that_logs_and_parameters_take(checked, h4_text, name):
    text = changed(h4_text, '"z_telemeter"', f'"{name}"')
    robot, told = checked(text)
    assert robot is None and f"sensor {name}: logs and parameters use this name" in told


@pytest.mark.parametrize(
    ("parameters", "mean", "told"),
    [
        ('["chain1.rod"]', "[-1.0]", "calibration.mean of chain1.rod = -1.0: must be greater"),
        ('["theta.gain"]', "[0.0]", "calibration.mean of theta.gain = 0.0: must not be 0"),
        ('["chain1.rod", "chain1.rod"]', "[0.48, 0.48]", "chain1.rod: a parameter is listed twice"),
    ],
)
def test_a_calibration_that_no_robot_can_have_is_refused(checked, h4_text, parameters, mean, told):
    rows = [[0.0] * k + [1e-4] for k in range(mean.count("."))]
    learnt = f"[calibration]\nparameters = {parameters}\nmean = {mean}\nroot = {rows}\n"
    robot, lines = checked(h4_text + learnt)
    assert robot is None and told in lines, lines
    first = h4_text.count("\n") + 1
    assert int(re.match(r"FILE:(\d+): ", lines)[1]) >= first


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("encoder_counts = 14400", "encoder_counts = 1e-310"),
        ("encoder_counts = 14400", "encoder_counts = 1e300"),
        ("counts = 14400 # per turn of the tool", "counts = 1e-310 #"),
        ("gear = 4.0", "gear = 1e-310"),
        ("resolution = 20e-6", "resolution = 1e-310"),
        ("resolution = 20e-6", "resolution = 1e10"),
        ("arm = 0.26", "arm = 1e300"),
    ],
)
def test_numbers_of_which_nothing_can_be_computed_are_refused(checked, h4_text, old, new):
    robot, told = checked(changed(h4_text, old, new))
    assert robot is None and "input should be" in told


def test_a_workspace_of_which_nothing_is_reached_is_refused(checked, h4_text):
    far = h4_text.replace("[-0.1, -0.1, -0.45,", "[2.1, 2.1, -0.45,")
    far = far.replace("[0.1, 0.1, -0.35,", "[2.2, 2.2, -0.35,")
    robot, told = checked(far)
    assert robot is None
    assert re.match(
        r"FILE:11: workspace: none of 14641 poses, .*: unreachable \(chain 1\): 1", told
    )


def test_what_a_workspace_holds_is_counted_on_the_whole_box(checked, h4_text):
    """Stops that cut off the fewest poses there are: corners, which random poses hardly find."""
    robot = tp.load("h4")
    box = robot.spec.workspace
    axes = np.linspace(box.minimum, box.maximum, 11).T
    q = robot.ikm(np.stack(np.meshgrid(*axes), -1).reshape(-1, 4)).max(axis=1)
    stops = float(q.max()) - 1e-6
    robot, _ = checked(
        h4_text.replace("limits = [-0.5236, 1.5708]", f"limits = [-0.5236, {stops}]")
    )
    (line,) = [line for line in remarks(robot) if "workspace" in line]
    beyond = [int(number) for number in re.findall(r"joint limit \(chain \d\): (\d+)", line)]
    assert sum(beyond) == (q > stops).sum() < 10
    assert f"{100 * (1 - sum(beyond) / 11**4):.3g} % of 11^4 = 14641 poses" in line


def test_poses_beyond_a_singularity_are_no_part_of_a_workspace(checked, h4_text):
    """At θ = 1.8 rad nothing holds the H4's nacelle; beyond, it is in another assembly mode."""
    wide = h4_text.replace("-0.35, 0.5235987755982988]", "-0.35, 2.6]")
    robot, told = checked(wide)
    assert not told
    assert any("beyond a singularity, from home: " in line for line in remarks(robot))


def test_readings_at_home_are_told(any_robot):
    first = remarks(any_robot)[1]
    q_e = [float(v) for v in re.findall(r"= (-?[\d.]+)(?:°| mm)", first)]
    factors = [180 / np.pi if unit == "rad" else 1e3 for unit in reading_units(any_robot)]
    expected = any_robot.extended_positions(any_robot.home) * factors
    assert q_e == pytest.approx(expected, abs=5.1e-3)


UPU = """
name = "3-upu"
mobility = "translation"
home = [0.0, 0.0, 0.5]
chain_defaults = { actuator = "telescopic" }
pattern = { repeat = 3 }
workspace = { minimum = [-0.1, -0.1, 0.4], maximum = [0.1, 0.1, 0.6] }
[[chain]]
base = [0.3, 0, 0]
anchor = [0.1, 0, 0]
"""


def test_single_legs_whose_orientation_something_else_holds_pass_with_a_remark(checked, rng):
    robot, told = checked(UPU)
    assert not told and "the model assumes" in "\n".join(remarks(robot))
    x = rng.uniform(robot.spec.workspace.minimum, robot.spec.workspace.maximum, (50, 3))
    assert np.abs(robot.fkm(robot.ikm(x)) - x).max() < 1e-12


def test_a_file_is_read_up_to_a_stated_size(tmp_path, h4_text):
    path = tmp_path / "robot.toml"
    text = h4_text + "#" * (robotfile.reading.MOST_BYTES - len(h4_text.encode()))
    path.write_text(text, encoding="utf-8")
    assert check(path)[0] is not None
    path.write_text(text + "#", encoding="utf-8")
    for reader in (check, tp.load):
        with refused("cannot be read: more than 1000000 bytes", tp.RobotFileError):
            reader(path)


@pytest.mark.parametrize("deep", ["home = " + "[" * 5000, "a." * 5000 + "b = 1", "x = {y" * 5000])
def test_a_file_nested_too_deeply_gets_one_line(checked, deep):
    robot, told = checked(deep)
    assert robot is None and re.fullmatch(r"FILE:1: not TOML.*", told)


def test_a_problem_that_comes_a_thousand_times_is_told_a_hundred_times(checked, h4_text):
    robot, told = checked(h4_text + "\n".join(f"k{i} = 1" for i in range(1000)))
    assert robot is None and 100 <= len(told.splitlines()) <= 300


def test_an_unknown_mobility_makes_no_long_line_and_points_to_bodies_and_closures(checked, h4_text):
    robot, told = checked(changed(h4_text, '"schoenflies"', f'"{"s" * 10_000}"'))
    assert robot is None and max(map(len, told.splitlines())) < robotfile.reading.LINE + 20
    assert "a file with [[body]] and [[closure]] needs none" in told


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("hexaglide", "drive_inertia = 5.0", "drive_inertia = 2.0", "must be at least 3 kg, the"),
        ("linear-delta", "drive_inertia = 0.15", "", "must be at least 0.1 kg, the arm_mass of"),
        ("h4", "drive_inertia = 0.017", "drive_inertia = 0.0067", "must be at least 0.00676 kg·m²"),
    ],
)
def test_a_drive_lighter_than_what_it_counts_is_refused(checked, name, old, new, told):
    text = text_of(name)
    robot, lines = checked(changed(text, old, new))
    assert robot is None and told in lines, lines
    lighter = re.sub(r"arm_mass = [\d.]+", "", changed(text, old, new))
    assert checked(lighter)[0] is not None


ORTHOGLIDE = """
name = "orthoglide"
mobility = "translation"
home = [0, 0, 0]
chain_defaults = { actuator = "prismatic", rod = 0.3, working_mode = -1, anchor = [0, 0, 0] }
chain = [
  { base = [-0.5, 0, 0], axis = [1, 0, 0] PAIR1 },
  { base = [0, -0.5, 0], axis = [0, 1, 0] PAIR2 },
  { base = [0, 0, -0.5], axis = [0, 0, 1] PAIR3 },
]
[[sensor]]
name = "lean"
kind = "rod_lateral"
chain = 1
"""


@pytest.mark.parametrize("base", [None, "0, 0, 0"], ids=["rails apart", "rails from the home"])
def test_rods_along_their_rail_are_asked_which_way_they_lie_apart(checked, run, base):
    text = re.sub(r" PAIR\d", "", ORTHOGLIDE)
    text = text if base is None else re.sub(r"base = \[.*?\]", f"base = [{base}]", text)
    robot, told = checked(text)
    assert robot is None
    asked = "chain 1: its rail and its rods are parallel at home: give"
    assert asked in told and "pair_axis" in told
    for command in ("check", "info", "accuracy"):  # in the folder that `checked` writes to
        status, _, said = run(command, "robot.toml")
        assert status and asked in said and said.count("\n") == 1


def test_an_orthoglide_whose_file_says_it_is_a_robot(checked):
    pairs = {"1": "0, 1, 0", "2": "0, 0, 1", "3": "1, 0, 0"}
    text = re.sub(r" PAIR(\d)", lambda m: f", pair_axis = [{pairs[m[1]]}]", ORTHOGLIDE)
    robot, told = checked(text)
    assert not told and robot.full
    robot = robot.with_sensors("lean")
    x = np.array([0.02, -0.03, 0.01])
    assert np.isfinite(robot.rkm(x, level="full")).all()
    assert robot.fkm(robot.ikm(x, level="full"), level="full") == pytest.approx(x, abs=1e-12)


ROD = '"chain*.rod" = { sigma = 0.0003 }'
YAW = '"chain*.yaw" = { sigma = 0.00174533 }'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("counts = 8192 # assumed", "# counts", "elbow1 has neither counts nor noise"),
        ("resolution = 20e-6", "# none", "z_telemeter has neither counts nor noise"),
        ("encoder_counts = 8192", "# none", "q1, q2, q3 have neither counts nor noise"),
        ("encoder_counts = 8192", "encoder_counts = 4", "q1: σ of its readings = 26.0°"),
        (ROD, '"chain*.rod" = { sigma = 0.05 }', "σ = 50.0 mm, 22 % of chain1.rod = 232 mm"),
        (ROD, '"chain*.rod" = { interval = [0.231, 0.233] }', "mean = 232 mm, 100 % of"),
        (ROD, '"chain*.rod_spacing" = { sigma = 0.02 }', "σ = 20.0 mm, 25 % of chain1.rod_spacing"),
        (ROD, '"chain*.rod_difference" = { sigma = 0.02 }', "rod_difference: σ = 20.0 mm"),
        (ROD, '"chain2.anchor.*" = { sigma = 0.1 }', "tolerances.chain2.anchor.*: σ = 100 mm"),
        (ROD, '"z_telemeter.origin.x" = { sigma = 0.3 }', "origin.x: σ = 300 mm"),
        (ROD, '"*[12].offset" = { sigma = 0.3 }', "tolerances.*[12].offset: σ = 17.2°, 30 %"),
        (ROD, '"chain*.gain" = { sigma = 0.3 }', "tolerances.chain*.gain: σ = 0.300, 30 %"),
        (ROD, '"compliance.all_chains" = { sigma = 0.1 }', "tolerances.compliance.all_chains: σ"),
        (YAW, '"chain*.yaw" = { sigma = 0.2 }', "σ = 11.5°, 20 % of a radian"),
        ("home = [0.0, 0.0, -0.2]", "home = [0.0, 0.08, -0.2]", "home: y = 80.00 mm is outside"),
    ],
)
def test_what_is_likely_a_mistake_is_warned_of_and_no_file_with_it_is_ok(run, old, new, said):
    Path("robot.toml").write_text(changed(text_of("delta"), old, new), encoding="utf-8")
    status, out, err = run("check", "robot.toml")
    *_, verdict = out.splitlines()
    assert (status, err) == (0, "") and verdict.startswith("robot.toml: usable, ")
    assert said in out.split("warning: ")[1]


@pytest.mark.parametrize(
    ("parameter", "tolerance"),
    [
        ("chain*.rod", "sigma = 0.3"),
        ("chain2.arm", "sigma = 0.04"),
        ("chain3.rod", "interval = [-0.25, 0.1]"),
    ],
)
def test_a_tolerance_that_leaves_no_length_is_refused(checked, parameter, tolerance):
    robot, told = checked(changed(text_of("delta"), ROD, f'"{parameter}" = {{ {tolerance} }}'))
    assert robot is None and re.search(r"FILE:7\d: tolerances\..* is no length", told), told


def test_a_shipped_robot_is_ok_and_says_what_it_takes_as_exact(any_robot, run):
    status, out, err = run("check", robotfile.shipped()[any_robot.name])
    assert (status, err) == (0, "") and out.endswith(": ok\n") and "warning" not in out
    (exact,) = re.findall(r"taken as exact: (.*)", out)
    yaw = any_robot.parameters.get("chain1.yaw")
    assert "gain" in exact and ("yaw" in exact) == (yaw is not None and yaw.sigma == 0)
    for glob in any_robot.spec.tolerances:
        assert re.search(rf"^{re.escape(glob)} .*\d", out, re.MULTILINE), glob


def test_a_checked_file_as_data_has_errors_and_the_verdict_last(run, h4_text):
    for text, status, verdict in ((h4_text, 0, "ok"), (h4_text + "wrong = 1\n", 2, "refused")):
        Path("robot.toml").write_text(text, encoding="utf-8")
        left, out, _ = run("check", "robot.toml", "--format", "json")
        data = json.loads(out)
        assert left == status and data["check"][-1] == {"kind": "verdict", "text": verdict}
        assert ("error" in {row["kind"] for row in data["check"]}) == (status == 2)
        if status == 0:
            rod = next(row for row in data["tolerances"] if row["tolerance"] == "chain*.rod")
            assert rod["unit"] == "mm" and rod["σ"] == pytest.approx(13 / 12**0.5)


@pytest.mark.parametrize("command", ["accuracy", "error-budget", "plan", "faults", "design"])
def test_predictions_with_an_exact_reading_say_so(command, run):
    text = changed(text_of("delta"), "resolution = 20e-6", "# none")
    Path("robot.toml").write_text(text, encoding="utf-8")
    sensors = ("--price", "*=1") if command == "design" else ("--sensors", "z_telemeter")
    status, _, err = run(command, "robot.toml", *sensors)
    assert status == 0 and "z_telemeter has neither counts nor noise" in err
    if command != "design":
        assert run(command, "robot.toml", "--sensors", "elbow1")[2] == ""
