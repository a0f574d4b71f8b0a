"""Anchors of a sled from its belts alone, and mistakes in its log."""

import json
import re

import numpy as np
import pytest
from spoiling import spoiled

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.calibration.calibrate import calibrate
from truepose.calibration.influences import NuisanceParameter, stretch, tension
from truepose.robot.frames import frames
from truepose_sleds import belts, command, firmware, to_read
from truepose_sleds.belts import BELTS, Model

ANCHORS = {"tl.x": 0.03, "tl.y": 2.07, "tr.x": 2.98, "tr.y": 2.06, "br.x": 2.965}


def lengths_at(x, anchors, offsets=0.0, strains=(), tightened="sides", noise=0.0, rng=None):
    """Lengths that a sled reads; its belts stretch as those of the package's own robot."""
    at = np.array(
        [
            [anchors["tl.x"], anchors["tl.y"]],
            [anchors["tr.x"], anchors["tr.y"]],
            [0, 0],
            [anchors["br.x"], 0],
        ]
    )
    away = np.linalg.norm(x[:, None] - at, axis=2)
    result = away - offsets
    if len(strains):
        robot = belts.robot_of((at, 0.0), 1e-3, Model(False, "off"))
        for strain, of in zip(strains, belts.influences(robot, x, tightened), strict=True):
            result = result + strain * of.pattern
    return result + (noise * rng.standard_normal(result.shape) if noise else 0)


def poses():
    return np.array([(x, y) for x in np.linspace(0.6, 2.4, 8) for y in np.linspace(0.6, 1.4, 6)])


def sled(seed):
    """A frame drawn about ANCHORS, its offsets and strains from their priors, and its log."""
    rng = np.random.default_rng(seed)
    anchors = {name: v + 0.02 * rng.standard_normal() for name, v in ANCHORS.items()}
    offsets = belts.OFFSET * rng.standard_normal(4)
    strains = belts.STRAIN * np.abs(rng.standard_normal(3)) * [1, 1, 0.2]
    read = lengths_at(poses(), anchors, offsets, strains, noise=5e-4, rng=rng)
    truth = anchors | dict(zip([f"{b}.offset" for b in BELTS], offsets, strict=True))
    names = ("strain, belt of the side", "strain, other belt", "strain, weight")
    return read, truth | dict(zip(names, strains, strict=True))


def test_sleds_are_found_within_their_sigma():
    """NEES of all twelve unknowns in band; the readings' own σ is found with them.

    Of these, the extension common to the offsets is known by the readings alone.
    """
    nees, sigma = [], []
    for seed in range(20):
        read, truth = sled(seed)
        found = belts.calibrate(read)
        assert set(found.unknowns) == set(truth)
        error = np.array([of.value - truth[name] for name, of in found.unknowns.items()])
        nees.append(error @ np.linalg.solve(found.fit.joint_covariance, error))
        sigma.append(found.sigma)
    assert np.mean(nees) / 12 == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / len(nees)))
    assert np.mean(sigma) == pytest.approx(5e-4, rel=0.1)


def test_of_few_poses_sigma_counts_that_it_is_itself_estimated():
    """16 poses: errors over a σ that is so uncertain are Student's, which is wider than normal."""
    sigma = np.array([belts.calibrate(sled(k)[0][1::3]).sigma for k in range(40)])
    assert np.mean((5e-4 / sigma) ** 2) == pytest.approx(1, abs=0.18)


def test_without_stretch_in_the_model_the_lower_belts_are_missed():
    read, _ = sled(3)
    with_it, without = (
        np.sqrt(np.mean(belts.held_out(read, model) ** 2))
        for model in (Model(), Model(True, "off"))
    )
    assert with_it < 1.3e-3 and without > 1.5 * with_it


def test_anchors_from_disjoint_quarters_scatter_as_their_sigma_says():
    found = [belts.spread(sled(seed)[0], Model()) for seed in range(5)]
    assert 0.75 < np.sqrt(np.mean(np.square(found))) < 1.35


