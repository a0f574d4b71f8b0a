"""Robot files with values in mm and degrees."""

import math
import re
from types import SimpleNamespace

import pytest
import tomlkit
from fixtures import refused

import truepose as tp
from truepose.robot import unit_of
from truepose.robotfile import quantities, reading
from truepose.robotfile.pattern import LISTS, TURNED
from truepose.robotfile.to_core import drawn

WRITTEN = {"m": ("mm", 1e3), "rad": ("deg", 180 / math.pi)}


def in_mm(data, bare):
    """Return a file's data with its lengths and angles in mm and degrees."""
    whole, sources, _ = reading.written_out(data)
    units, motif = quantities.Units(whole), len(data.get("chain", ()))

    def unit(value, path):
        if not isinstance(value, float):
            return ""
        if path[0] in ("chain_defaults", "motor_defaults"):
            path = (path[0].removesuffix("_defaults"), 0, *path[1:])
        elif path[0] in sources:
            path = (path[0], sources[path[0]].index(path[1]), *path[2:])  # the first copy
        if (
            path[0] == "chain"
            and path[2] not in TURNED["chain"]
            and len(path) > 3 + (path[2] in LISTS)
        ):
            path = ("chain", path[1] + motif * path[3], path[2])  # a value for each copy
        return "".join(units(path))

    return converted(data, bare, unit)


def converted(value, bare, unit, path=()):
    """Write every number in the unit that people read."""
    if isinstance(value, dict):
        return {key: converted(of, bare, unit, (*path, key)) for key, of in value.items()}
    if isinstance(value, list):
        return [converted(of, bare, unit, (*path, k)) for k, of in enumerate(value)]
    of = unit(value, path)
    if of not in WRITTEN:
        return value
    name, factor = WRITTEN[of]
    return value * factor if bare else f"{value * factor!r} {name}"


@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize("name", tp.list_robots())
def test_a_file_in_mm_and_degrees_is_the_same_robot_and_saved_in_them(name, bare, tmp_path, rng):
    robot = tp.load(name)
    data = reading.table_of(robot.spec._text)
    written = in_mm(data, bare)
    if bare:
        written = {"units": ["mm", "deg"]} | written
    text = tomlkit.dumps(written)
    assert bare or text.count(" mm") + text.count(" deg") > 20
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="utf-8")
    read = tp.load(path)
    now, then = (each.spec.model_dump() for each in (read, robot))
    assert same(now, then)
    assert ('"mm"' if bare else " mm") in saved_again(read, rng, tmp_path)


def test_a_file_in_mm_may_be_based_on_a_robot_in_metres(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(
        'based_on = "h4"\nunits = ["mm", "deg"]\nparameters."chain1.rod" = 480.5\n'
        'chain_defaults.limits = ["-0.5 rad", 90]\n'
        'tolerances."chain*.rod" = { sigma = 0.1 }\n',
        encoding="utf-8",
    )
    robot, h4 = tp.load(path), tp.load("h4")
    assert robot.parameters["chain1.rod"].value == pytest.approx(0.4805, abs=1e-15)
    assert robot.parameters["chain2.rod"].value == h4.parameters["chain2.rod"].value
    assert robot.spec.chain[0].limits == pytest.approx((-0.5, math.pi / 2))
    assert robot.spec.tolerances["chain*.rod"].sigma == pytest.approx(1e-4)
    longer = robot.replace({"chain1.rod": 0.481, "chain2.encoder_offset": 0.02})
    longer.save(tmp_path / "longer.toml")
    again = tp.load(tmp_path / "longer.toml")
    assert values(again) == values(longer)


def values(robot):
    """Return a robot's parameters by name."""
    return {name: parameter.value for name, parameter in robot.parameters.items()}


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ('"mm"', "units = 'mm': must be one length and one angle"),
        ('["mm", "cm"]', "units = ['mm', 'cm']: must be one length and one angle"),
        ('["mm", "m"]', "units = ['mm', 'm']: must be one length and one angle"),
        ("[3]", "units = [3]: must be one length and one angle"),
    ],
)
def test_wrong_units_of_a_file_are_named(units, said, load):
    with refused(re.escape(said), tp.RobotFileError):
        load(f'based_on = "h4"\nunits = {units}\n')


