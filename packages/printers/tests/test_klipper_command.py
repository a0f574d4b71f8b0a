"""Output and refusals of `truepose klipper`."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from printer_files import made_printer, made_text, read, text_of

import truepose as tp
from truepose.commands import cli
from truepose_printers.assessment import assess
from truepose_printers.assessment import read as read_file

#: Largest printer.cfg, bytes.
MOST_BYTES = 1_000_000


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Return a function that runs `truepose klipper` in a folder: status, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def command(*words):
        monkeypatch.setattr("sys.argv", ["truepose", "klipper", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return (left.value.code or 0, *capsys.readouterr())

    return command


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "printer.cfg"
    path.write_text(read("phnxdrgn536"), encoding="utf-8")
    return path


ROOT = Path(__file__).parents[3]
GUIDE = (ROOT / "packages/printers/docs/delta-printer.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("line", re.findall(r"^ {4}(truepose klipper .*)", GUIDE, re.M))
def test_a_command_of_the_guide_runs_as_printed(line, run, config, tmp_path):
    (tmp_path / "packages").symlink_to(ROOT / "packages")
    (tmp_path / "old.cfg").write_text(read("phnxdrgn536"), encoding="utf-8")
    status, out, _ = run(*shlex.split(line)[2:])
    assert status == 0
    shown = GUIDE.partition(line + "\n\n")[2].partition("\n\n")[0]
    assert not shown.startswith("    ") or " ".join(shown.split()) in " ".join(out.split())


def test_a_screenful(run, config):
    status, out, err = run("printer.cfg")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 64
    for text in ("Klipper's nine parameters", "plain mean", "0.160", "0.044", "Keep the file's"):
        assert text in out
    assert "σ assumed beforehand: arm 0.5 mm" in out


def test_it_writes_a_new_file(run, config, tmp_path):
    before = config.read_bytes()
    status, out, _ = run("printer.cfg", "--write", "new.cfg")
    assert status == 0 and "Wrote new.cfg" in out
    assert config.read_bytes() == before
    assert read_file(tmp_path / "new.cfg").values[5] > 0.345
    assert run("new.cfg")[0] == 0


@pytest.mark.parametrize("words", [["--write", "printer.cfg"], ["--write", "there.cfg", "--force"]])
def test_no_printer_cfg_is_ever_replaced(run, config, tmp_path, words):
    (tmp_path / "there.cfg").write_text("mine", encoding="utf-8")
    status, _, err = run("printer.cfg", *words, "--plan", 3, "--points", "points.cfg")
    assert status == 2
    assert err.count("\n") == 1 and "is there already: give the name of a new file" in err
    assert (tmp_path / "there.cfg").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "points.cfg").exists()


def test_programs_get_every_digit(run, config):
    status, out, err = run("printer.cfg", "--format", "json")
    assert status == 0
    data = json.loads(out)
    assert list(data) == ["fits", "parameters", "held_out", "bed"]
    (radius,) = (row for row in data["parameters"] if row["parameter"] == "radius")
    assert radius["file"] == pytest.approx(162.76928, rel=1e-12) and radius["unit"] == "mm"
    assert data["fits"][0]["z rms (mm)"] == pytest.approx(0.0183497, abs=1e-7)
    assert data["bed"][0]["x rms (mm)"] == pytest.approx(0.172, abs=0.001)
    assert "Keep the file's parameters" in err


def test_arms_by_hand_count_more_than_the_file(run, config):
    said = (
        "Arms as drawn: 345 mm ([stepper_a] arm_length before SAVE_CONFIG's 345.5115 replaced it)"
    )
    assert said in run("printer.cfg")[1].replace("\n", " ")
    assert "Arms as drawn: 346.5 mm (--arm)" in run("printer.cfg", "--arm", "346.5")[1]


@pytest.mark.parametrize("arm", [280, 34.5, 3000])
@pytest.mark.parametrize("unread", [False, True])
def test_an_arm_that_was_given_is_doubted_where_nothing_fits(run, config, arm, unread):
    more: list = []
    if unread:
        config.write_text(lines_of("height|distance")(read("phnxdrgn536")), encoding="utf-8")
        more = ["--plan", 4]
    status, _, err = run("printer.cfg", "--arm", arm, *more)
    if unread and arm > 100:  # there is nothing yet that such arms would not fit
        assert status == 0
        return
    assert status == 2 and err.startswith("truepose: error: printer.cfg: ")
    assert err.endswith(f"(or is --arm {arm} wrong?)\n") and err.count("\n") == 1


def one(pattern: str, by: str):
    """A change of one thing in a file."""

    def change(text: str) -> str:
        changed, count = re.subn(pattern, by, text, count=1)
        assert count == 1
        return changed

    return change


def lines_of(names: str):
    """Lines of the saved block that begin with these names are left out."""
    return lambda text: re.sub(rf"(?m)^#\*# ({names}).*\n", "", text)


BAD = {
    "no readings": (lines_of("height|distance"), "[delta_calibrate] no saved readings; DELTA_CAL"),
    "no heights": (lines_of("height"), "[delta_calibrate] distances, but no heights; DELTA_CAL"),
    "two heights": (lines_of("height[2-6]|distance"), "2 heights: Klipper probes 3 at least"),
    "a gap among the heights": (
        lambda text: text.replace("height2", "height9"),
        "2 heights: Klipper probes 3 at least. And height2 is missing: as in Klipper none behind "
        "it counts, height9 neither",
    ),
    "no first height": (
        lambda text: text.replace("height0", "height9"),
        "distances, but no heights; DELTA_CALIBRATE and SAVE_CONFIG write them. And height0 is "
        "missing: as in Klipper none behind it counts, height9 neither",
    ),
    "garbled": (one(r"height3 = 16.0", "height3 = 16,O"), "height3 = 16,O: must be a number"),
    "beyond all bounds": (
        one(r"distance4 = 65.06\d*", "distance4 = 1e200"),
        "distance4 = 1e200: must be less than 1e+12",
    ),
    "garbled place": (
        one(r"height2_pos = 31704", "height2_pos = 3l704"),
        "height2_pos = 3l704.000,42083.000,31723.000: must be a number",
    ),
    "two of three": (one(r",32243.333", ""), "32157.333: must be 3 numbers with commas between"),
    "corexy": (
        one("kinematics: delta", "kinematics: corexy"),
        "[printer] kinematics: unknown kinematics 'corexy' (choices: delta, rotary_delta)",
    ),
    "10 mm off": (
        one(r"distance4 = 65.06", "distance4 = 75.06"),
        "distance4 = 75.06: 65.12 mm is expected by the others: typed wrong? Measure it "
        "again, or take it out and number those behind it on",
    ),
    "inches": (
        one(r"distance7 = 65.0\d*", "distance7 = 2.5606"),
        "distance7 = 2.5606: 65.04 mm is expected by the others: in inches (Klipper takes mm)?",
    ),
    "all in cm": (
        lambda text: re.sub(r"(distance\d+) = 6(\d)\.", r"\1 = 6.\2", text),
        "distances are 0.1 times as long as the nozzle's ways: in cm (Klipper takes mm)?",
    ),
    "a gross height": (
        one(r"height3 = 16.0", "height3 = 160"),
        "height3 = 160: 15.97 mm is expected by the others: typed wrong? Measure it again",
    ),
    "a gross height in the middle": (
        one(r"height0 = 16.0", "height0 = 1.6"),
        "height0 = 1.6: 15.93 mm is expected by the others: in cm (Klipper takes mm)?",
    ),
    "another rotation_distance": (
        lambda text: text.replace("rotation_distance: 40", "rotation_distance: 4"),
        "have microsteps or rotation_distance changed since",
    ),
    "other microsteps of one motor": (
        one("microsteps: 16", "microsteps: 8"),
        "[delta_calibrate] stepper_a: its step is 2 times the true one: look at microsteps",
    ),
    "arms in cm": (
        lambda text: re.sub(r"(arm_length) = 34(\d)\.", r"\1 = 34.\2", text),
        "[stepper_a] position_endstop = 418.721720: the arm of 34.5512 mm does not reach",
    ),
    "two wrong heights": (
        lambda text: text.replace("height3 = 16.0", "height3 = 26").replace(
            "height5 = 16.0", "height5 = 6"
        ),
        "no such printer has these readings (left over: z 5.4 mm, distances 0.031 mm rms)",
    ),
    "a bed that no arm reaches": (
        lambda text: re.sub(r"(height\d_pos = )\d", r"\g<1>9", text),
        "the nozzle cannot have been there",
    ),
    "twice": (
        one(r"height4_pos = .*", "height4_pos = 31704.000,42083.000,31723.000"),
        "height4 = 16.0: at the same place as height2, digit for digit: take it out",
    ),
    "turned round": (
        one(
            r"distance1_pos1 = .*\n.*\n",
            "distance1_pos1 = 31268.931,35653.617,35735.432\n"
            "#*# distance1_pos2 = 33313.562,33544.532,33622.698\n",
        ),
        "distance1 = 65.07000000000001: at the same place as distance0, digit for digit",
    ),
    "a point to itself": (
        one(r"distance0_pos2 = .*", "distance0_pos2 = 33313.562,33544.532,33622.698"),
        "distance0 = 64.97: from a point to itself: take it out and number those behind it on",
    ),
    "no microsteps": (one("microsteps: 16\n", ""), "[stepper_a] microsteps: is missing"),
    "half of a microstep": (one("microsteps: 16", "microsteps: 16.5"), "must be a whole number"),
    "an arm of nothing": (
        one(r"arm_length = 346.790457", "arm_length = 0"),
        "[stepper_b] arm_length = 0: must be greater than 0",
    ),
    "no section": (lambda text: "height0 = 16\n" + text, "line 1: height0 = 16: before any [sec"),
    "no option": (
        one("kinematics: delta", "kinematics: delta\nwhat is this"),
        "neither a [section] nor 'option: value'",
    ),
}


@pytest.mark.parametrize(("heights", "more"), [("3-9", ""), ("5-9", ""), ("3-9", "distance")])
def test_too_few_heights_to_leave_any_out_ask_for_more(run, config, heights, more):
    gone = f"height[{heights}]" + "|distance" * (not more)
    config.write_text(lines_of(gone)(read("phnxdrgn536")), encoding="utf-8")
    status, out, _ = run("printer.cfg")
    assert status == 0
    asked = "Read more heights before anything rests on this calibration (--plan 6 says"
    assert (asked in out) == (not more)
    assert ("held-out heights" in out) == bool(more)
    assert "Too few readings to judge this calibration" in out


def test_three_heights_are_met_exactly_by_klippers(run, config):
    """To the decimals of the file, whose parameters are the criterion's then."""
    text = lines_of("height[3-9]|distance")(read("phnxdrgn536"))
    for row in assess(text).answer["parameters"]:
        text = text.replace(f"= {row['now']:.6f}", f"= {row['klipper']:.6f}")
    config.write_text(text, encoding="utf-8")
    assert "are what Klipper's criterion gives; left over: z 0" in run("printer.cfg")[1]


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_line(run, config, tmp_path, name):
    change, said = BAD[name]
    config.write_text(change(read("phnxdrgn536")), encoding="utf-8")
    status, out, err = run("printer.cfg", "--write", "new.cfg")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith("truepose: error: printer.cfg: ")
    assert said in err and "loss" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["printer.cfg"]


