"""Mistakes in a log's columns, and their names."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import _core, logs
from truepose.calibration import expectation, log_checks
from truepose.calibration.causes import columns
from truepose.calibration.causes.hypothesis import Case
from truepose.robot import frames, workspace_samples

SENSORS = {
    "delta": ("elbow1", "elbow2", "elbow3"),
    "h4": ("theta", "z_telemeter"),
    "stewart": ("roll", "pitch", "z_telemeter"),
}
DEGREES = 180 / np.pi


@pytest.fixture(scope="module")
def cases(anywhere):
    """Return robots with sensors and good logs of theirs."""
    result = {}
    for name, sensors in SENSORS.items():
        robot = tp.load(name).with_sensors(*sensors)
        rng = np.random.default_rng(0)
        result[name] = robot, robot.sample(1).read(anywhere(robot, 100, rng))
    return result


def texts(robot, q_e, **more):
    table = dict(zip(robot.readings, q_e.T, strict=True)) | more
    return [f.text for f in log_checks.check(robot, logs.of(robot, table))[1] if f.refused]


def refusal(robot, q_e, **more):
    table = dict(zip(robot.readings, q_e.T, strict=True)) | more
    with pytest.raises(tp.InputError) as told:
        tp.calibrate(robot, table)
    return str(told.value)


def scaled(*which, by):
    def made(q_e):
        q_e[:, list(which)] *= by
        return q_e

    return made


def ordered(first, *order):
    """Columns from `first` on, in another order."""

    def made(q_e):
        q_e[:, first : first + len(order)] = q_e[:, [first + k for k in order]]
        return q_e

    return made


def stuck(column):
    def made(q_e):
        q_e[:, column] = q_e[7, column]
        return q_e

    return made


CASES = [
    ("delta", scaled(1, by=DEGREES), "q2: in degrees, must be rad"),
    ("delta", scaled(0, 1, 2, by=DEGREES), "q1, q2, q3: in degrees, must be rad"),
    ("delta", scaled(0, 1, 2, by=-1), "q1, q2, q3: their signs are flipped"),
    ("delta", scaled(4, by=-DEGREES), "elbow2: in degrees, must be rad, and its sign is flipped"),
    ("delta", ordered(3, 1, 0), "elbow1 and elbow2: swapped"),
    ("delta", ordered(0, 1, 2, 0), "q1, q2, q3: in another order, they hold q2, q3, q1"),
    ("delta", stuck(1), "q2: stuck at "),
    ("h4", stuck(3), "q4: stuck at "),
    ("stewart", scaled(0, 1, 2, 3, 4, 5, by=1000), "q1, q2, q3, q4, q5, q6: in mm, must be m"),
    ("stewart", scaled(6, by=-1), "roll: its sign is flipped"),
    ("stewart", ordered(6, 1, 0), "roll and pitch: swapped"),
    ("stewart", ordered(0, 1, 2, 3, 4, 5, 0), "they hold q2, q3, q4, q5, q6, q1"),
    ("stewart", stuck(2), "q3: stuck at "),
]


@pytest.mark.parametrize(("name", "spoil", "said"), CASES, ids=[f"{c[0]}: {c[2]}" for c in CASES])
def test_the_mistake_that_was_made_is_named(cases, name, spoil, said):
    """By itself, or where a robot has a mirror image with the image's name beside it."""
    robot, q_e = cases[name]
    assert said in refusal(robot, spoil(q_e.copy()))


@pytest.mark.parametrize(("name", "motor"), [("delta", 0), ("h4", 2), ("stewart", 4)])
def test_lines_on_which_a_motors_encoder_hung_are_left_out(cases, name, motor):
    robot, q_e = cases[name]
    hung = q_e.copy()
    hung[20:40, motor] = hung[20, motor]
    table = dict(zip(robot.readings, hung.T, strict=True))
    log, (finding, *_) = log_checks.check(robot, logs.of(robot, table))
    assert finding.text.startswith(f"q{motor + 1}: stuck at") and not finding.refused
    assert "20 rows (21 to 40): these lines are left out" in finding.text
    assert np.isnan(log.readings[20:40, motor]).all()
    assert np.isfinite(np.delete(log.readings, range(20, 40), axis=0)).all()


