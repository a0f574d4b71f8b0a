"""Pins, log messages and kept file of truepose_tej."""

import ctypes

import numpy as np
import pytest

import truepose as tp
from truepose_linuxcnc.configuration import to_table

PINS = {"lines": ctypes.c_uint, "law": ctypes.c_int, "law-in-effect": ctypes.c_int}
PINS |= {"status": ctypes.c_int, "part": ctypes.c_int}
PINS |= {"safety-state": ctypes.c_int, "safety-cause": ctypes.c_int, "safety-motor": ctypes.c_int}
PINS |= {"safety-causes": ctypes.c_uint, "frame": ctypes.c_uint, "fault-code": ctypes.c_int}
PINS |= {f"start-{n}": ctypes.c_int for n in ("level", "reached", "state", "finding", "part")}
BITS = ("start-test", "start-active", "safety", "frame-known", "reset", "stop", "3.brake")
BITS += ("enable", "learn", "fault", "sensor.0.absolute", "sensor.0.referenced", "2.homed")
BITS += ("sensor.0.index-enable", "referenced")
BITS += tuple(f"{i}.amp-fault" for i in range(4))


@pytest.fixture
def tej(hal, ours, tmp_path):
    """Load the component for a robot that stands at home, its drives on."""

    def load(robot, **parameters):
        table = tmp_path / "robot.table"
        table.write_bytes(to_table(robot, tp.Controller(), tp.FaultMonitor()))
        module = ours("truepose_tej", table=str(table), **parameters)
        if module.refused:
            return module
        q = np.degrees(robot.ikm(robot.home))
        motors = [f"{i}.{name}" for i in range(robot.n) for name in ("command", "motor-fb")]
        names = [*motors, *PINS, *BITS, "sensor.0.position", "2.pid-fb"]
        names += ["2.safe-speed"]
        names += [f"pose.{k}" for k in range(robot.n)]
        module.knows(*(f"truepose_tej.{name}" for name in names))

        def pin(name):
            kind = PINS.get(name, ctypes.c_bool if name in BITS else ctypes.c_double)
            return module.pin(f"truepose_tej.{name}", kind)

        for name in motors:
            pin(name)[0] = q[int(name[0])]
        pin("sensor.0.position")[0] = np.degrees(robot.rkm(robot.home)[0])
        pin("enable")[0] = True
        module.set, module.run = pin, hal.stub_run
        return module

    return load


@pytest.fixture
def h4():
    return tp.load("h4")


def answer(module, **bits):
    """Let a component stand for half a second, θ off by 0.3°; return what a motor is told."""
    module.set("sensor.0.position")[0] += 0.3
    module.set("sensor.0.absolute")[0] = True
    for name, wanted in bits.items():
        module.set(name)[0] = wanted
    module.set("law")[0] = 1
    module.run(500)
    assert module.set("law-in-effect")[0] == 1
    return module.set("2.pid-fb")[0] - module.set("2.command")[0]


def test_what_was_learnt_is_kept_for_the_same_table_alone(tej, h4, tmp_path, capfd):
    kept = tmp_path / "learnt.table"
    module = tej(h4, keep=str(kept))
    drawn = answer(module)
    module.library.rtapi_app_exit()
    assert not kept.exists()  # nothing was learnt
    module = tej(h4, keep=str(kept))
    learnt = answer(module, learn=True)
    assert module.set("lines")[0] == 1
    assert abs(learnt - drawn) > 1e-3
    module.library.rtapi_app_exit()
    assert sorted(path.suffix for path in tmp_path.glob("*.table*")) == [".table", ".table"]
    assert answer(tej(h4, keep=str(kept))) == pytest.approx(learnt, abs=1e-9)
    assert capfd.readouterr().err == ""

    longer = h4.replace({"chain1.rod": h4.spec.chain[0].rod + 1e-3})
    assert not tej(longer, keep=str(kept)).refused
    assert "learnt of another table" in capfd.readouterr().err
    kept.write_bytes(kept.read_bytes()[:9000])
    assert answer(tej(h4, keep=str(kept))) == drawn
    assert "ends too early" in capfd.readouterr().err


def test_faults_and_an_index_that_is_waited_for_are_said_once(tej, h4, capfd):
    module = tej(h4)
    module.set("law")[0] = 1
    module.run(100)
    assert not module.set("sensor.0.referenced")[0]
    assert capfd.readouterr().err.count("until a sensor's index is passed") == 1
    module.set("sensor.0.absolute")[0] = True
    module.run(100)
    assert module.set("law-in-effect")[0] == 1
    module.set("sensor.0.position")[0] = np.nan
    module.run(300)
    assert module.set("fault")[0]
    assert module.set("law-in-effect")[0] == 0
    assert np.isfinite(module.set("2.pid-fb")[0])
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "a reading is no number" in error
    assert "sensor 0" in error
    module.set("sensor.0.position")[0] = 0
    module.set("enable")[0] = False
    module.run(10)
    module.set("enable")[0] = True
    module.run(10)
    assert not module.set("fault")[0]
    assert (module.set("status")[0], module.set("part")[0]) == (4, 4)  # NOT_FINITE: why it was


def test_an_amplifier_fault_is_of_the_motor_that_has_no_number(tej, h4):
    module = tej(h4)
    module.run(10)
    module.set("1.motor-fb")[0] = np.nan
    module.run(10)
    assert [module.set(f"{i}.amp-fault")[0] for i in range(4)] == [False, True, False, False]
    assert module.set("part")[0] == 1