def test_readings_behind_a_gap_are_no_printer_without_readings(run, config):
    config.write_text(BAD["no first height"][0](read("phnxdrgn536")), encoding="utf-8")
    status, out, err = run("printer.cfg", "--plan", 4)
    assert (status, out) == (2, "") and "height0 is missing" in err


def test_a_rotary_delta_without_angles_has_klippers():
    text, _ = made_text("rotary_delta")
    found = assess(re.sub(r"#\*# angle.*\n", "", text))
    np.testing.assert_allclose(np.degrees(found.values[2:5]), [30, 150, 270])


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("shoulder_height", "4129", "[stepper_a] position_endstop = 220.000000: the arm of 320 mm"),
        ("position_endstop", "400", "[stepper_a] position_endstop = 400: the arm of 320 mm"),
        ("lower_arm_length", "32", "height0: the nozzle cannot have been there"),
    ],
)
def test_a_rotary_delta_that_cannot_be_is_refused(run, config, option, value, said):
    text, _ = made_text("rotary_delta")
    config.write_text(re.sub(rf"({option}) = .*", rf"\1 = {value}", text), encoding="utf-8")
    status, _, err = run("printer.cfg")
    assert status == 2 and err.count("\n") == 1
    assert said in err


def test_windows_line_ends_and_a_mark_change_nothing(run, config):
    plain = run("printer.cfg")
    text = read("phnxdrgn536")
    for data in (
        text.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + text.encode(),
        text.replace("\n", "\r").encode(),
    ):
        config.write_bytes(data)
        assert run("printer.cfg") == plain


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_what_is_written_keeps_line_ends_and_mark(run, config, tmp_path, end, mark):
    """So that a diff shows no more than what the estimate changes."""
    text = read("phnxdrgn536")
    config.write_bytes(mark + text.replace("\n", end).encode())
    assert run("printer.cfg", "--write", "new.cfg")[0] == 0
    new = (tmp_path / "new.cfg").read_bytes()
    assert new.startswith(mark + text[:20].encode())
    lines = new.removeprefix(mark).decode().split(end)
    assert not any(set(line) & set("\r\n\ufeff") for line in lines)
    changed = set(lines) ^ set(text.split("\n"))
    names = "delta_radius|angle|arm_length|position_endstop"
    assert changed and all(re.match(rf"#\*# ({names}) = ", line) for line in changed)