def test_a_motor_that_stands_still_is_not_stuck(cases):
    """A grid in joint space: one motor waits while the others go on."""
    robot, _ = cases["h4"]
    q = robot.ikm(robot.home) + np.random.default_rng(0).uniform(-0.1, 0.1, (100, 4))
    q[:, 0] = np.repeat(q[:10, 0], 10)
    true = robot.sample(1)
    x = true.fkm(q)
    table = dict(zip(robot.readings, true.read(x).T, strict=True))
    assert log_checks.check(robot, logs.of(robot, table))[1] == []


@pytest.mark.parametrize("name", SENSORS)
def test_a_good_log_is_left_alone(cases, name):
    robot, q_e = cases[name]
    assert texts(robot, q_e) == []
    q_e = q_e.copy()  # 4 % gross errors and whole turns are no mistake with a column
    q_e[::25, -1] += 0.05
    revolute = [k for k, chain in enumerate(robot.spec.chain) if chain.actuator == "revolute"]
    q_e[:, revolute] += 2 * np.pi
    assert texts(robot, q_e) == []


@pytest.mark.parametrize("seed", range(3))
def test_a_real_h4s_log_is_left_alone_rod_by_rod(h4, anywhere, seed):
    """What the ideal level leaves out is no mistake either; a mistake is found all the same."""
    robot = h4.with_sensors("theta", "z_telemeter")
    x = anywhere(robot, 100, np.random.default_rng(seed))
    q_e = robot.sample(seed).extended_positions(x, level="full")
    assert texts(robot, q_e) == []
    q_e[:, 1] *= -1
    assert refusal(robot, q_e).startswith("readings: q2: its sign is flipped")


@pytest.fixture(scope="module")
def tracked(anywhere):
    """Return an H4 without sensors and what a tracker in a frame of its own saw."""
    robot, rng = tp.load("h4").with_sensors(), np.random.default_rng(1)
    x = anywhere(robot, 100, rng)
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = frames.rotation([2, -1, 1]), [1, 2, 3]
    seen = _core.seen(robot.core, base.ravel(), np.eye(4).ravel(), x, x)[0]
    seen += 1e-5 * rng.normal(size=x.shape)
    outside = {f"measured_{c}": seen[:, k] for k, (c, _) in enumerate(robot.coordinates)}
    return robot, robot.sample(2).read(x), outside


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (scaled(1, by=-1), "q2: its sign is flipped"),
        (ordered(0, 1, 2, 3, 0), "q1, q2, q3, q4: in another order, they hold q2, q3, q4, q1"),
    ],
)
def test_a_tracker_tells_what_is_wrong_with_the_motors(tracked, spoil, said):
    robot, q, outside = tracked
    assert texts(robot, q, **outside) == []
    assert said in refusal(robot, spoil(q.copy()), **outside)


@pytest.mark.parametrize(("unit", "factor", "said"), [("m", 1000, "mm"), ("rad", DEGREES, "degr")])
def test_a_tracker_in_other_units_is_named(tracked, unit, factor, said):
    robot, q, outside = tracked
    names = [f"measured_{c}" for c, own in robot.coordinates if own == unit]
    text = refusal(robot, q, **outside | {name: factor * outside[name] for name in names})
    assert f"{', '.join(names)}: in {said}" in text


def test_every_mistake_is_undone_by_its_undoing(cases):
    """Orders of columns are permutations, and the text says which column holds which."""
    for robot, q_e in cases.values():
        log = logs.of(robot, dict(zip(robot.readings, q_e.T, strict=True)))
        marks = np.arange(1.0, q_e.shape[1] + 1)[None]
        case = Case(robot, replace(log.only([0]), readings=marks))
        made = [of for kind in (columns.unit, columns.sign, columns.order) for of in kind(case)]
        assert len({m.text for m in made}) == len(made)
        for mistake in made:
            undone = np.abs(mistake.given.log.readings)[0]
            if "they hold" in mistake.text:
                names, held = mistake.text.split(": in another order, they hold ")
                for column, name in zip(names.split(", "), held.split(", "), strict=True):
                    at = list(robot.readings).index(column)
                    assert undone[list(robot.readings).index(name)] == marks[0, at]


# --- what is there twice, what is there and not used ----------------------------------------------


