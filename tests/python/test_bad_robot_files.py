"""Messages for wrong robot files. One line: file, key, value, choices."""

import re

import pytest
from fixtures import refused

import truepose as tp


def complaint(path) -> str:
    with pytest.raises(tp.RobotFileError) as raised:
        tp.load(path)
    message = str(raised.value)
    assert len(message.splitlines()) == 1, message
    assert str(path) in message
    return message.replace(str(path), "FILE")


NO_SUCH_PART = 9

SPOILED = [
    # what to change, into what, what the line says after the file's name
    ("arm = 0.26 ", "#", r"chain.1: a revolute chain needs 'arm' \(m\)"),
    ("home = [0.0, 0.0, -0.4, 0.0]", "", "home: is missing"),
    ('actuator = "revolute"', "", "chain.1.actuator: is missing"),
    (
        'kind = "plane_distance"',
        "",
        r"sensor.2.kind: is missing \(choices: platform_angle, plane_distance, coordinate, ",
    ),
    (
        "arm = 0.26",
        "am = 0.26",
        r"chain_defaults.am: unknown key 'am'; did you mean 'arm'\? \(choices: ",
    ),
    ("home =", "hom =", r"hom: unknown key 'hom'; did you mean 'home'\? \(choices: name, title"),
    ("[platform]", "[platfrm]", r"platfrm: unknown key 'platfrm'; did you mean 'platform'\?"),
    ("[chain_defaults]", "[evry_chain]", "evry_chain: unknown key 'evry_chain'; did you mean"),
    ("gear = 4.0", "gaer = 4.0", r"sensor.1.gaer: unknown key 'gaer'; did you mean 'gear'\?"),
    (
        "gear = 4.0",
        "gear = 4.0\nrange = [0.3, -0.3]",
        r"sensor.1.range = \[0.3, -0.3\]: must be \[low, high\], low < high",
    ),
    ("gear = 4.0", "gear = 4.0\nrange = [0, inf]", "sensor.1.range.2 = inf: .* finite number"),
    ("gear = 4.0", "gear = 4.0\nrange = 0.3", "sensor.1.range = 0.3: must be a list"),
    ("gear = 4.0", "gear = 4.0\nrange = [0.3]", "sensor.1.range.2: is missing"),
    ("sigma = 0.0003", "sigm = 3", r"tolerances.chain\*.base.\*.sigm: unknown key 'sigm'"),
    ("arm = 0.26", "arm = 0.26\ngain = 0", "chain_defaults.gain = 0: must not be 0"),
    (
        "limits = [-0.5236, 1.5708]",
        "limits = [1, -1]",
        r"chain_defaults.limits = \[1, -1\]: must be \[low, high\], low < high",
    ),
    ("arm = 0.26", "arm = -0.26", "chain_defaults.arm = -0.26: input should be greater than 0"),
    ("mass = 0.60", "mass = -0.60", "platform.mass = -0.6: input should be greater than or equal"),
    ("pivot = 0.06", "pivot = 0", "bar.1.pivot = 0: input should be greater than 0"),
    (
        "encoder_counts = 14400",
        "encoder_counts = 0",
        "chain_defaults.encoder_counts = 0: .*greater",
    ),
    ("rod = 0.48", "rod = nan", "chain_defaults.rod = nan: input should be a finite number"),
    ("rod = 0.48", "rod = inf", "chain_defaults.rod = inf: input should be a finite number"),
    ("mass = 0.60", "mass = 1e400", "platform.mass = inf: input should be a finite number"),
    ("rod = 0.48", 'rod = "0.48"', "chain_defaults.rod = '0.48': input should be a valid number"),
    ("rod = 0.48", "rod = true", "chain_defaults.rod = True: input should be a valid number"),
    ("axis = [0.0, 1.0, 0.0]", "axis = 1", "chain.1.axis = 1: must be a list"),
    ("axis = [0.0, 1.0, 0.0]", "axis = [0.0, 1.0]", "chain.1.axis.3: is missing"),
    ("axis = [0.0, 1.0, 0.0]", "axis = [0, 2, 0]", r"chain.1.axis = .*: must have length 1, has 2"),
    ("axis = [0.0, 1.0, 0.0]", "axis = [1, 0, 0]", "chain.1: 'arm_zero' must be normal to 'axis'"),
    ("[workspace]", "[[workspace]]", "workspace: must be a table"),
    ("[chain_defaults]", "[[chain_defaults]]", "chain_defaults: must be a table"),
    ('"schoenflies"', '"schonflies"', "mobility = 'schonflies': input should be 'planar_transl"),
    ('"schoenflies"', '"spatial"', "spatial has 6 freedoms: give 6 chains, not 4"),
    (
        '"revolute"',
        '"rotary"',
        "chain_defaults.actuator = 'rotary': input should be 'revolute'",
    ),
    (
        "working_mode = -1",
        "working_mode = 0",
        "chain_defaults.working_mode = 0: input should be -1 or",
    ),
    ('"platform_angle"', '"angle"', "sensor.1.kind: unknown kind 'angle'; did you mean 'axis_ang"),
    ("bar = 2", "bar = 3", "chain 2: bar = 3, but the file has 2 bars"),
    ("bar = 2", "bar = 0", "chain.2.bar = 0: input should be greater than or equal to 1"),
    ("minimum = [-0.1", "minimum = [0.5", "workspace: 'minimum' must not exceed 'maximum'"),
    ("minimum = [-0.1,", "minimum = [", "workspace: .* must have the same number of coordinates"),
    ("-0.4, 0.0]", "-0.4]", "home needs 4 coordinates, has 3"),
    ('"z_telemeter"', '"theta"', "two sensors have the same name"),
    ('"z_telemeter"', '"9"', "sensor.2.name = '9': "),
    ("[-0.003, 0.010]", "[0.010, -0.003]", r"tolerances.chain\*.rod.interval = .*: must be \[lowe"),
    ("interval = [-0.003, 0.010]", "", r"tolerances.chain\*.rod: give either 'sigma' or 'inter"),
    ('"chain*.rod"', '"chian*.rod"', r"tolerances: unknown parameter 'chian\*.rod'; did"),
    ('["theta"]', '["tetha"]', r"unknown sensor 'tetha'; did you mean 'theta'\? \(choices: "),
    ('["theta"]', '["theta", "theta"]', "a sensor is used twice: theta, theta"),
    ("-0.4, 0.0]", "-4, 0.0]", r"h4: home = \[0.0, 0.0, -4.0, 0.0\]: unreachable, chain 1"),
    ("home =", "home", "not TOML: "),
]