def test_what_is_no_text_and_what_is_too_long_are_refused(run, config, tmp_path):
    filling = "# " + "x" * 97 + "\n"
    for data, said in (
        (read("phnxdrgn536").encode("utf-16"), "cannot be read: not a text file (UTF-8)"),
        (filling.encode() * (MOST_BYTES // 100 + 1), f"more than {MOST_BYTES} bytes"),
    ):
        config.write_bytes(data)
        status, _, err = run("printer.cfg")
        assert status == 2 and said in err and err.count("\n") == 1
    config.write_text(filling * (MOST_BYTES // 100 - 100) + read("phnxdrgn536"), encoding="utf-8")
    assert run("printer.cfg")[0] == 0
    assert run("nowhere.cfg")[0] == run(tmp_path)[0] == 2


def test_what_is_noticed_is_said(run, config):
    text = read("phnxdrgn536")
    text = text.replace("[printer]\n", "[include macros.cfg]\n[printer]\n", 1)
    text = text.replace("[stepper_b]\n", "[probe]\nz_offset: 18.5\n[stepper_b]\nangle: 330.1\n", 1)
    text = re.sub(r"distance9 = .*\n", "distance99 = 65\n", text)
    config.write_text(text + "[display_status]\n", encoding="utf-8")
    status, _, err = run("printer.cfg")
    assert status == 0
    for said in (
        "included files are not read: macros.cfg",
        "[stepper_b] angle stands twice: 330.1 counts, as in Klipper, and not the saved 329.914363",
        "distance9 is missing: as in Klipper none behind it counts, distance99 neither",
        "[probe] z_offset = 18.5 mm, but the heights were probed at 16 mm",
        "stands in what SAVE_CONFIG wrote and is no part of it",
    ):
        assert said in err


@pytest.mark.parametrize("factor", [0.25, 0.5, 0.8, 0.9, 1.5, 2, 4])
@pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])
def test_steps_of_all_motors_that_were_changed_since_are_named(kinematics, factor):
    printer, truth = made_printer(kinematics)
    text = re.sub(
        r"rotation_distance: 40|107.000:16",
        "rotation_distance: 40\ngear_ratio: 1:1" if kinematics == "delta" else "107.000:16",
        text_of(fitted(printer, truth), truth.readings.heights_only()),
    )
    assert "heights_mm" in assess(text).answer["noise"]
    changed = re.sub(
        r"1:1|107.000:16",
        lambda m: f"{float(m[0].split(':')[0]) / factor}:" + m[0].split(":")[1],
        text,
    )
    with pytest.raises(tp.InputError, match=f"steps of all motors are {factor:g} times as long"):
        assess(changed)


def test_endstops_that_were_all_moved_are_no_steps():
    printer, truth = made_printer()
    moved = fitted(printer, truth)
    ends = {name: moved.parameters[name] + 5e-3 for name in moved.parameters if "endstop" in name}
    text = text_of(replace(moved, parameters=moved.parameters | ends), truth.readings)
    assert "do not fit the file's readings" in assess(text).answer["words"][1]


@pytest.mark.parametrize(("height", "said"), [(0.0, False), (0.05, False), (16.0, True)])
def test_heights_by_hand_are_no_changed_z_offset(height, said):
    """DELTA_CALIBRATE METHOD=manual saves heights of 0, whatever the probe's z_offset."""
    text = re.sub(r"(height\d) = 16.0", rf"\1 = {height}", read("phnxdrgn536"))
    for tower in "abc":  # the endstops by which these heights are those of the bed
        text = re.sub(
            rf"(stepper_{tower}\][^[]*position_endstop = )([\d.]+)",
            lambda m: f"{m[1]}{float(m[2]) + height - 16:.6f}",
            text,
        )
    notes = assess(text.replace("[stepper_b]", "[probe]\nz_offset: 18.5\n[stepper_b]", 1)).answer[
        "notes"
    ]
    assert any("z_offset" in note for note in notes) == said


def fitted(printer, truth):
    """The printer whose file has its true parameters, as after a calibration."""
    return replace(printer, parameters=dict(zip(printer.parameters, truth.p.tolist(), strict=True)))


def test_a_value_that_is_missing_may_be_in_an_included_file(run, config):
    text = read("phnxdrgn536").replace("kinematics: delta\n", "[include other.cfg]\n", 1)
    config.write_text(text, encoding="utf-8")
    assert "is missing; it may be in other.cfg: not read" in run("printer.cfg")[2]


def test_a_reading_that_departs_is_named(run, config):
    text, _ = made_text(seed=1)
    config.write_text(re.sub(r"distance5 = .*", "distance5 = 65.42", text), encoding="utf-8")
    status, _, err = run("printer.cfg")
    assert status == 0
    assert re.search(r"distance5 = 65\.42: \+0\.\d+ mm off what all else says", err)


def test_heights_found_by_hand_come_first():
    text = read("phnxdrgn536")
    found = assess(text)
    z = 1e3 * found.delta.positions(found.p, np.full((1, 3), 33000.0))[0][0, 2]
    by_hand = f"manual_height0: {z}\nmanual_height0_pos: 33000,33000,33000\n"
    text = text.replace("[delta_calibrate]\n", f"[delta_calibrate]\n{by_hand}", 1)
    readings = assess(text).readings()
    assert [reading["name"] for reading in readings[:2]] == ["manual_height0", "height0"]
    assert [reading["probed"] for reading in readings] == [False, *[True] * 7]
    assert readings[0]["value_mm"] == pytest.approx(z)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("rotation_distance: 40", "step_distance: 0.0125"),  # before 2021
        ("rotation_distance: 40", "rotation_distance: 80\ngear_ratio: 4:2"),
        ("rotation_distance: 40", "rotation_distance: 80\nfull_steps_per_rotation: 400"),
        ("rotation_distance: 40", "rotation_distance = 40#mm"),
        ("microsteps: 16", "microsteps: 16 ;fine"),
    ],
)
def test_step_distances_are_klippers(old, new):
    step = assess(read("phnxdrgn536").replace(old, new)).delta.step
    np.testing.assert_allclose(step, 0.0125e-3, rtol=1e-12)