def test_a_wrong_reading_is_named_by_pose_and_belt():
    read, _ = sled(5)
    read[17, 3] += 0.012
    (found,) = belts.calibrate(read).suspects()
    assert found[:2] == (17, "br") and found[2] == pytest.approx(0.012, abs=2e-3)


EITHER = """name = "sled"
mobility = "planar_translation"
source = "assumed"
title = "Sled on four belts"
home = [1.5, 1.0]
gravity = [0.0, -9.81, 0.0]
sensors = ["{c}", "{d}"]
[workspace]
minimum = [0.6, 0.6]
maximum = [2.4, 1.5]
[chain_defaults]
actuator = "telescopic"
anchor = [0.0, 0.0, 0.0]
encoder_noise = 0.0005
[[chain]]
base = {A}
[[chain]]
base = {B}
[platform]
mass = 10.0
[[sensor]]
name = "{c}"
kind = "distance"
origin = {C}
target = [0.0, 0.0, 0.0]
noise = 0.0005
[[sensor]]
name = "{d}"
kind = "distance"
origin = {D}
target = [0.0, 0.0, 0.0]
noise = 0.0005
[tolerances]
"chain*.base.[xy]" = {{ sigma = 0.02 }}
"chain*.encoder_offset" = {{ sigma = 0.005 }}
"chain*.gain" = {{ sigma = 0.002 }}
"*.origin.[xy]" = {{ sigma = 0.02 }}
"??.offset" = {{ sigma = 0.005 }}
"{c}.gain" = {{ sigma = 0.002 }}
"{d}.gain" = {{ sigma = 0.002 }}
"""


def test_any_belts_may_be_the_motors(tmp_path):
    """Upper, lower or left belts as motors, the others as readings: the same posterior."""
    at = {
        "tl": [0.0, 2.07, 0.12],
        "tr": [3.0, 2.07, 0.07],
        "bl": [0.0, 0.0, 0.05],
        "br": [3.0, 0.0, 0.09],
    }
    rng = np.random.default_rng(2)
    read = lengths_at(poses(), ANCHORS, noise=5e-4, rng=rng) * [1.001, 1, 0.999, 1]
    known = {}
    for motors in (("tl", "tr"), ("bl", "br"), ("tl", "bl")):
        others = tuple(belt for belt in BELTS if belt not in motors)
        path = tmp_path / "sled.toml"
        names = dict(zip("cd", others, strict=True))
        bases = dict(zip("ABCD", [at[belt] for belt in motors + others], strict=True))
        path.write_text(EITHER.format(**names, **bases), encoding="utf-8")
        robot = tp.load(path).replace({})
        columns = [BELTS.index(belt) for belt in motors + others]
        start = read[:, columns]
        fit = tp.calibrate(robot, start)
        for name, of in fit.parameters.items():
            part, _, rest = name.partition(".")
            belt = motors[int(part[-1]) - 1] if part.startswith("chain") else part
            rest = rest.replace("base", "origin").replace("encoder_offset", "offset")
            known.setdefault(f"{belt}.{rest}", []).append((of.value, of.sigma))
    for name, each in known.items():
        assert len(each) == 3, name
        value, sigma = np.transpose(each)
        assert np.ptp(value) < 0.05 * sigma.min() and np.ptp(sigma) < 1e-2 * sigma.min(), name


# Influences on readings.


def test_the_tension_of_rods_is_the_work_of_a_longer_one(chained_robot, anywhere, rng):
    """By finite differences: a rod longer by dL, motors held, moves the nacelle against F."""
    robot = chained_robot.with_sensors()
    x = anywhere(robot, 3, rng)
    force = np.array([3.0, -2.0, 5.0])
    pull = tension(robot, x, force)
    q, dL = robot.ikm(x), 1e-6
    for i in range(robot.n):
        rod = f"chain{i + 1}.rod"
        name, sign = (rod, 1) if rod in robot.parameters else (f"chain{i + 1}.encoder_offset", 1)
        ends = [
            robot.replace({name: robot.parameters[name].value + sign * d}).fkm(q, guess=x)
            for d in (-dL, dL)
        ]
        low, high = (frames(robot, end)[:, :3, 3] for end in ends)
        work = (high - low) / (2 * dL) @ force
        assert pull[:, i] == pytest.approx(work, rel=1e-4, abs=1e-4)