@pytest.mark.parametrize(("old", "new", "line"), SPOILED, ids=[f"{o} → {n}" for o, n, _ in SPOILED])
def test_a_spoiled_robot_file_is_told_what_is_wrong(h4_text, tmp_path, old, new, line):
    assert old in h4_text
    path = tmp_path / "robot.toml"
    path.write_text(h4_text.replace(old, new, 1), encoding="utf-8")
    message = complaint(path)
    assert re.match(f"FILE: {line}", message), message


@pytest.mark.parametrize("count", [3, 4, 20])
@pytest.mark.parametrize("sensors", ['["theta"]', "[]"])
def test_a_nacelle_has_no_more_bars_than_fit(h4_text, tmp_path, count, sensors):
    path = tmp_path / "robot.toml"
    bars = "\n[[bar]]\ndirection = [1.0, 0.0, 0.0]\npivot = 0.06\n" * (count - 2)
    text = h4_text.replace('sensors = ["theta"]', f"sensors = {sensors}") + bars
    path.write_text(text.replace("bar = 2", f"bar = {count}", 1), encoding="utf-8")
    assert complaint(path) == f"FILE: {count} bars: a platform has at most 2 here"


def test_the_core_refuses_a_bar_that_is_not_there(h4):
    core = h4.core.without_limits()  # a copy
    chains = core.chain
    for bar in (2, -2, 1000):
        chains[1].bar = bar
        core.chain = chains
        assert core.finish()[0] == NO_SUCH_PART
        with pytest.raises(ValueError, match="not finished"):
            core.drawn_parameters()


@pytest.mark.parametrize(
    ("contents", "line"),
    [
        (bytes(range(256)), "FILE: cannot be read: not a text file"),
        (b"", r"FILE: name: is missing \(and \d more\)"),
        (b"\x00", "FILE: not TOML: "),
        (b"chain = 3", r"FILE: .*\(and \d more\)"),
        (None, "FILE: cannot be read: Is a directory"),
    ],
    ids=["binary", "empty", "nul", "no chains", "directory"],
)
def test_what_is_no_robot_file_is_refused(tmp_path, contents, line):
    path = tmp_path / "robot.toml"
    path.mkdir() if contents is None else path.write_bytes(contents)
    message = complaint(path)
    assert re.match(line, message), message


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert "cannot be read: No such file" in complaint(tmp_path / "robot.toml")


@pytest.mark.parametrize("name", ["h5", "H44", "", None, 3])
def test_a_robot_that_is_not_shipped_gets_the_choices(name):
    with refused(r"choices: .*h4|shipped robot's name", tp.RobotFileError) as raised:
        tp.load(name)
    assert repr(name).strip("'") in str(raised.value)


def test_a_good_file_loads_by_path_as_by_name(h4, h4_text, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(h4_text, encoding="utf-8")
    for where in (path, str(path)):
        assert tp.load(where).parameters == h4.parameters