def test_a_rotary_deltas_step_is_an_angle():
    text, _ = made_text("rotary_delta")
    step = assess(text).delta.step
    np.testing.assert_allclose(step, 2 * np.pi / (200 * 16 * (107 / 16) * (60 / 16)), rtol=1e-12)
    with pytest.raises(tp.InputError, match=r"\[stepper_a\] gear_ratio = 107: must be pairs"):
        assess(text.replace("107.000:16, 60:16", "107"))


def promised(data) -> np.ndarray:
    """σ of x and y, and of z, after 0, 1, … of the readings, mm."""
    return np.array([[row["σ in x, y (mm)"], row["σ in z (mm)"]] for row in data["next"]])


def test_the_next_readings_make_the_nozzle_better_known(run, config):
    status, out, _ = run("printer.cfg", "--plan", "6", "--format", "json")
    plan = json.loads(out)
    sigma = promised(plan)
    assert status == 0 and len(sigma) == 7 and (np.diff(np.hypot(*sigma.T)) < 0).all()
    assert {row["reading"] for row in plan["next"][1:]} == {"height", "distance"}


@pytest.mark.parametrize("count", [2, 12])
def test_a_printer_without_readings_is_told_what_to_read_first(run, config, count):
    config.write_text(lines_of("height|distance")(read("phnxdrgn536")), encoding="utf-8")
    status, out, err = run("printer.cfg", "--plan", count, "--format", "json")
    data = json.loads(out)
    kinds = [row["reading"] for row in data["next"][1:]]
    assert status == 0 and "Heights come first" in err
    assert kinds[:7] == ["height"] * min(count, 7)
    assert ("distance" in kinds) == (count == 12)
    sigma = promised(data)
    assert (np.diff(np.hypot(*sigma.T)) < 0).all()
    assert sigma[0, 0] > 1 and (sigma[-1] < 0.035 * sigma[0]).all() == (count == 12)
    status, out, err = run("printer.cfg", "--plan", count, "--write", "new.cfg")
    assert (status, out) == (2, "") and "no saved readings" in err


