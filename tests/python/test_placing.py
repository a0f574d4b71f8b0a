"""Placement of sensors, and the robot files it writes."""

import itertools
import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.design.where import Use


@pytest.mark.parametrize(
    ("name", "sensor", "calibrated"),
    [("h4", "wire1", True), ("h4", "wire1", False), ("stewart", "z_telemeter", True)],
)
def test_a_place_is_no_worse_than_the_files_and_a_grids(name, sensor, calibrated, anywhere, rng):
    """And its accuracy is that of the robot that the file then describes."""
    robot = tp.load(name)
    x = anywhere(robot, 14, rng)
    known = {"calibrated_on": x[6:]} if calibrated else {}
    boxes = {f"{sensor}.origin.{axis}": (-0.3, 0.3) for axis in "xy"}
    boxes |= {f"{sensor}.*.?": (0.0, 0.0)}
    if sensor == "wire1":
        boxes = {f"{sensor}.target.y": (-0.06, 0.06)} | boxes
    use = Use(poses=x[:6], **known)
    found = tp.design.place_sensors(robot, [sensor], within=boxes, beside=(), use=use)
    assert found.sigma == pytest.approx(tp.accuracy(found.robot, x[:6], **known).rms, rel=1e-9)
    assert found.robot.sensors == (sensor,)
    with_it = robot.with_sensors(sensor)
    assert found.before == pytest.approx(tp.accuracy(with_it, x[:6], **known).rms, rel=1e-9)
    assert found.sigma <= found.before
    free = [key for key, (low, high) in found.within.items() if low < high]
    axes = [np.linspace(*found.within[key], 5) for key in free]
    for values in itertools.product(*axes):
        there = found.places | dict(zip(free, values, strict=True))
        moved = robot.with_mounting(there).with_sensors(sensor)
        assert found.sigma <= tp.accuracy(moved, x[:6], **known).rms * (1 + 1e-9)
    for key, (low, high) in found.within.items():
        assert low <= found.places[key] <= high


def test_a_wire_reaches_as_far_as_its_range(h4):
    """Where it would say more it would be too long."""
    poses = tp.select_sensors(h4, {"theta": 1.0}).over[:8]
    within = {"wire1.origin.[xy]": (-0.3, 0.3), "wire1.origin.z": (0.0, 0.0)}
    within |= {"wire1.target.*": (0.0, 0.0)}
    use = Use(poses=poses, calibrated_on=poses[:4])
    free = tp.design.place_sensors(h4, ["wire1"], within=within, use=use)
    reads = free.robot.expected().rkm(poses)[:, 1]
    short = [
        s.model_copy(update={"range": (0.3, float(reads.max()) - 0.02)}) if s.name == "wire1" else s
        for s in h4.spec.sensor
    ]
    robot = tp.Robot(h4.spec.model_copy(update={"sensor": tuple(short)}))
    found = tp.design.place_sensors(robot, ["wire1"], within=within, use=use)
    reads = found.robot.expected().with_level("full").rkm(poses)[:, 1]
    assert reads.min() >= 0.3 - 1e-6 and reads.max() <= short[6].range[1] + 1e-6
    assert free.sigma < found.sigma < found.before * 1.5


def test_the_file_that_is_written_loads_to_the_same_robot(run, h4, tmp_path):
    words = ("--place", "wire1", "--within", "wire1.target.*=0..0", "--calibrated", "8")
    status, out, err = run("design", "h4", *words, "-o", "placed.toml", "--seed", "1")
    assert status == 0 and "wire1.origin.x" in out and "Wrote placed.toml" in err + out
    placed = tp.load(tmp_path / "placed.toml")
    assert placed.sensors == ("theta", "wire1")
    moved = [k for k in placed.parameters if placed.parameters[k] != h4.parameters[k]]
    assert moved and all(key.startswith("wire1.origin.") for key in moved)
    text = (tmp_path / "placed.toml").read_text()
    assert re.search(r"origin = .* # was \[0.0, 0.25, 0.0\]", text)
    assert text.count("# assumed") == h4.spec._text.count("# assumed") - 1


def test_a_place_worse_than_the_files_is_said_to_be(run):
    words = ("--place", "wire1", "--within", "wire1.*.[xy]=0..0", "--within", "wire1.target.z=0..0")
    status, out, err = run("design", "h4", *words, "--within", "wire1.origin.z=5m..5.1m")
    assert status == 0 and re.search(
        r"worse than the file's, by \d+\.\d% or more", " ".join((out + err).split())
    )


def test_sensors_of_the_robot_that_a_file_is_based_on_move_too(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('based_on = "h4"\nname = "mine"\n')
    mine = tp.load(file).with_mounting({"wire2.target.z": -0.02})
    mine.save(tmp_path / "moved.toml")
    again = tp.load(tmp_path / "moved.toml")
    assert again.parameters == mine.parameters
    assert again.parameters["wire2.target.z"].value == -0.02


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"sensors": ["wire9"]}, "place: unknown sensor 'wire9'"),
        ({"sensors": []}, "place: no sensor"),
        (
            {"sensors": ["theta"]},
            "place: theta: platform_angle has no mounting place; .* z_telemeter, wire1",
        ),
        ({"within": {"wire1.orign.x": (0, 1)}}, "within: unknown coordinate 'wire1.orign.x'"),
        ({"within": {"wire1.origin.x": (1, 0)}}, "within: wire1.origin.x = 1 to 0: must increase"),
    ],
)
def test_what_cannot_be_placed_is_said(h4, asked, message):
    with refused(message):
        tp.design.place_sensors(h4, **{"sensors": ["wire1"], **asked})


def test_a_sensor_that_was_measured_stays(h4):
    with refused(r"wire1\.origin\.x: measured or calibrated already"):
        tp.design.place_sensors(h4.replace({"wire1.origin.x": 0.01}), ["wire1"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--place", "wire1", "--budget", "9"), "--budget: is for sensor selection"),
        (
            ("--place", "wire1", "--survives", "--measure", "worst", "--robots", "3"),
            "--measure, --robots, --survives: is for sensor selection",
        ),
        (
            ("--price", "theta=9", "-o", "x.toml", "--within", "wire1.origin.x=0..1"),
            "--within, --out: needs --place",
        ),
        (("--place", "wire1", "--within", "wire1.origin.x"), "must be COORDINATE=LOW..HIGH"),
        (("--place", "wire1", "--within", "wire1.origin.x=1deg..2deg"), "must be COORDINATE="),
    ],
)
def test_what_is_wrong_with_the_words_is_one_line(refusal, words, message):
    assert message in refusal("design", "h4", *words)