def test_stretched_legs_are_told_from_their_offsets_by_what_they_carry():
    """A hexapod under 200 N whose legs give 0.2 µm/N each metre more than they should."""
    robot = tp.load("stewart").with_sensors("roll", "pitch")
    rng = np.random.default_rng(1)
    box = robot.spec.workspace
    x = rng.uniform(box.minimum, box.maximum, (60, 6)) * [1, 1, 1, 0.7, 0.7, 0.7]
    held = np.zeros((len(x), 8))
    load = np.where(np.arange(60) % 2, -2000.0, 0.0)[:, None] * [0, 0, 1.0]
    held[:, :6] = tension(robot, x, load)
    pattern = stretch(robot, x, held)
    q_e = robot.expected().read(x) + 2e-7 * pattern
    legs = NuisanceParameter(name="compliance", pattern=pattern, amount=(0.0, 1e-6))
    fit = calibrate(robot, q_e, influences=[legs])
    of = fit.influences["compliance"]
    assert abs(of.value - 2e-7) < 3 * of.sigma and of.sigma < 0.5e-6
    assert len(fit.joint_covariance) == len(fit.names) + 1


def test_an_influence_that_is_known_is_taken_off():
    """With a prior mean and hardly any σ: as if the readings had been corrected beforehand."""
    read, _ = sled(1)
    corners = np.array([[0.03, 2.07], [2.98, 2.06], [0, 0], [2.96, 0]])
    robot = belts.robot_of((corners, 0.0), 5e-4, Model())
    x = poses()
    strain = belts.influences(robot, x, "alike")[0]
    known = NuisanceParameter(name="known", pattern=strain.pattern, amount=(1e-3, 1e-12))
    one = calibrate(robot, read, influences=[known], options=CalibrationOptions(cause="ignore"))
    other = calibrate(
        robot, read - 1e-3 * strain.pattern, options=CalibrationOptions(cause="ignore")
    )
    for name, of in other.parameters.items():
        assert abs(one.parameters[name].value - of.value) < 1e-3 * of.sigma
    assert one.residuals == pytest.approx(other.residuals, abs=1e-8)


# The command.