def test_a_plan_of_more_readings_than_there_are_is_refused(run, config):
    status, out, err = run("printer.cfg", "--plan", 1000)
    assert (status, out) == (2, "")
    assert err == ("truepose: error: printer.cfg: --plan 1000: only 232 candidates are reachable\n")


def test_a_rotary_delta_is_told_what_to_read_next(run, config):
    text, _ = made_text("rotary_delta")
    config.write_text(text, encoding="utf-8")
    status, out, _ = run("printer.cfg", "--plan", 4)
    assert status == 0 and "What to read next" in out


def logged(text: str, end: str = "=======================\n") -> str:
    """Klippy.log with two starts of Klipper; the last one has this configuration."""
    start = "Start printer at Thu Jan  8 03:18:32 2026\n===== Config file =====\n"
    old = f"{start}[printer]\nkinematics: cartesian\n\n=======================\nStats 1.0: a=1\n"
    return old + start + text.rstrip() + "\n" + end + "Stats 2.0: <b>b</b>=1\n"


def test_a_klippy_log_is_read_by_its_last_start(run, config, tmp_path):
    log = tmp_path / "klippy.log"
    log.write_text(logged(read("phnxdrgn536")), encoding="utf-8")
    assert run("klippy.log")[:2] == run("printer.cfg")[:2]
    status, _, err = run("klippy.log", "--write", "new.cfg")
    assert status == 2 and "klippy.log is no printer.cfg (klippy.log)" in err
    log.write_text(logged(read("phnxdrgn536"), end=""), encoding="utf-8")
    status, _, err = run("klippy.log")
    assert status == 2 and "ends within the configuration of Klipper's last start" in err