def test_the_same_log_twice_counts_once_and_says_so(cases):
    robot, q_e = cases["h4"]
    once, twice = tp.calibrate(robot, q_e), tp.calibrate(robot, np.vstack([q_e, q_e]))
    assert twice.covariance == pytest.approx(once.covariance, rel=1e-6)
    table = dict(zip(robot.readings, np.vstack([q_e, q_e]).T, strict=True))
    for note in (*twice.notes, tp.calibrate(robot, table).notes[-1]):
        assert note.startswith("rows 101, 102, 103, 104, 105, … 95 more: identical to an earlier")
    assert len(twice.x) == 200 and once.notes == ()


def test_measurements_that_are_there_twice_count_once_and_stay_the_callers(tracked):
    robot, q, outside = tracked
    seen = np.column_stack(list(outside.values()))
    q2, seen2 = np.vstack([q, q]), np.vstack([seen, seen])
    once, twice = (tp.calibrate(robot, a, measured=b) for a, b in ((q, seen), (q2, seen2)))
    assert twice.covariance == pytest.approx(once.covariance, rel=1e-6)
    assert np.isfinite(seen2).all()


def test_a_log_with_a_robots_own_sensors_is_told_how_to_use_them(cases):
    robot, q_e = cases["delta"]
    table = dict(zip(robot.readings, q_e.T, strict=True))
    with refused(r"nothing to calibrate .* the log has elbow1, elbow"):
        tp.calibrate(robot.with_sensors(), table)
    fit = tp.calibrate(robot.with_sensors("elbow1"), table)
    assert any("--sensors elbow1,elbow2,elbow3" in note for note in fit.notes)


# --- MCAP -----------------------------------------------------------------------------------------


def write_mcap(path, channels):
    """Channels: topic -> (times in s, columns)."""
    mcap = pytest.importorskip("mcap.writer")
    import json

    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        for topic, (times, columns) in channels.items():
            channel = writer.register_channel(topic, "json", schema)
            for k, time in enumerate(times):
                cells = {name: float(values[k]) for name, values in columns.items()}
                stamp = round(1e9 * float(time))
                writer.add_message(channel, stamp, json.dumps(cells).encode(), stamp)
        writer.finish()


