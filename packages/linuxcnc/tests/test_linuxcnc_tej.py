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
PINS |= {f"geometry{n}": ctypes.c_int for n in ("", "-state", "-used")}
BITS = ("start-test", "start-active", "safety", "frame-known", "reset", "stop", "3.brake")
BITS += ("enable", "learn", "fault", "sensor.0.absolute", "sensor.0.referenced", "2.homed")
BITS += ("sensor.0.index-enable", "referenced", "unhealthy")
BITS += tuple(f"{i}.amp-fault" for i in range(4))


class Tej:
    """The loaded component; its pins by name."""

    def __init__(self, module, run):
        self.module, self.library, self.run = module, module.library, run

    def _pin(self, name):
        kind = PINS.get(name, ctypes.c_bool if name in BITS else ctypes.c_double)
        return self.module.pin(f"truepose_tej.{name}", kind)

    def __getitem__(self, name):
        return self._pin(name)[0]

    def __setitem__(self, name, value):
        self._pin(name)[0] = value


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
        names = [*motors, *PINS, *BITS, "sensor.0.position", "2.pid-fb", "2.safe-speed"]
        names += ["0.reading", "sensor.0.reading"]
        names += [f"pose.{k}" for k in range(robot.n)]
        module.knows(*(f"truepose_tej.{name}" for name in names))
        loaded = Tej(module, hal.stub_run)
        for name in motors:
            loaded[name] = q[int(name[0])]
        loaded["sensor.0.position"] = np.degrees(robot.rkm(robot.home)[0])
        loaded["enable"] = True
        return loaded

    return load


@pytest.fixture
def h4():
    return tp.load("h4")


def answer(module, **bits):
    """Let a component stand for half a second, θ off by 0.3°; return what a motor is told."""
    module["sensor.0.position"] += 0.3
    module["sensor.0.absolute"] = True
    for name, wanted in bits.items():
        module[name] = wanted
    module["law"] = 1
    module.run(500)
    assert module["law-in-effect"] == 1
    return module["2.pid-fb"] - module["2.command"]


def test_what_was_learnt_is_kept_for_the_same_table_alone(tej, h4, tmp_path, capfd):
    kept = tmp_path / "learnt.table"
    module = tej(h4, keep=str(kept))
    drawn = answer(module)
    module.library.rtapi_app_exit()
    assert not kept.exists()  # nothing was learnt
    module = tej(h4, keep=str(kept))
    learnt = answer(module, learn=True)
    assert module["lines"] == 1
    assert abs(learnt - drawn) > 1e-3
    module.library.rtapi_app_exit()
    assert sorted(path.suffix for path in tmp_path.glob("*.table*")) == [".table", ".table"]
    assert answer(tej(h4, keep=str(kept))) == pytest.approx(learnt, abs=1e-9)
    assert capfd.readouterr().err == ""

    longer = h4.replace({"chain1.rod": h4.spec.chain[0].rod + 1e-3})
    assert isinstance(tej(longer, keep=str(kept)), Tej)
    assert "learnt of another table" in capfd.readouterr().err
    kept.write_bytes(kept.read_bytes()[:9000])
    assert answer(tej(h4, keep=str(kept))) == drawn
    assert "ends too early" in capfd.readouterr().err


def test_geometry_that_a_pin_brings_is_used_at_work_and_bad_bytes_are_refused(hal, tej, h4, capfd):
    module = tej(h4)
    module["geometry"] = 1  # the stub's port
    before = answer(module)
    assert not module["unhealthy"]
    assert module["0.reading"] == pytest.approx(np.radians(module["0.motor-fb"]))
    assert module["sensor.0.reading"] == pytest.approx(np.radians(module["sensor.0.position"]))

    def given(data):
        hal.stub_send(data, len(data))
        steps, last = [], module["2.pid-fb"]
        for _ in range(3000):
            module.run(1)
            steps.append(abs(module["2.pid-fb"] - last))
            last = module["2.pid-fb"]
        return max(steps), last - module["2.command"]

    def table(robot):
        return to_table(robot, tp.Controller(), tp.FaultMonitor())

    longer = h4.replace({"chain3.rod": h4.spec.chain[2].rod + 1e-3})
    step, after = given(table(longer))
    assert (module["geometry-state"], module["geometry-used"]) == (3, 1)
    assert step <= 0.1 * np.degrees(h4.resolution[2])
    assert abs(after - before) > 20 * step
    assert capfd.readouterr().err == ""
    for data, state, says in (
        (table(longer)[:20_000], 4, "ends too early"),
        (b"G0 X0" * 100, 4, "is no table of truepose export linuxcnc"),
        (table(tp.load("par4")), 5, "is of another robot"),
        (table(h4.with_sensors("theta", "z_telemeter")), 5, "has other sensors"),
    ):
        assert given(data) == (0, after)
        assert (module["geometry-state"], module["geometry-used"]) == (state, 1)
        error = capfd.readouterr().err
        assert says in error and error.count("The last good one stays in use") == 1


def test_faults_and_an_index_that_is_waited_for_are_said_once(tej, h4, capfd):
    module = tej(h4)
    module["law"] = 1
    module.run(100)
    assert not module["sensor.0.referenced"]
    assert capfd.readouterr().err.count("until a sensor's index is passed") == 1
    module["sensor.0.absolute"] = True
    module.run(100)
    assert module["law-in-effect"] == 1
    module["sensor.0.position"] = np.nan
    module.run(300)
    assert module["fault"]
    assert module["law-in-effect"] == 0
    assert np.isfinite(module["2.pid-fb"])
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "a reading is no number" in error
    assert "sensor 0" in error
    module["sensor.0.position"] = 0
    module["enable"] = False
    module.run(10)
    module["enable"] = True
    module.run(10)
    assert not module["fault"]
    assert (module["status"], module["part"]) == (4, 4)  # NOT_FINITE: why it was