def points_of(path) -> list[str]:
    _, _, points = path.read_text("utf-8").partition("[delta_calibrate]\npoints:\n")
    return [line.strip() for line in points.splitlines()]


def test_the_planned_heights_are_written_as_points_for_klipper(run, config, tmp_path):
    """DELTA_CALIBRATE replaces the probed heights: their points come first."""
    status, out, _ = run("printer.cfg", "--plan", 5, "--points", "points.cfg")
    assert status == 0 and "Wrote points.cfg" in out
    points = points_of(tmp_path / "points.cfg")
    probed = 7
    words = ("--plan", 5, "--points", "points.cfg", "--force", "--format", "json")
    rows = json.loads(run("printer.cfg", *words)[1])["next"][1:]
    assert len(rows) == 5 and {row["reading"] for row in rows} == {"height"}
    assert points[probed:] == [f"{row['x (mm)']:.0f}, {row['y (mm)']:.0f}" for row in rows]
    status, _, err = run("printer.cfg", "--points", "points.cfg")
    assert status == 2 and err.count("\n") == 1 and "give that too" in err
    config.write_text(lines_of("height|distance")(read("phnxdrgn536")), encoding="utf-8")
    assert run("printer.cfg", "--plan", 4, "--points", "first.cfg")[0] == 0
    assert len(points_of(tmp_path / "first.cfg")) == 4


def test_arms_that_the_owner_set_count_more_than_what_was_replaced_before(run, config):
    text = read("phnxdrgn536").replace("[stepper_a]\n", "[stepper_a]\narm_length: 344.5\n", 1)
    taken = "\n".join(line for line in text.split("\n") if not line.startswith("#*# arm_length"))
    config.write_text(taken, encoding="utf-8")
    said = "344.5 mm (the file, which has one for all; the commented 345 does not count)"
    assert said in run("printer.cfg")[1].replace("\n", " ")
    config.write_text(text, encoding="utf-8")  # SAVE_CONFIG's values are there as well
    assert "the commented 345 does not count" in run("printer.cfg")[1].replace("\n", " ")
