"""The kinematics module of LinuxCNC against LinuxCNC's own.

Both run in one process, without LinuxCNC: stub_hal.c gives them pins.
"""

import ctypes

import numpy as np
import pytest

import truepose as tp
from truepose_linuxcnc.configuration import to_table

AXES = "xyzabcuvw"
HEXAPOD = [f"genhexkins.{name}" for name in ("screw-lead", "tool-offset", "spindle-offset")]
SAYS = ["truepose_kins.status", "truepose_kins.least-conditioning"]


@pytest.mark.parametrize("pins", [(0, 0, 0), (0, 3, 1.5), (0.2, 2, 0)], ids=str)
def test_a_hexapod_of_genhexkins_pins_moves_its_legs_as_genhexkins_does(stock, ours, pins):
    theirs = stock("genhexkins").knows(*HEXAPOD)
    own = ours(pins="genhexkins").knows(*HEXAPOD)
    for module in (theirs, own):
        for name, value in zip(HEXAPOD, pins, strict=True):
            module.pin(name)[0] = value
    random = np.random.default_rng(0)
    for _ in range(200):
        x = np.zeros(9)
        x[:3] = random.uniform([-4, -4, 17], [4, 4, 23])
        x[3:6] = random.uniform(-20, 20, 3)
        failed, legs = own.inverse(x)
        assert not failed
        assert np.abs(legs - theirs.inverse(x)[1]).max() < 1e-12 * 30
        failed, found = own.forward(legs)
        assert not failed
        assert np.abs(found - x).max() < 1e-10


def test_a_hexapod_refuses_what_lies_beyond_a_singularity_or_next_to_one(stock, ours):
    theirs = stock("genhexkins")
    own = ours(pins="genhexkins").knows(*SAYS)
    level = np.array([0, 0, 25, 0, 0, 0, 0, 0, 0.0])
    turned = np.outer([80, 85, 89.5, 89.95, 90.5, 95], [0, 0, 0, 0, 0, 1, 0, 0, 0]) + level
    assert [own.inverse(x)[0] for x in turned] == [0, 0, 0, -1, -1, -1]
    assert not any(theirs.inverse(x)[0] for x in turned)  # drives through it, and says nothing
    own.pin("truepose_kins.least-conditioning")[0] = 0.3
    assert own.inverse(turned[1])[0] == -1
    assert own.pin("truepose_kins.status", ctypes.c_int)[0] == 2  # TRUEPOSE_SINGULAR
    for x in turned[:2]:  # where genhexkins' forward fails
        own.pin("truepose_kins.least-conditioning")[0] = 0
        failed, found = own.forward(own.inverse(x)[1])
        assert not failed
        assert np.abs(found - x).max() < 1e-8


def test_a_hexapod_that_jumps_is_found_from_the_guess_it_is_given(ours):
    """Poses tilted by up to 50°, far from the one asked for before: genhexkins fails at none."""
    own = ours(pins="genhexkins").knows("truepose_kins.refused")
    random, asked = np.random.default_rng(5), 0
    while asked < 1000:
        x = np.zeros(9)
        x[:3] = random.uniform([-3, -3, 17], [3, 3, 23])
        x[3:6] = random.uniform(-50, 50, 3)
        failed, legs = own.inverse(x)
        if failed:
            continue
        asked += 1
        near = x + random.uniform(-1, 1, 9) * [0.5, 0.5, 0.5, 3, 3, 3, 0, 0, 0]
        failed, found = own.forward(legs, near)
        assert not failed
        assert np.abs(found - x).max() < 1e-6


def test_a_refusal_stays_on_the_pins_and_is_said_once(ours, capfd):
    pose = [f"truepose_kins.refused-at.{letter}" for letter in AXES]
    own = ours(pins="genhexkins").knows("truepose_kins.refused", *SAYS, *pose)
    good, bad = np.zeros(9), np.zeros(9)
    good[2], bad[:] = 20, [1, 2, 25, 0, 0, 95, 0, 0, 0]
    capfd.readouterr()
    for x in (bad, bad, good, bad, good):
        own.inverse(x)
    assert own.pin("truepose_kins.refused", ctypes.c_uint)[0] == 3
    assert own.pin("truepose_kins.status", ctypes.c_int)[0] > 0
    assert [own.pin(name)[0] for name in pose] == list(bad)
    assert capfd.readouterr().err.count("a pose refused") == 1