def written(path, read, names=BELTS, factor=1e3):
    rows = [",".join(names), *(",".join(f"{factor * v:.3f}" for v in row) for row in read)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_the_command_tells_a_sleds_owner_what_is_known(run, tmp_path):
    read, _ = sled(2)
    read[10, 2] -= 0.02
    read[20, :2] -= 0.6
    written(tmp_path / "log.csv", read)
    status, out, err = run("maslow", "log.csv", "-o", "sled.toml")
    assert (status, err) == (0, "")
    for text in (
        "tl.x",
        "held-out ninths",
        "offsets or anchors?",
        "line 12: bl reads -19.",
        "line 22: left out",
        "prior σ",
    ):
        assert text in out
    robot = tp.load(tmp_path / "sled.toml")
    assert robot.spec.calibration is not None and robot.n == robot.r == 2
    options = ("--format", "json", "--plan", "3")
    status, again, err = run("maslow", "log.csv", *options)
    tables = json.loads(again)
    assert status == 0 and len(tables["held_out"]) == 4
    assert {"x (mm)", "y (mm)"} < set(tables["next"][0])
    assert {"rms (mm)", "median (mm)"} < set(tables["held_out"][0])
    promised = [row["σ of the position then (mm)"] for row in tables["next"]]
    assert len(promised) == 3 and promised == sorted(promised, reverse=True)


UPRIGHT = {"tl.x": 0.02, "tl.y": 2.96, "tr.x": 2.05, "tr.y": 2.97, "br.x": 2.065}


def upright(stretched):
    """The log of a sled in a frame that is higher than wide."""
    x = np.array([(x, y) for x in np.linspace(0.4, 1.6, 6) for y in np.linspace(0.7, 2.2, 8)])
    strains = np.array([0.002, 0.0015, 0.001]) * stretched
    return lengths_at(x, UPRIGHT, 0.0, strains, noise=5e-4, rng=np.random.default_rng(1))


ACROSS = {"bl and tr": [0, 2, 1, 3], "br and tl": [3, 1, 2, 0]}


@pytest.mark.parametrize("which", ACROSS)
@pytest.mark.parametrize("read", [sled(2)[0], upright(True)], ids=["wide", "upright"])
def test_belts_exchanged_across_the_frame_are_named_by_their_stretch(run, tmp_path, which, read):
    """The same poses beside a frame on its side; gravity and tightening are then wrong."""
    order = ACROSS[which]
    written(tmp_path / "log.csv", read[:, order])
    status, _, err = run("maslow", "log.csv", "--format", "json")
    (warned,) = [line for line in err.split("\n") if "warning" in line]
    assert status == 0 and f"{which} exchanged" in warned and "on its side" in warned
    written(tmp_path / "log.csv", read)
    assert "exchanged" not in "".join(run("maslow", "log.csv")[1:])


def test_an_upright_frame_without_stretch_is_noted_not_doubted():
    (said,) = command.on_its_side(belts.calibrate(upright(False)))
    assert "is upright" in said and "warning" not in said


def swap(read):
    return read[:, [1, 0, 2, 3]]


def replaced(line, text):
    """A file whose tl in this line is that text."""
    return lambda lines: [*lines[:line], re.sub("^[^,]*", text, lines[line]), *lines[line + 1 :]]


SPOILT = {
    "inches": (lambda read: read / 25.4, None, "in inches? must be mm"),
    "metres": (lambda read: read / 1e3, None, "must be mm"),
    "swapped": (swap, None, "belts tl and tr exchanged, or bl and br:"),
    "lower swapped": (
        lambda read: read[:, [0, 1, 3, 2]],
        None,
        "tl and tr exchanged, or bl and br",
    ),
    "left": (lambda read: read[:, [2, 1, 0, 3]], None, "tl and bl exchanged, or tr and br"),
    "few": (lambda read: read[:5], None, "5 poses: must be 12 or more"),
    "garbled": (None, replaced(9, "1x"), "line 10: tl = '1x'"),
    "negative": (lambda read: read * np.where(np.arange(4) == 2, -1, 1), None, "line 2: bl = -"),
    "one row in metres": (
        lambda read: read * np.where(np.arange(len(read)) == 3, 1e-3, 1)[:, None],
        None,
        "is it in another unit?",
    ),
    "nan": (None, replaced(8, "nan"), "line 9: tl = 'nan': must be a number\n"),
    "empty": (None, replaced(8, ""), "line 9: tl = '': must be a number\n"),
    "a word": (None, replaced(8, "abc"), "line 9: tl = 'abc': must be a number\n"),
    "decimal commas": (
        None,
        lambda lines: [line.replace(",", ";").replace(".", ",") for line in lines],
        "': must be a number; decimals need a point\n",
    ),
    "capitals": (
        None,
        lambda lines: [lines[0].upper(), *lines[1:]],
        "no column 'tl'; did you mean 'TL' (case matters)? (choices: TL, TR, BL, BR)\n",
    ),
    "random": (lambda read: np.random.default_rng(0).permuted(read, axis=0), None, "no frame expl"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_a_log_that_is_wrong_is_refused_in_one_line(run, tmp_path, case):
    spoil, garble, message = SPOILT[case]
    read = sled(2)[0]
    written(tmp_path / "log.csv", spoil(read) if spoil else read)
    if garble:
        lines = garble((tmp_path / "log.csv").read_text(encoding="utf-8").split("\n"))
        (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    status, out, err = run("maslow", "log.csv", "-o", "sled.toml")
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1, err
    assert not (tmp_path / "sled.toml").exists()


@pytest.mark.filterwarnings("error")
def test_a_spoiled_log_is_a_sled_or_one_line(tmp_path, rng, count):
    path, refused, sleds = tmp_path / "log.csv", 0, 0
    written(path, sled(2)[0])
    text = path.read_text(encoding="utf-8")
    for _ in range(max(count // 1000, 60)):
        path.write_text(spoiled(text, rng, ("tl", "br", '"', "inf", "2.5e3")), encoding="utf-8")
        try:
            read = to_read.read([path])
            found = belts.calibrate(read.lengths)
            said = [*command.apart(found), *command.suspects(found, read)]
        except tp.TrueposeError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 2000
        else:
            sleds += 1
            assert np.isfinite([of.sigma for of in found.unknowns.values()]).all()
            assert not any("\n" in line for line in said)
    assert refused > 10 and sleds > 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--heights", "1,2,3"), "must be four numbers from 0 to 1000"),
        (("--tightened", "some"), "'sides', 'alike', 'off'"),
    ],
)
def test_wrong_options_are_refused(run, tmp_path, options, message):
    written(tmp_path / "log.csv", sled(2)[0])
    status, out, err = run("maslow", "log.csv", *options)
    assert (status, out) == (2, "") and message in err


# The owner's files, and the firmware's settings.


def obj(row):
    tl, tr, bl, br = (f"{1e3 * v:.3f}" for v in row)
    return f"{{bl:{bl},   br:{br},   tr:{tr},   tl:{tl}}}"


def clbm(rows):
    return "CLBM:[" + ",".join(map(obj, rows)) + ",]"


YAML = """kinematics:
  MaslowKinematics:
    tlX: -27.6
    tlZ: 116.0
    brZ: 89.0
    armLength: 123.400
"""


def test_a_serial_log_and_a_table_are_the_same_sled(tmp_path):
    """Batches sent again, single measurements, status objects: every measurement counts once."""
    read, _ = sled(2)
    written(tmp_path / "log.csv", read)
    status = 'MINFO: {"homed": true, "tl": 1.5, "tr": 2, "bl": 3, "br": 4, "etl": 5}'
    batches = [clbm(read[:6]), clbm(read[:6]), *(clbm([row]) for row in read[6:20]), clbm(read)]
    earlier = clbm(sled(3)[0][:9])
    text = "\r\n".join([earlier, "$/Maslow_tlX=-27.6", f"[MSG:INFO: x]\r\n{status}", *batches])
    (tmp_path / "serial.log").write_text(text, encoding="utf-8")
    (tmp_path / "page.txt").write_text("<b>\n" + ",\n".join(map(obj, read)), encoding="utf-8")
    (tmp_path / "maslow.yaml").write_text(YAML, encoding="utf-8")
    table, serial, page = (
        to_read.read([tmp_path / name, tmp_path / "maslow.yaml"])
        for name in ("log.csv", "serial.log", "page.txt")
    )
    assert (serial.lengths == table.lengths).all() and (page.lengths == table.lengths).all()
    (note,) = serial.notes
    assert serial.lines[0] == 1 and "9 measurements of an earlier calibration" in note
    assert serial.heights == {"tl": 0.116, "br": 0.089} and serial.prefix == to_read.PREFIX


BAD = {
    "cut off": (lambda text: text[:-200], "is the log cut off?"),
    "cut off between": (lambda text: text[: text.rindex("{")], "ends after row 47"),
    "html": (lambda text: text.replace("},", "},<script>", 1), "after row 1: '<script>'"),
    "most of it damaged": (lambda text: text.replace("bl:", "bl:x", 37), "11 poses: must be 12"),
    "nothing": (lambda text: YAML, "no belt lengths"),
    "settings": (lambda text: text + "\n$/Maslow_tlX=-\x1b[2J", "tlX = '-"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_broken_log_is_refused_in_one_line(run, tmp_path, case):
    broken, message = BAD[case]
    text = broken(clbm(sled(2)[0]))
    (tmp_path / "log.txt").write_text(text, encoding="utf-8")
    status, out, err = run("maslow", "log.txt", "--lines", "lines.txt")
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1, err
    assert err[:-1].isprintable() and not (tmp_path / "lines.txt").exists()
    assert (tmp_path / "log.txt").read_text(encoding="utf-8") == text


def test_damaged_measurements_are_left_out_unless_they_come_again_whole(tmp_path):
    read = sled(2)[0]
    text = clbm(read)
    for lost, kept in (("bl:", "bl:x"), ("tl:", "tl")):
        text = text.replace(lost, kept, 1)
    (tmp_path / "log.txt").write_text(text.replace("},{", ",{", 3), encoding="utf-8")
    found = to_read.read([tmp_path / "log.txt"])
    damaged = [k for k in range(1, 49) if k not in found.lines]
    assert damaged == [1, 2, 3] and "rows 1, 2, 3" in found.notes[0]
    assert np.allclose(found.lengths, np.round(read[3:], 5), atol=1e-5)
    (tmp_path / "log.txt").write_text(f"{text}\n{clbm(read)}", encoding="utf-8")
    found = to_read.read([tmp_path / "log.txt"])
    assert len(found.lines) == 48 and not found.notes


def test_any_four_anchors_and_a_missing_extension_are_found():
    """A frame far from a rectangle; its log lacks the arms, and one pose is there twice."""
    at = {"tl.x": -0.3, "tl.y": 2.2, "tr.x": 3.4, "tr.y": 2.8, "br.x": 3.6}
    x = np.vstack([poses(), poses()[5]])
    rng = np.random.default_rng(4)
    found = belts.calibrate(lengths_at(x, at, 0.1534, noise=5e-4, rng=rng))
    for name, of in found.anchors.items():
        assert abs(of.value - at[name]) < 4 * of.sigma < 0.05
    value, sigma = found.extension
    assert abs(value - 0.1534) < 4 * sigma < 0.03


def test_a_slipped_belt_is_named_and_undone():
    read, truth = sled(6)
    read[30:, 0] += 0.0052
    numbers = np.arange(1, len(read) + 1)
    found, (said,) = belts.without_slips(belts.calibrate(read), numbers)
    assert said.startswith("tl: slipped before row 31, by 5.") and said.endswith(" mm: undone")
    error = np.array([of.value - truth.get(name, 0.0052) for name, of in found.unknowns.items()])
    assert error @ np.linalg.solve(found.fit.joint_covariance, error) < 3 * len(error)
    assert belts.without_slips(belts.calibrate(sled(6)[0]), numbers)[1] == []


def test_a_belt_that_reads_otherwise_on_one_side_is_no_slip():
    """The row at which the sled crosses the middle: nothing in the log tells step from slip."""
    read, _ = sled(6)
    read[24:, 3] += 0.006
    found, (said,) = belts.without_slips(belts.calibrate(read), np.arange(1, len(read) + 1))
    assert "br: reads otherwise where x is above" in said and "br: slipped before row 25" in said
    assert said.endswith("nothing is undone") and found.slips == ()


def test_errors_that_persist_from_row_to_row_are_no_slip():
    """Correlation 0.9 between rows, 2.3 mm: a slip of br by 4.7 ± 0.7 mm for independent errors."""
    rng = np.random.default_rng(2)
    x = np.array([(x, y) for x in np.linspace(0.5, 2.46, 11) for y in np.linspace(0.45, 1.6, 9)])
    read = lengths_at(x, ANCHORS, 0.0, [0.0018, 0.0017, 0.001])
    error = np.zeros_like(read)
    for k in range(1, len(read)):
        error[k] = 0.9 * error[k - 1] + 1e-3 * rng.standard_normal(4)
    found, _ = belts.without_slips(belts.calibrate(read + error), np.arange(1, len(read) + 1))
    assert found.slips == ()


@pytest.mark.parametrize(("strain", "named"), [(-0.0044, 2), (0.0044, 0)])
def test_belts_that_a_pull_makes_shorter_are_named(strain, named):
    rng = np.random.default_rng(3)
    read = lengths_at(poses(), ANCHORS, 0.0, [strain, strain, 0.001])
    found = belts.calibrate(read + 1e-3 * rng.standard_normal(read.shape))
    assert sum("cannot make a belt shorter" in line for line in command.honesty(found)) == named


def test_the_firmwares_anchors_are_the_truth_of_an_ideal_sled_and_best_of_a_real_one(run, tmp_path):
    """Belts that neither stretch nor are off: the true anchors, at no error. Else: no better ones.

    The sled stands where the belts that the firmware asks for agree best.
    """
    stiff = belts.calibrate(lengths_at(poses(), ANCHORS), Model(False, "off"))
    found = firmware.best(stiff, False)
    assert found.error < 1e-5
    assert list(found.values.values()) == pytest.approx(list(ANCHORS.values()), abs=2e-3)
    real = belts.calibrate(sled(7)[0])
    found = firmware.best(real, True)
    low, high = real.x.min(axis=0), real.x.max(axis=0)
    x = np.stack(np.meshgrid(*np.linspace(low, high, 8).T), axis=-1).reshape(-1, 2)
    asked = real.fit.robot.extended_positions(x) + real.stretch(x)

    def error(anchors):
        at = np.zeros((4, 2))
        at[[0, 0, 1, 1, 3], [0, 1, 0, 1, 0]] = anchors
        p = x.copy()
        for _ in range(5):
            away = p[:, None] - at
            distance = np.linalg.norm(away, axis=2, keepdims=True)
            p += (np.linalg.pinv(away / distance) @ (asked[..., None] - distance))[..., 0]
        centred = [of - of.mean(axis=0) for of in (x, p)]
        U, _, Vt = np.linalg.svd(centred[0].T @ centred[1])
        return np.sqrt(np.mean(np.sum((centred[0] - centred[1] @ (U @ Vt).T) ** 2, axis=1)))

    own = np.array(list(found.values.values()))
    assert error(own) == pytest.approx(found.error, rel=0.2) and found.error > 2e-4
    for step in np.vstack([np.eye(5), -np.eye(5)]):
        assert error(own + 2e-3 * step) > error(own) - 2e-5
    found, fit = firmware.best(real, False), real.fit  # belts of robots like this one, zeroed anew
    own, names, rng = (
        np.array(list(found.values.values())),
        list(fit.names),
        np.random.default_rng(1),
    )
    zero = [firmware.ZERO * name.endswith("offset") for name in names]
    covariance = fit.joint_covariance[: len(names), : len(names)] + np.diag(np.square(zero))
    errors = []
    for change in rng.multivariate_normal(np.zeros(len(names)), covariance, 60):
        values = [fit.robot.parameters[name].value for name in names] + change
        asked = fit.robot.replace(dict(zip(names, values, strict=True))).extended_positions(x)
        errors.append(error(own))
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(found.expected, rel=0.15)


def test_lines_are_written_for_the_firmware_that_the_settings_are_of(run, tmp_path):
    read, _ = sled(2)
    (tmp_path / "log.txt").write_text(clbm(read), encoding="utf-8")
    told = []
    for settings in (YAML, YAML + "    beltAxialStiffness: 178900\n", "Maslow_tlX: 3\n"):
        (tmp_path / "maslow.yaml").write_text(settings, encoding="utf-8")
        words = ("maslow", "log.txt", "maslow.yaml", "--lines", "lines.txt", "--force")
        assert run(*words)[::2] == (0, "")
        lines = (tmp_path / "lines.txt").read_text(encoding="utf-8").split()
        told.append(dict(line.split("=") for line in lines))
    own = "$/kinematics/MaslowKinematics/"
    anchors = [own + key for key in firmware.WRITTEN]
    assert list(told[0]) == [*anchors, own + "tlZ", own + "brZ"] and told[0][own + "tlZ"] == "116.0"
    assert list(told[1]) == [*told[0], own + "beltAxialStiffness"] and told[1] != told[0]
    assert list(told[2]) == ["$/Maslow_" + key for key in firmware.WRITTEN]


def test_other_heights_project_the_belts_anew():
    read, _ = sled(2)
    log = to_read.Readings(read, np.arange(48), "row", "log", {"tlZ": 100.0}, to_read.PREFIX, [])
    same = command.projected(log, "100,56,34,78")
    assert same.lengths == pytest.approx(read, abs=1e-12)
    belt = np.sqrt((read[0, 0] - 0.1534) ** 2 + 0.1**2)
    higher = command.projected(log, "150,56,34,78")
    assert higher.lengths[0, 0] == pytest.approx(0.1534 + np.sqrt(belt**2 - 0.15**2), abs=1e-12)
    assert higher.heights["tl"] == 0.15
