"""Files of bodies and closures that are wrong: one line each, with the key."""

import pytest
from fixtures import refused

import truepose as tp
from truepose import robotfile
from truepose.commands.robots import check


def text_of(name):
    return robotfile.shipped()[name].read_text(encoding="utf-8")


def spoiled(name, old, new):
    text = text_of(name)
    assert old in text
    return text.replace(old, new)


FORK = """
[[body]]
name = "fork"
on = "tube"
joint = "hinge"

[[body]]
name = "tube"
on = "fork"
joint = "slide"
"""
#: robot, what is replaced, by what, the line
WRONG = [
    ("3rps", "[tolerances]", FORK + "\n[tolerances]",
     r"body fork: fork is carried by tube, tube is carried by fork: a circle"),
    ("3prs", 'base_body = "carriage#"', 'base_body = "carraige#"',
     r"rod1.base_body: unknown body 'carraige1'; did you mean 'carriage1'"),
    ("3rps", 'name = "platform"', 'name = "plate"', r"body: one must be named platform"),
    ("3prs", 'name = "rod#"', 'name = "carriage#"', r"closure carriage1: a body has this name"),
    ("exechon", 'freedom = "shift"', 'freedom = "roll"',
     r"freedom roll is a hinge's and a slide's"),
    ("3rps", '[pattern] # whatever has a # in its name, three times\nrepeat = 3\nabout = "z"\n', "",
     r"leg#: # repeats a table: give \[pattern\] repeat, about"),
    ("3rps", "counts = 65536", "counts = [65536, 65536]",
     r"sensor.1.counts = \[65536, 65536\]: give one value, or 3, one a copy"),
    ("exechon", 'motor = "q3"', 'motor = "q4"', r"motor = 'q4': motors must be named q1 to q3"),
    ("exechon", 'motor = "q3"', 'motor = "q2"', r"motor = 'q2': moves a leg and something else"),
    ("exechon", 'freedom = "shift"', 'freedom = "q1"', r"freedom = 'q1': a motor's name"),
    ("3rps", '"z", "pitch", "roll"]', '"z", "tilt", "roll"]',
     r"coordinates: unknown freedom 'tilt' \(choices: x, y, z, pitch, roll, yaw\)"),
    ("3prs", '"z", "pitch", "roll"]', '"q1", "pitch", "roll"]', r"unknown freedom 'q1'"),
    ("3rps", '"z", "pitch", "roll"]', '"z", "z", "roll"]', r"z, z, roll: one is listed twice"),
    ("3rps", 'coordinates = ["z", "pitch", "roll"]', "coordinates = []",
     r"coordinates: x, y, z, pitch, roll, yaw: must be 1 to 3"),
    ("exechon", 'motor = "q3"', "length = 0.980867",
     r"coordinates: reach, roll, pitch: must be .* at most as many as motors, 2;"),
    ("3rps", "home = [1.64, 0.0, 0.0]", "home = [1.64, 0.0]", r"home needs 3 coordinates, has 2"),
    ("3rps", "home = [1.64, 0.0, 0.0]", "home = [1640, 0.0, 0.0]", r"1640 m: did you mean mm"),
    ("3rps", "[workspace]", "start = { z = 1.0 }\n[workspace]", r"start: unknown motor or freedom"),
    ("3prs", 'base_body = "carriage#"', 'base_body = "platform"',
     r"closure rod1: both ends are on platform: nothing moves one"),
    ("exechon", "[tolerances]", '[[closure]]\nname = "fixed"\nlength = 1.0\nanchor_body = "base"\n'
     'base_body = "plane"\n[tolerances]', r"closure fixed: nothing moves base against plane"),
    ("3prs", "length = 0.45", "length = 0.0", r"closure.1.length = 0.0: .*greater than 0"),
    ("3prs", "length = 0.45", 'length = 0.45\nmotor = "q#"', r"'length' of a rod or 'motor' of a"),
    ("3rps", 'motor = "q#" # its length\n', 'motor = "q#"\nworking_mode = 1\n',
     r"leg1.working_mode: is for a rod whose base one motor moves"),
    ("exechon", "[tolerances]", '[[closure]]\nname = "twin"\nanchor_hinge = [1.0, 0.0, 0.0]\n'
     "base = [0.0, 0.55, 0.0]\nanchor = [0.0, 0.16, 0.0]\n[tolerances]",
     r"closure (twin|leg3.anchor_hinge): follows from the other closures at home: 1 of 5"),
    ("exechon", "[tolerances]", '[[body]]\nname = "spare"\njoint = "slide"\n[tolerances]',
     r"closure: 4 equations hold 4 of the 5 freedoms without a motor: spare moves while"),
    ("exechon", "[tolerances]", '[[body]]\nname = "spare"\njoint = "slide"\nmotor = "q4"\n'
     "[tolerances]", r"motor q4 moves nothing: no closure depends on it"),
    ("3rps", "[tolerances]", "".join(f'[[body]]\nname = "b{k}"\njoint = "tilting"\n' for k in "123")
     + "[tolerances]", r"body: 24 slides and hinges .*, at most 20"),
    ("exechon", "[tolerances]", "".join(f'[[closure]]\nname = "c{k}"\nlength = 1.0\n'
     "base_hinge = [1.0, 0.0, 0.0]\n" for k in range(7)) + "[tolerances]",
     r"closure: 18 equations \(a hinge is one\), at most 16"),
    ("exechon", "[tolerances]", "".join(f'[[closure]]\nname = "c{k}"\nmotor = "q{k}"\n'
     for k in range(4, 10)) + "[tolerances]", r"motor: 9 motors, at most 8"),
    ("3rps", "[tolerances]", '[[body]]\nname = "b"\njoint = "tilting"\n[tolerances]',
     r"body: 12 unknown freedoms, at most 8"),
    ("exechon", 'motor = "q2"', "", r"closure.2: give 'length', 'motor', 'base_hinge' or 'anc"),
    ("3prs", "length = 0.45", "length = 0.10",
     r"home = .*: the closures stay open; .*rod1 [\d.]+ mm too short, rod1.base_hinge 0 mm"),
    ("3prs", "working_mode = -1", "working_mode = 1",
     r"rod1.working_mode: closes in mode -1 at home: working_mode = -1, or another start"),
    ("3rps", "limits = [1.25, 2.25]", "limits = [1.25, 1.5]",
     r"beyond a joint limit, q1: 1.64685 of \[1.25, 1.5\]"),
    ("3rps", "limits = [1.25, 2.25]", "limits = [1250, 2250]", r"q1: limits = .*did you mean mm"),
    ("3rps", "encoder_counts = 100000", "eccentricity = [0.01, 0, 0, 0]",
     r"q1: 'eccentricity' is for revolute motors, not telescopic"),
    ("spherical", "encoder_counts = 65536", "spool_buildup = 0.1",
     r"q1: 'spool_buildup' is for prismatic and telescopic motors, not"),
    ("3rps", "[motor_defaults]", "[[motor]]\nname = 'q7'\n[motor_defaults]",
     r"motor q7: no body or closure has motor = 'q7'"),
    ("3rps", 'closure = "leg#"', 'closure = "lge#"', r"sensor hinge1: closure: unknown rod or leg"),
    ("3rps", "zero = [0.0, 0.0, 1.0]\n", "", r"sensor hinge1: zero: is missing"),
    ("3rps", "zero = [0.0, 0.0, 1.0]", "zero = [0.0, 1.0, 0.0]", r"zero: must be normal to axis"),
    ("spherical", "axis = [0.8090169943749475, 0.0, -0.5877852522924731]", "",
     r"sensor elbow1: axis: is missing: the closure has no hinge there"),
    ("exechon", 'freedom = "roll"\ncounts', 'freedom = "reach"\ncounts',
     r"sensor roll_encoder: freedom: unknown hinge 'reach' \(choices: roll, pitch\)"),
    ("exechon", 'kind = "joint_angle"', 'kind = "axis_angle"\naxis = 1',
     r"sensor.1.freedom: unknown key"),
    ("3prs", 'kind = "inclinometer" # on the platform', 'kind = "inclinometer"\nbody = "cariage1"',
     r"pitch_level.body: unknown body 'cariage1'"),
    ("3prs", "[tolerances]", "[platform]\nmass = 1.0\n[tolerances]",
     r"platform: not in a file of bodies and closures"),
    ("3prs", "[tolerances]", "[compliance]\nall_chains = 1e-8\n[tolerances]",
     r"compliance: not in a file of bodies and closures"),
    ("3prs", "[motor_defaults]", "[chain_defaults]\nrod = 1.0\n[motor_defaults]",
     r"chain_defaults: not in a file of bodies and closures"),
    ("h4", "[chain_defaults]", "[motor_defaults]\nlead = 1.0\n[chain_defaults]",
     r"motor_defaults: not in a file of chains"),
    ("3rps", "home =", 'mobility = "planar"\nhome =',
     r"body: is for mechanisms: a file has either mobility and \[\[chain\]\], or"),
    ("h4", "[chain_defaults]", "[start]\nx = 1.0\n[chain_defaults]",
     r"start: is for mechanisms: a file has either .* or \[\[body\]\] and \[\[closure\]\]"),
    ("delta", "[chain_defaults]", '[[sensor]]\nname = "turn"\nkind = "joint_angle"\nfreedom = "x"\n'
     "[chain_defaults]", r"sensor turn: joint_angle is for mechanisms"),
    ("delta", "[chain_defaults]", '[[sensor]]\nname = "turn"\nkind = "rod_length"\nclosure = "x"\n'
     "[chain_defaults]", r"sensor turn: closure is for mechanisms"),
    ("delta", "[chain_defaults]", '[[sensor]]\nname = "turn"\nkind = "rod_length"\n'
     "[chain_defaults]", r"sensor turn: chain: is missing"),
    ("3rps", 'joint = "tilting"', 'joint = "tilting"\naxis = [1.0, 0.0, 0.0]',
     r"'axis' is for a slide or hinge, not tilting"),
    ("exechon", 'freedom = "shift"', 'freedom = "shift"\nmotor = "q4"',
     r"'motor' or 'freedom', not both"),
    ("exechon", 'freedom = "shift"', 'freedom = "time"', r"freedom time: logs and parameters use"),
    ("3rps", 'name = "3rps"', 'name = "3rps"\nmass = 3.0', r"mass: unknown key 'mass'"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "line"), WRONG)
def test_a_wrong_mechanism_is_told_in_one_line(name, old, new, line, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(spoiled(name, old, new), encoding="utf-8")
    with refused(line, tp.RobotFileError):
        tp.load(path)
    robot, lines = check(path)
    assert robot is None and lines and not any("\n" in each for each in lines)