def write_ros_bag(path, joints, imu):
    """Write joints (N, 4) as JointStates and an IMU's angle as a Vector3, each in its channel."""
    mcap = pytest.importorskip("mcap.writer")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/imu": "geometry_msgs/msg/Vector3"}
    joint, vector, header, time = (
        store.types[name]
        for name in (*kinds.values(), "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="ros2")
        channel = {}
        for topic, kind in kinds.items():
            text = store.generate_msgdef(kind, ros_version=2)[0].encode()
            channel[topic] = writer.register_channel(
                topic, "cdr", writer.register_schema(kind, "ros2msg", text)
            )
        for k, (angles, yaw) in enumerate(zip(joints, imu, strict=True)):
            names = ["A", "B", "C", "D"]
            state = joint(header(time(k, 0), ""), names, angles, np.zeros(0), np.zeros(0))
            for topic, message in (("/joint_states", state), ("/imu", vector(0.0, 0.0, yaw))):
                data = bytes(store.serialize_cdr(message, kinds[topic]))
                writer.add_message(channel[topic], k * 10**9, data, k * 10**9)
        writer.finish()


def test_a_bag_of_ros_2_is_read_by_formulas(cases, tmp_path):
    robot, q_e = cases["h4"]
    robot, q_e = robot.with_sensors("theta"), q_e[:, :5]
    write_ros_bag(tmp_path / "bag.mcap", q_e[:, :4], np.degrees(q_e[:, 4]))
    given = "q1 = A rad, q2 = B rad, q3 = C rad, q4 = D * rad, theta = /imu.z * deg"
    read = logs.read(robot, tmp_path / "bag.mcap", given)
    np.testing.assert_allclose(read.readings, q_e, rtol=1e-15)
    assert read.unused == ("/imu.x", "/imu.y")


@pytest.mark.parametrize("late", [0, 1e-6, -3e-3, 9e-3])
def test_messages_of_one_pose_join_though_their_stamps_differ(cases, tmp_path, late):
    robot, q_e = cases["h4"]
    times = 1.7e9 + np.arange(len(q_e))
    columns = dict(zip(robot.readings, q_e.T, strict=True))
    motors = {name: columns[name] for name in robot.readings[:4]}
    theta, z = ({name: columns[name][1:]} for name in robot.sensors)
    channels = {
        "/theta": (times[1:] + late, theta),
        "/motors": (times, motors),
        "/z": (times[1:], z),
    }
    write_mcap(tmp_path / "log.mcap", channels)
    log = logs.read(robot, tmp_path / "log.mcap")
    np.testing.assert_array_equal(log.readings[1:], q_e[1:])
    assert np.isnan(log.readings[0, 4:]).all()


def test_messages_of_another_pose_do_not_join(cases, tmp_path):
    """Beyond 10 ms, or nearer to the next line of a fast log than to their own."""
    robot, q_e = cases["h4"]
    columns = dict(zip(robot.readings, q_e.T, strict=True))
    motors, sensors = (
        {name: columns[name] for name in names} for names in (robot.readings[:4], robot.sensors)
    )
    times = np.arange(len(q_e), dtype=float)
    write_mcap(tmp_path / "log.mcap", {"/q": (times, motors), "/s": (times + 0.011, sensors)})
    with refused("/s: no message within 10 ms of one of /q"):
        logs.read(robot, tmp_path / "log.mcap")
    fast = 1e-3 * times
    write_mcap(tmp_path / "log.mcap", {"/q": (fast, motors), "/s": (fast + 4e-4, sensors)})
    np.testing.assert_array_equal(logs.read(robot, tmp_path / "log.mcap").readings, q_e)
    write_mcap(tmp_path / "log.mcap", {"/q": (fast, motors), "/s": (fast + 6e-4, sensors)})
    log = logs.read(robot, tmp_path / "log.mcap")
    np.testing.assert_array_equal(log.readings[1:, 4:], q_e[:-1, 4:])


# --- size -----------------------------------------------------------------------------------------

MEASURE = """
import resource, sys
import numpy as np, truepose as tp
from truepose.calibration.fitting import memory
robot = tp.load("h4")
rng = np.random.default_rng(0)
box = robot.spec.workspace
q_e = robot.expected().read(rng.uniform(box.minimum, box.maximum, (int(sys.argv[1]), 4)))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
tp.calibrate(robot, q_e, model_error="off")
used = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
print(used / memory(robot, len(q_e), False, False))
"""


def test_no_more_memory_is_taken_than_was_said():
    """Peak of a process that calibrates on 20 000 lines, over what is said beforehand."""
    command = [sys.executable, "-c", MEASURE, "20000"]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert float(found.stdout) < 1.1


def test_poses_far_from_the_workspace_are_not_plausible():
    h4 = tp.load("h4")
    home = np.array(h4.home)
    q = h4.ikm(np.add(home, [[0, 0, 0, 0], [0.05, 0, 0, 0], [0, -0.05, 0, 0], [0, 0, 0, 0.3]]))
    small = h4.spec.workspace.model_copy(
        update={"minimum": tuple(home - 0.01), "maximum": tuple(home + 0.01)}
    )
    for workspace, share in ((h4.spec.workspace, 1), (None, 1), (small, 0.25)):
        robot = tp.Robot(h4.spec.model_copy(update={"workspace": workspace}))
        assert log_checks.plausible(robot, q) == share


def test_much_memory_is_said_before_it_is_taken(cases, monkeypatch):
    robot, q_e = cases["h4"]
    said = r"h4: 100 lines of readings need about 0.0 GB of memory"
    monkeypatch.setattr("truepose.calibration.fitting.MUCH", 1e5)
    with pytest.warns(UserWarning, match=said):
        tp.calibrate(robot, q_e)


def test_a_long_log_is_predicted_part_by_part(cases, monkeypatch):
    robot, q_e = cases["h4"]
    whole = expectation.expect(robot, q_e)
    monkeypatch.setattr(expectation, "LINES", 30)
    parts = expectation.expect(robot, q_e)
    for name in ("x", "expected", "residual", "sigma"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_missing_offset_is_named_with_what_the_motor_spans(tmp_path):
    """Legs that count from home, as string encoders do, fit the hexapod nowhere."""
    robot = tp.load("stewart").with_sensors("roll", "pitch")
    q_e = robot.read(workspace_samples(robot, 20, np.random.default_rng(0)), seed=1)
    q_e[:, 0] -= robot.ikm(robot.home)[0]
    with pytest.raises(tp.InputError) as told:
        tp.calibrate(robot, logs.of(robot, dict(zip(robot.readings, q_e.T, strict=True))))
    said = str(told.value)
    assert "q1 reads" in said and "(chain 1 encoder_offset)" in said and "q2 reads" not in said