def same(one, other):
    """Return whether two nested structures are equal, numbers to rounding."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-14, abs_tol=1e-17)
    return one == other


@pytest.mark.parametrize(
    ("line", "new", "said"),
    [
        (
            "arm = 0.26 ",
            'arm = "260 deg" ',
            "chain_defaults.arm = '260 deg': must be in um, µm",
        ),
        ("arm = 0.26 ", 'arm = "260 foo" ', "must be in um, µm, mm, m"),
        ("pivot = 0.06 ", 'pivot = "60mrad" ', "bar.1.pivot = '60mrad': must be in um"),
        ("limits = [-0.5236,", 'limits = ["-30 mm",', "must be in mrad, rad, deg, °"),
        ("home = [0.0,", 'home = ["0 deg",', "home.1 = '0 deg': must be in um"),
        ("arm_mass = 0.30 ", 'arm_mass = "300 mm" ', "arm_mass = '300 mm': input should be"),
    ],
)
def test_a_wrong_unit_is_named(h4_text, load, line, new, said):
    assert line in h4_text
    with refused(re.escape(said), tp.RobotFileError):
        load(h4_text.replace(line, new, 1))


def test_tolerances_have_units_too(h4_text, load):
    tolerances = '[tolerances]\n"chain*.rod" = { sigma = "0.1 mm" }\n'
    tolerances += '"theta.offset" = { interval = ["-1 deg", "1 deg"] }\n'
    tolerances += '"chain1.encoder_offset" = { sigma = "2 mrad" }\n'
    spec = load(h4_text.partition("[tolerances]")[0] + tolerances).spec
    assert spec.tolerances["chain*.rod"].sigma == 1e-4
    assert spec.tolerances["theta.offset"].interval == pytest.approx((-0.0174533, 0.0174533))
    assert spec.tolerances["chain1.encoder_offset"].sigma == 2e-3


def in_mm_and_degrees(text: str) -> str:
    """Return a robot file's text with bare numbers in mm and degrees."""
    data = reading.table_of(text)
    return tomlkit.dumps({"units": ["mm", "deg"]} | in_mm(data, True))


#: A pattern whose copies have motors of two kinds.
MIXED = """
name = "mixed"
mobility = "planar"
home = [0, 0, 0]
pattern = { repeat = 3 }
[chain_defaults]
actuator = ["revolute", "prismatic", "revolute"]
arm = 0.2
rod = 0.3
encoder_noise = [0.01, 0.001, 0.01]
[[chain]]
base = [0.4, 0, 0]
anchor = [0.05, 0, 0]
axis = [0, 0, 1]
arm_zero = [1, 0, 0]
"""


@pytest.mark.parametrize("name", [*tp.list_robots(), "mixed"])
def test_every_parameter_of_every_chain_has_its_unit_in_mm_and_degrees(name):
    text = MIXED if name == "mixed" else tp.load(name).spec._text
    text = text.partition("[tolerances]")[0]
    spec, _ = reading.examine(reading.table_of(text))
    text = in_mm_and_degrees(text)
    robot = SimpleNamespace(spec=spec, coordinates=spec.coordinate_units)
    units = {parameter: unit_of(robot, parameter) for parameter in drawn(spec)}
    for table, form in (("tolerances", "{{ sigma = {} }}"), ("parameters", "{}")):
        lines = "\n".join(f"{parameter!r} = {form.format(0.02)}" for parameter in units)
        read, wrong = reading.examine(reading.table_of(f"{text}\n[{table}]\n{lines}"))
        assert not wrong and [c.encoder_noise for c in read.chain] == pytest.approx(
            [c.encoder_noise for c in spec.chain], rel=1e-14
        )
        for parameter, unit in units.items():
            tolerance = read.tolerance(parameter)
            value = read.parameters[parameter] if tolerance is None else tolerance.sigma
            factor = WRITTEN[unit][1] if unit in WRITTEN else 1.0
            assert factor * value == pytest.approx(0.02, rel=1e-14), parameter


@pytest.mark.parametrize("glob", ["*", "chain2.*", "chain*.*", "chain[12]*", "z_tele*"])
def test_one_number_for_lengths_and_angles_is_refused(glob, tmp_path):
    path = tmp_path / "robot.toml"
    for units in ('"mm"', '"deg"'):
        path.write_text(
            f'based_on = "delta"\nunits = [{units}]\ntolerances.{glob!r} = {{ sigma = 1 }}',
            encoding="utf-8",
        )
        if (units, glob) == ('"deg"', "z_tele*"):  # of lengths and directions
            tp.load(path)
            continue
        with refused(r"sigma = 1: .*: name them apart", tp.RobotFileError):
            tp.load(path)


def saved_again(robot, rng, folder):
    """Save a robot with other values, which is read back; return the file's text."""
    values = {key: one.value + 1e-3 * rng.random() for key, one in robot.parameters.items()}
    changed, again = robot.replace(values), folder / "again.toml"
    changed.save(again)
    assert tp.load(again).parameters == changed.parameters
    return again.read_text(encoding="utf-8")


def test_copies_of_a_pattern_have_tolerances_of_their_own(load, tmp_path, rng):
    text = in_mm_and_degrees(tp.load("delta").spec._text).partition("[tolerances]")[0] + (
        '[tolerances]\n"chain2.base.x" = { sigma = 0.3 }\n"chain3.rod" = { interval = [-1, 1] }'
        '\n"chain2.yaw" = { sigma = 0.1 }\n"chain3.encoder_offset" = { sigma = 0.1 }\n'
    )
    robot = load(text)
    assert robot.parameters["chain2.yaw"].sigma == pytest.approx(math.radians(0.1))
    saved_again(robot, rng, tmp_path)