def test_an_amplifier_fault_is_of_the_motor_that_has_no_number(tej, h4):
    module = tej(h4)
    module.run(10)
    module["1.motor-fb"] = np.nan
    module.run(10)
    assert [module[f"{i}.amp-fault"] for i in range(4)] == [False, True, False, False]
    assert module["part"] == 1


def test_the_safety_shell_names_a_frozen_frame_and_waits_for_reset(tej, h4, capfd):
    module = tej(h4)
    for name in ("safety", "frame-known", "sensor.0.absolute"):
        module[name] = True

    def run(cycles, frames=1):
        for _ in range(cycles):
            module["frame"] += frames
            module.run(1)

    def shown():
        return module["safety-state"], module["3.brake"], module["stop"]

    run(60)
    assert shown() == (1, False, False)  # running
    assert not module["2.amp-fault"]
    run(3, frames=0)
    assert [module[f"{i}.amp-fault"] for i in range(4)] == [True] * 4
    module["enable"] = False
    run(200)
    assert shown() == (4, True, False)  # a fault
    causes = [module[f"safety-{name}"] for name in ("cause", "motor", "causes")]
    assert causes == [5, -1, 1 << 5]
    assert module["fault-code"] == 7
    error = capfd.readouterr().err
    assert error.count("safety: stale frame") == 1
    assert "acknowledge by the pin reset" in error
    module["reset"] = True
    run(1)
    module["reset"] = False
    assert not module["2.amp-fault"]
    module["enable"] = True
    run(60)
    assert shown() == (1, False, False)


@pytest.mark.parametrize("wired", [True, False])
def test_brakes_stay_closed_until_the_readings_at_rest_have_passed_the_start_up_test(
    tej, h4, capfd, wired
):
    module = tej(h4)
    module["start-level"] = 1
    module["safety"] = module["sensor.0.absolute"] = True
    if not wired:
        module["3.motor-fb"] *= -1
        module["3.command"] *= -1

    def switched_on():
        module["enable"] = True
        module.run(60)
        brake = module["3.brake"]
        module["enable"] = False
        module.run(60)
        return not brake

    assert not switched_on()
    assert "brakes stay closed until a start-up test passes" in capfd.readouterr().err
    module["start-test"] = True
    module.run(1)
    assert module["2.amp-fault"]  # the machine cannot go on
    module.run(200)
    assert not module["start-active"]
    assert module["start-reached"] == wired
    assert module["start-state"] == (7 if wired else 8)
    assert switched_on() == wired
    if not wired:
        assert "start-up test: may be miswired, motor 3" in capfd.readouterr().err


@pytest.mark.parametrize("level", [1, 2])
def test_an_encoder_whose_index_must_be_passed_does_not_block_the_start(tej, h4, capfd, level):
    module = tej(h4)
    module["start-level"] = level
    module["safety"] = True
    module["law"] = 1
    module["sensor.0.position"] = 7  # counts from power-on
    module.run(60)  # on: the index is requested, and the brakes stay closed
    assert module["sensor.0.index-enable"] and module["3.brake"]
    module["enable"] = False
    module.run(10)
    module["start-test"] = True
    module.run(200)
    assert not module["sensor.0.index-enable"]  # no reading may jump during a test
    if level == 1:
        assert module["start-reached"] == 1
        module["start-test"] = False
        module["enable"] = True
        module.run(60)
        assert not module["3.brake"] and not module["stop"]
        assert module["sensor.0.index-enable"]
        module["sensor.0.index-enable"] = False  # passed
        module["sensor.0.position"] = 0
        module.run(500)
        assert module["referenced"] and module["law-in-effect"] == 1
    else:
        assert module["start-active"]  # pulses follow: the sensor has stopped nothing
    assert "unknown pose" not in capfd.readouterr().err


def test_a_motor_that_is_too_fast_is_named(tej, h4, capfd):
    module = tej(h4)
    module["safety"] = True
    module["2.safe-speed"] = 100
    module.run(60)
    for _ in range(100):
        module["2.command"] += 0.2
        module["2.motor-fb"] += 0.2
        module.run(1)
    assert module["safety-motor"] == 2
    assert "safety: setpoint speed, motor 2" in capfd.readouterr().err


def test_the_pose_that_the_law_holds_is_on_pins_and_motors_that_are_not_homed_hold_it_back(tej, h4):
    module = tej(h4)
    module["2.homed"] = False
    module["sensor.0.absolute"] = True
    module["law"] = 1
    module.run(500)
    assert module["law-in-effect"] == 0
    module["2.homed"] = True
    module.run(500)
    assert module["law-in-effect"] == 1
    pose = [module[f"pose.{k}"] for k in range(4)]
    assert pose == pytest.approx(h4.home * [1e3, 1e3, 1e3, np.degrees(1)], abs=1e-6)


def test_what_cannot_be_loaded_is_said_in_a_line(tej, h4, capfd):
    assert tej(h4, unit="furlong").refused
    assert "unit=furlong: choose mm, inch or m" in capfd.readouterr().err
