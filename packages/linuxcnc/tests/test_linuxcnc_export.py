"""Files that `truepose export linuxcnc` writes."""

import configparser
import ctypes
import os
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import truepose as tp
from truepose_linuxcnc import geometry
from truepose_linuxcnc.configuration import (
    SPEEDS,
    corrections,
    to_configuration,
    to_table,
)

SOURCES = Path(__file__).parents[1] / "hal"
#: Pins of a name, one in each row (hal/pins.h).
ROWS = {"ONE": "{}.{}", "MOTOR": "{}.0.{}", "SENSOR": "{}.sensor.0.{}", "READING": "{}.0.{}"}
ROWS |= {"POSE": "{}.{}.0", "AXIS": "{}.{}.x"}
NAMES = ["machine.table", "robot.hal", "robot.ini", "robot.table"]


def configuration(robot, **options):
    law = "tej" if robot.r else "joint"
    return to_configuration(robot, tp.Controller(law=law), tp.FaultMonitor(), **options)


def ini(made):
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(made["robot.ini"])
    return parser


def refused(robot):
    """Whether a robot has coordinates that are no axes, or too many motors: it says so."""
    if not robot.spec.passive_axis and robot.m == robot.n:
        return False
    said = "as many motors as freedoms"
    if robot.spec.passive_axis:
        said = f"{robot.spec.passive_axis[0].name} is none of LinuxCNC's axes"
    with pytest.raises(tp.InputError, match=said):
        configuration(robot)
    return True


def test_every_robot_has_a_configuration_whose_joints_are_home_and_within_its_stops(chained_robot):
    if refused(chained_robot):
        return
    made = configuration(chained_robot)
    assert sorted(made) == NAMES
    said = ini(made)
    assert said["KINS"]["JOINTS"] == str(chained_robot.n)
    home = chained_robot.ikm(chained_robot.home)
    for i, chain in enumerate(chained_robot.spec.chain):
        joint = said[f"JOINT_{i}"]
        shown = np.degrees(1) if chain.actuator == "revolute" else 1e3
        assert float(joint["HOME"]) == pytest.approx(shown * home[i], rel=1e-15)
        assert float(joint["MIN_LIMIT"]) < float(joint["HOME"]) < float(joint["MAX_LIMIT"])
        assert 0 < float(joint["MIN_FERROR"]) < float(joint["FERROR"])
    assert len(said["TRAJ"]["COORDINATES"].split()) == chained_robot.n


def pins(component):
    """Return the pins that a component makes, the first of each row."""
    there = set()
    for row, name in re.findall(r'PIN\((\w+), \w+, \w+, \w+, "([\w-]+)"', component.read_text()):
        named = ROWS[row].format(component.stem, name)
        there |= {named, named.replace(".0.", ".sensor.0.") if row == "READING" else named}
    return there


def test_the_components_pins_in_the_hal_file_are_those_that_they_make(chained_robot):
    if refused(chained_robot):
        return
    made = configuration(chained_robot)["robot.hal"]
    used = set(re.findall(r"\btruepose_\w+\.[\w.-]+", made))
    there = set().union(*map(pins, SOURCES.glob("truepose_*.c")))
    assert {re.sub(r"\.\d+\b", ".0", pin) for pin in used} <= there


@pytest.mark.parametrize("name", ["truepose_kins", "truepose_tej"])
def test_the_page_lists_the_pins_of_a_component(name):
    page = (SOURCES.parent / "docs/linuxcnc.md").read_text(encoding="utf-8")
    section = page.split(f"## `{name}`\n")[1].split("\n## ")[0]
    cells = " ".join(re.findall(r"^\| (`.*?) \|", section, re.M))
    listed = re.findall("`(.*?)`", re.sub(r"\b[NK]\b", "0", cells))
    assert {f"{name}.{pin}" for pin in listed} == pins(SOURCES / f"{name}.c")


def test_corrections_of_robots_within_their_tolerances_are_accepted(h4):
    """The largest correction is what 99.9 % of them need."""
    said = ini(configuration(h4))
    accepted = np.radians(float(said["TRUEPOSE"]["LARGEST_CORRECTION"]))
    x_d = np.random.default_rng(3).uniform(
        h4.spec.workspace.minimum, h4.spec.workspace.maximum, (30, 4)
    )
    e_q = np.empty((40, 2, *x_d.shape))
    for k in range(40):
        true = h4.sample(100 + k)
        for kind, rest in enumerate((tp.steady_state(h4, true, x_d, "tej"), x_d)):
            e_q[k, kind] = h4.ikm(x_d) - true.ikm(rest)
    largest = np.abs(e_q).max(axis=(0, 2))  # of each motor
    exported, learnt = corrections(h4, tp.Controller())
    assert exported.max() < accepted < 1.05 * exported.max()  # what counts add
    assert (exported / 3 < largest[0]).all() and (largest[0] < exported).all()
    assert (largest[1] < learnt).all()
    assert corrections(tp.load("delta"), tp.Controller(law="joint"))[0].max() == 0


def test_drives_that_lag_behind_a_correction_are_no_following_error(h4):
    """`pid` feeds the command forward alone: it lags by what the correction changes in 1/P."""
    said = ini(configuration(h4))
    gain, box = float(said["PID"]["P"]), h4.spec.workspace
    linear, angular = (SPEEDS[unit][0] for unit in ("m", "rad"))
    rng, seconds = np.random.default_rng(3), 1e-3
    x_d = rng.uniform(box.minimum, box.maximum, (2000, 4))
    way = rng.normal(size=(2000, 3))
    way *= linear / np.linalg.norm(way, axis=1)[:, None]
    there = x_d + seconds * np.column_stack([way, rng.choice([-1, 1], 2000) * angular])
    lags = np.empty((2, 40, 4))
    for k in range(40):
        true = h4.sample(100 + k)
        correction = [h4.ikm(x) - true.ikm(x) for x in (x_d, there)]
        changes = np.abs(correction[1] - correction[0]).max(axis=0) / seconds
        blended = 1.875 * np.abs(correction[0]).max(axis=0) / float(said["TRUEPOSE"]["BLEND_TIME"])
        lags[:, k] = np.degrees([changes / gain, blended / gain])
    changes, blended = lags.max(axis=1)
    for i in range(4):
        limit = float(said[f"JOINT_{i}"]["MIN_FERROR"])
        assert changes[i] + blended[i] < limit < 2.6 * (changes[i] + blended[i])


