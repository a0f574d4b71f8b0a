"""Robot files with values in mm and degrees."""

import math

import pytest
import tomlkit

import truepose as tp
from truepose.robotfile import quantities, reading

WRITTEN = {"m": ("mm", 1e3), "rad": ("deg", 180 / math.pi)}


def in_mm(data, value, bare, path=()):
    """Write every number that has a length or an angle's unit in mm or degrees."""
    if isinstance(value, dict):
        return {key: in_mm(data, of, bare, (*path, key)) for key, of in value.items()}
    if isinstance(value, list):
        return [in_mm(data, of, bare, (*path, k)) for k, of in enumerate(value)]
    units = set(quantities._units(data, path)) if isinstance(value, float) else set()
    if len(units) != 1:
        return value
    unit, factor = WRITTEN[units.pop()]
    return value * factor if bare else f"{value * factor!r} {unit}"


@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize("name", tp.list_robots())
def test_a_file_in_mm_and_degrees_is_the_same_robot(name, bare, tmp_path):
    robot = tp.load(name)
    data = reading.table_of(robot.spec._text)
    written = in_mm(data, data, bare)
    if bare:
        written = {"units": ["mm", "deg"]} | written
    text = tomlkit.dumps(written)
    assert bare or text.count(" mm") + text.count(" deg") > 20
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="utf-8")
    read = tp.load(path)
    now, then = (each.spec.model_dump() for each in (read, robot))
    assert same(now, then)
    again = tmp_path / "again.toml"
    read.save(again)
    assert ('"mm"' if bare else " mm") in again.read_text(encoding="utf-8")
    assert same(tp.load(again).spec.model_dump(), then)


def test_a_file_in_mm_may_be_based_on_a_robot_in_metres(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(
        'based_on = "h4"\nunits = ["mm", "deg"]\nparameters."chain1.rod" = 480.5\n'
        'chain_defaults.limits = ["-0.5 rad", 90]\n'
        'tolerances."chain*.rod" = { sigma = 0.1, price_steps = [{ sigma = 0.05, price = 30 }] }\n',
        encoding="utf-8",
    )
    robot, h4 = tp.load(path), tp.load("h4")
    assert robot.parameters["chain1.rod"].value == pytest.approx(0.4805, abs=1e-15)
    assert robot.parameters["chain2.rod"].value == h4.parameters["chain2.rod"].value
    assert robot.spec.chain[0].limits == pytest.approx((-0.5, math.pi / 2))
    step = robot.spec.tolerances["chain*.rod"].price_steps[0]
    assert step.sigma == pytest.approx(5e-5) and step.price == 30
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
def test_wrong_units_of_a_file_are_named(units, said, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(f'based_on = "h4"\nunits = {units}\n', encoding="utf-8")
    with pytest.raises(tp.RobotFileError) as told:
        tp.load(path)
    assert said in str(told.value) and "\n" not in str(told.value)


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
def test_a_wrong_unit_is_named(h4_text, tmp_path, line, new, said):
    assert line in h4_text
    path = tmp_path / "robot.toml"
    path.write_text(h4_text.replace(line, new, 1), encoding="utf-8")
    with pytest.raises(tp.RobotFileError) as told:
        tp.load(path)
    assert said in str(told.value) and "\n" not in str(told.value)


def test_tolerances_have_units_too(h4_text, tmp_path):
    tolerances = '[tolerances]\n"chain*.rod" = { sigma = "0.1 mm" }\n'
    tolerances += '"theta.offset" = { interval = ["-1 deg", "1 deg"] }\n'
    tolerances += '"chain1.encoder_offset" = { sigma = "2 mrad" }\n'
    path = tmp_path / "robot.toml"
    path.write_text(h4_text.partition("[tolerances]")[0] + tolerances, encoding="utf-8")
    spec = tp.load(path).spec
    assert spec.tolerances["chain*.rod"].sigma == 1e-4
    assert spec.tolerances["theta.offset"].interval == pytest.approx((-0.0174533, 0.0174533))
    assert spec.tolerances["chain1.encoder_offset"].sigma == 2e-3