def test_identity_kinematics_can_be_switched_to_as_in_genhexkins(ours):
    own = ours(pins="genhexkins").knows("kinstype.is-0", "kinstype.is-1", "skgui.z")
    assert own.library.kinematicsSwitchable() == 1
    x = np.array([1, 2, 20, 3, 4, 5, 0, 0, 0.0])
    legs = own.inverse(x)[1]
    assert own.library.kinematicsSwitch(1) == 0
    assert own.pin("kinstype.is-1", ctypes.c_bool)[0]
    assert np.array_equal(own.inverse(x)[1][:6], x[:6])
    own.forward(legs)
    assert own.pin("skgui.z")[0] == pytest.approx(20, abs=1e-9)  # a picture still shows the pose
    assert own.library.kinematicsSwitch(3) == -1


@pytest.mark.parametrize(
    "name, pins, z",
    [
        ("lineardeltakins", {"R": 131, "L": 269}, 20),
        (
            "rotarydeltakins",
            {"platformradius": 10, "thighlength": 11, "shinlength": 15, "footradius": 6},
            -15,
        ),
    ],
)
def test_a_delta_of_its_modules_pins_moves_as_its_module_moves_it(stock, ours, name, pins, z):
    names = {f"{name}.{pin}": value for pin, value in pins.items()}
    modules = [stock(name).knows(*names), ours(pins=name).knows(*names)]
    for module in modules:
        for pin, value in names.items():
            module.pin(pin)[0] = value
    random, s = np.random.default_rng(1), abs(z) / 5
    for _ in range(100):
        x = random.uniform(-9, 9, 9)
        x[:3] = random.uniform([-s, -s, z - s], [s, s, z + s])
        (failed, theirs), (refused, own) = (module.inverse(x) for module in modules)
        assert not failed
        assert not refused
        assert np.abs(own - theirs).max() < 1e-11 * 300
        assert np.abs(modules[1].forward(own)[1] - x).max() < 1e-9


@pytest.mark.parametrize("name", ["h4", "delta", "stewart", "five-bar"])
def test_a_table_moves_the_robot_of_its_file(ours, tmp_path, name):
    robot = tp.load(name)
    table = tmp_path / "robot.table"
    law = "tej" if robot.r else "joint"
    table.write_bytes(to_table(robot, tp.Controller(law=law), tp.FaultMonitor()))
    module = ours(table=str(table), extra="w").knows(*SAYS)
    axes = {"x": 1e3, "y": 1e3, "z": 1e3, "theta": np.degrees(1)}
    x = np.zeros(9)
    x[8] = 7
    for (coordinate, _), value in zip(robot.coordinates, robot.home, strict=True):
        if coordinate in axes:
            x[AXES.index({"theta": "c"}.get(coordinate, coordinate))] = axes[coordinate] * value
    failed, joints = module.inverse(x)
    units = [np.degrees(1) if chain.actuator == "revolute" else 1e3 for chain in robot.spec.chain]
    assert not failed
    assert np.allclose(joints[: robot.n], robot.ikm(robot.home) * units, rtol=0, atol=1e-9)
    assert joints[robot.n] == 7
    failed, found = module.forward(joints)
    assert not failed
    assert np.allclose(found, x, rtol=0, atol=1e-8)
    x[1] = np.nan
    assert module.inverse(x)[0] == -1
    assert module.pin("truepose_kins.status", ctypes.c_int)[0] > 0


@pytest.mark.parametrize(
    "contents, parameters, said",
    [
        (None, {}, "cannot be opened"),
        (b"something else", {}, "is no table"),
        (b"trueposerobt\x04\0\0\0abcd", {}, "another version or another machine"),
        (b"truepose", {}, "ends too early"),
        ("h4", {"unit": "furlong"}, "choose mm, inch or m"),
        ("h4", {"extra": "c"}, "the robot does not move itself"),
        ("h4", {"pins": "scarakins"}, "genhexkins, lineardeltakins or rotarydeltakins"),
    ],
)
def test_what_cannot_be_loaded_is_said_in_a_line(ours, tmp_path, capfd, contents, parameters, said):
    table = tmp_path / "bad.table"
    if contents == "h4":
        contents = to_table(tp.load("h4"), tp.Controller(), tp.FaultMonitor())
    if contents is not None:
        table.write_bytes(contents)
    assert ours(table=str(table), **parameters).refused
    error = capfd.readouterr().err
    assert said in error
    assert error.count("\n") == 1