def test_the_safety_shell_names_a_frozen_frame_and_waits_for_reset(tej, h4, capfd):
    module = tej(h4)
    for name in ("safety", "frame-known", "sensor.0.absolute"):
        module.set(name)[0] = True

    def run(cycles, frames=1):
        for _ in range(cycles):
            module.set("frame")[0] += frames
            module.run(1)

    def shown():
        return module.set("safety-state")[0], module.set("3.brake")[0], module.set("stop")[0]

    run(60)
    assert shown() == (1, False, False)  # running
    assert not module.set("2.amp-fault")[0]
    run(3, frames=0)
    assert [module.set(f"{i}.amp-fault")[0] for i in range(4)] == [True] * 4
    module.set("enable")[0] = False
    run(200)
    assert shown() == (4, True, False)  # a fault
    causes = [module.set(f"safety-{name}")[0] for name in ("cause", "motor", "causes")]
    assert causes == [5, -1, 1 << 5]
    assert module.set("fault-code")[0] == 7
    error = capfd.readouterr().err
    assert error.count("safety: stale frame") == 1
    assert "acknowledge by the pin reset" in error
    module.set("reset")[0] = True
    run(1)
    module.set("reset")[0] = False
    assert not module.set("2.amp-fault")[0]
    module.set("enable")[0] = True
    run(60)
    assert shown() == (1, False, False)


@pytest.mark.parametrize("wired", [True, False])
def test_brakes_stay_closed_until_the_readings_at_rest_have_passed_the_start_up_test(
    tej, h4, capfd, wired
):
    module = tej(h4)
    module.set("start-level")[0] = 1
    module.set("safety")[0] = module.set("sensor.0.absolute")[0] = True
    if not wired:
        module.set("3.motor-fb")[0] *= -1
        module.set("3.command")[0] *= -1

    def switched_on():
        module.set("enable")[0] = True
        module.run(60)
        brake = module.set("3.brake")[0]
        module.set("enable")[0] = False
        module.run(60)
        return not brake

    assert not switched_on()
    assert "brakes stay closed until a start-up test passes" in capfd.readouterr().err
    module.set("start-test")[0] = True
    module.run(1)
    assert module.set("2.amp-fault")[0]  # the machine cannot go on
    module.run(200)
    assert not module.set("start-active")[0]
    assert module.set("start-reached")[0] == wired
    assert module.set("start-state")[0] == (7 if wired else 8)
    assert switched_on() == wired
    if not wired:
        assert "start-up test: may be miswired, motor 3" in capfd.readouterr().err


@pytest.mark.parametrize("level", [1, 2])
def test_an_encoder_whose_index_must_be_passed_does_not_block_the_start(tej, h4, capfd, level):
    module = tej(h4)
    module.set("start-level")[0] = level
    module.set("safety")[0] = True
    module.set("law")[0] = 1
    module.set("sensor.0.position")[0] = 7  # counts from power-on
    module.run(60)  # on: the index is requested, and the brakes stay closed
    assert module.set("sensor.0.index-enable")[0] and module.set("3.brake")[0]
    module.set("enable")[0] = False
    module.run(10)
    module.set("start-test")[0] = True
    module.run(200)
    assert not module.set("sensor.0.index-enable")[0]  # no reading may jump during a test
    if level == 1:
        assert module.set("start-reached")[0] == 1
        module.set("start-test")[0] = False
        module.set("enable")[0] = True
        module.run(60)
        assert not module.set("3.brake")[0] and not module.set("stop")[0]
        assert module.set("sensor.0.index-enable")[0]
        module.set("sensor.0.index-enable")[0] = False  # passed
        module.set("sensor.0.position")[0] = 0
        module.run(500)
        assert module.set("referenced")[0] and module.set("law-in-effect")[0] == 1
    else:
        assert module.set("start-active")[0]  # pulses follow: the sensor has stopped nothing
    assert "unknown pose" not in capfd.readouterr().err


def test_a_motor_that_is_too_fast_is_named(tej, h4, capfd):
    module = tej(h4)
    module.set("safety")[0] = True
    module.set("2.safe-speed")[0] = 100
    module.run(60)
    for _ in range(100):
        module.set("2.command")[0] += 0.2
        module.set("2.motor-fb")[0] += 0.2
        module.run(1)
    assert module.set("safety-motor")[0] == 2
    assert "safety: setpoint speed, motor 2" in capfd.readouterr().err


def test_the_pose_that_the_law_holds_is_on_pins_and_motors_that_are_not_homed_hold_it_back(tej, h4):
    module = tej(h4)
    module.set("2.homed")[0] = False
    module.set("sensor.0.absolute")[0] = True
    module.set("law")[0] = 1
    module.run(500)
    assert module.set("law-in-effect")[0] == 0
    module.set("2.homed")[0] = True
    module.run(500)
    assert module.set("law-in-effect")[0] == 1
    pose = [module.set(f"pose.{k}")[0] for k in range(4)]
    assert pose == pytest.approx(h4.home * [1e3, 1e3, 1e3, np.degrees(1)], abs=1e-6)


def test_what_cannot_be_loaded_is_said_in_a_line(tej, h4, capfd):
    assert tej(h4, unit="furlong").refused
    assert "unit=furlong: choose mm, inch or m" in capfd.readouterr().err