@pytest.mark.parametrize("law", ["tej", "cartesian", "weighted", "estimated"])
def test_a_law_of_redundant_sensors_is_refused_for_a_robot_without(run, law):
    status, _, error = run("export", "linuxcnc", "delta", "--law", law, "-o", "here")
    assert status == 2
    assert "delta" in error
    assert law in error
    assert not Path("here").exists()


def test_an_exported_robot_with_sensors_is_monitored_and_motion_reads_what_the_law_holds(
    chained_robot,
):
    if refused(chained_robot):
        return
    made = configuration(chained_robot)
    said = ini(made)["TRUEPOSE"]
    assert (said["MONITOR"] == "1") == bool(chained_robot.r)
    assert (float(said["LARGEST_CHI2"]) > 0) == bool(chained_robot.r)
    for i in range(chained_robot.n):
        fed = rf"truepose_tej\.{i}\.pid-fb => pid\.{i}\.feedback joint\.{i}\.motor-pos-fb\n"
        assert re.search(fed, made["robot.hal"])


def test_the_command_writes_a_folder_and_again_by_force(run):
    assert run("export", "linuxcnc", "h4", "-o", "here")[0] == 0
    assert sorted(path.name for path in Path("here").iterdir()) == NAMES
    assert run("export", "linuxcnc", "h4", "-o", "here", "--force")[0] == 0
    Path("here/robot.hal").write_text("loadrt mine")
    status, _, error = run("export", "linuxcnc", "h4", "-o", "here")
    assert status == 2
    assert "--force" in error
    assert Path("here/robot.hal").read_text() == "loadrt mine"


def test_the_machine_that_is_simulated_can_be_another_one(run, h4):
    h4.replace({"chain1.rod": 0.483}).save("true.toml")
    assert run("export", "linuxcnc", "h4", "-o", "here", "--machine", "true.toml")[0] == 0
    assert Path("here/machine.table").read_bytes() != Path("here/robot.table").read_bytes()


@pytest.mark.parametrize(
    "words, said",
    [
        (("h4", "-o", "file"), "cannot be a folder"),
        (("h4", "-o", "no/such/place"), "cannot be a folder"),
        (("h4", "-o", "new", "--machine", "delta"), "sensor"),
        (("h4", "-o", "new", "--sensors", "nothing"), "nothing"),
    ],
)
def test_what_cannot_be_written_is_said_in_a_line_and_leaves_nothing(run, words, said):
    Path("file").write_text("")
    status, _, error = run("export", "linuxcnc", *words)
    assert status == 2
    assert said in error
    assert not Path("new").exists()


def test_a_slow_sensor_is_refused_by_name():
    h4 = tp.load("h4")
    late = [s.model_copy(update={"sample_period": 0.01}) for s in h4.spec.sensor]
    slow = tp.Robot(h4.spec.model_copy(update={"sensor": late}))
    with pytest.raises(tp.InputError, match=r"h4: a sensor has `sample_period`.*--sensors"):
        to_table(slow, tp.Controller(), tp.FaultMonitor())


def test_a_files_geometry_is_sent_whenever_it_changes_and_again_after_a_bad_file(
    run, h4, monkeypatch
):
    h4.save("first.toml")
    h4.replace({"chain1.rod": 0.483}).save("last.toml")
    Path("bad.toml").write_text("name = 'h4")
    files = iter(["first.toml", "bad.toml", "last.toml", None])
    sent, followed = [], Path("followed.toml")

    def change(_):
        """Change the file before the next look, once without a change."""
        name = next(files, followed)
        if name == followed:
            raise KeyboardInterrupt
        if name is not None:
            shutil.copy(name, followed)
            os.utime(followed, ns=(0, len(name)))

    pin = (ctypes.POINTER(ctypes.c_int) * 1)((ctypes.c_int * 1)(1))
    hal = SimpleNamespace(
        hal_init=lambda name: 1,
        hal_malloc=lambda size: ctypes.addressof(pin),
        hal_pin_port_new=lambda *_: 0,
        hal_ready=lambda id: 0,
        hal_exit=lambda id: 0,
        hal_port_writable=lambda port: 5000,
        hal_port_write=lambda port, data, size: sent.append(data[:size]) or True,
    )
    monkeypatch.setattr(geometry.ctypes, "CDLL", lambda name: hal)
    monkeypatch.setattr(geometry.time, "sleep", change)
    status, _, error = run("linuxcnc", "followed.toml")
    assert status == 0
    assert "followed.toml: no such file yet" in error
    assert error.count("the last good geometry stays in use") == 1
    tables = [
        to_table(tp.load(name), tp.Controller(), tp.FaultMonitor())
        for name in ("first.toml", "last.toml")
    ]
    assert b"".join(sent) == b"".join(tables)


def test_where_linuxcnc_is_not_installed_it_is_said_in_a_line(run, monkeypatch):
    def missing(name):
        raise OSError

    monkeypatch.setattr(geometry.ctypes, "CDLL", missing)
    status, _, error = run("linuxcnc", "h4")
    assert status == 2 and "LinuxCNC is not installed" in error
