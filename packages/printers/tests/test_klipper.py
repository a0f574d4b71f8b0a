"""Delta printers by Klipper's saved readings, against Klipper's own results."""

import re

import numpy as np
import pytest
from printer_files import REAL, changed, made_printer, made_text, read, text_of
from printer_trials import ASSUMED, made

import truepose as tp
from truepose_printers.assessment import DEGREE, MM, assess
from truepose_printers.review import rms

#: The units of the answer in SI.
UNITS = {"mm": MM, "°": DEGREE, "%": 0.01}
#: z rms that Klipper's parameters leave, mm.
LEFT = {"phnxdrgn536": 0.0183, "fzechert": 0.0063, "cupsster": 0.0759}


def words_of(text: str, **options) -> list[str]:
    return assess(text, **options).answer["words"]


def column(found, key: str) -> np.ndarray:
    """A column of Klipper's own parameters, mm and degrees."""
    return np.array([row[key] for row in found.answer["parameters"] if row["now"] is not None])


both = pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])


@both
def test_a_nozzle_is_where_its_motors_bring_it_and_its_slopes_are_finite_differences(kinematics):
    printer, truth = made_printer(kinematics)
    delta, p, steps = printer.delta, truth.p, truth.readings.height_steps
    x, slopes = delta.positions(p, steps)
    np.testing.assert_allclose(delta.steps(p, x), steps, atol=1e-6)
    for k, h in enumerate(1e-6 * np.eye(len(p))):
        apart = delta.positions(p + h, steps)[0] - delta.positions(p - h, steps)[0]
        np.testing.assert_allclose(slopes[..., k], apart / 2e-6, atol=1e-8)


@both
def test_the_estimate_minimises_its_own_cost_and_has_the_covariance_of_that(kinematics):
    found = assess(made_text(kinematics, 3)[0])
    rows = found.answer["parameters"]
    scale = np.array([UNITS[row["unit"]] for row in rows])
    mean, sigma = (
        scale * np.array([row[key] for row in rows], dtype=float)
        for key in ("prior", "prior_sigma")
    )
    free = sigma > 0

    def cost(theta):
        *p, shrinkage, width = theta
        at = [np.array([of["steps"] for of in found.readings(kind)]) for kind in (False, True)]
        x, start, end = (
            found.delta.positions(np.array(p), steps)[0]
            for steps in (at[0][:, 0], at[1][:, 0], at[1][:, 1])
        )
        lengths = (1 - shrinkage) * np.linalg.norm(end - start, axis=1) + width
        z, d = (MM * found.column("value_mm", kind) for kind in (False, True))
        parts = (x[:, 2] - z) / found.noise("heights"), (lengths - d) / found.noise("distances")
        return sum(part @ part for part in (*parts, ((theta - mean) / sigma)[free]))

    theta, covariance = np.array(found.answer["theta"]), found.covariance
    for column in covariance[free] / np.sqrt(np.diag(covariance)[free, None]):
        beside = [cost(theta + step * column) - cost(theta) for step in (-0.1, 0.1)]
        assert beside == pytest.approx([0.01, 0.01], rel=0.05)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("off", [0, 0.35 * MM])
def test_one_wrong_height_of_many_is_the_outlier_and_no_correct_one(seed, off):
    printer, truth = made_printer(seed=seed, more=18)
    heights = truth.readings.heights + off * (np.arange(25) == 9)
    found = assess(text_of(printer, truth.readings._replace(heights=heights)))
    assert [of["name"] for of in found.readings() if of["outlier"]] == ["height9"] * bool(off)
    assert found.answer["verdict"].startswith("Do not rely") == bool(off) != found.answer["rely"]


@pytest.mark.parametrize("name", [*LEFT, "danorder-v400", "delta", "rotary_delta"])
def test_what_is_written_is_called_an_estimate_and_no_reading_counts_twice(name):
    text = made_text(name, 5)[0] if name.endswith("delta") else read(name)
    first = assess("#keep: me\r\n" + text.replace("\n", "\r\n"))
    again = assess(first.answer["config"])
    assert first.answer["config"].startswith("#keep: me\r\n")
    np.testing.assert_allclose(again.values, first.p, atol=1e-8)
    np.testing.assert_allclose(again.p, first.p, atol=1e-6)
    words = again.answer["words"]
    assert words[1].startswith("The file's parameters are truepose's estimate, not what Klipper's")
    assert words[0].startswith("Keep the file's parameters: they are the estimate")


@pytest.mark.parametrize("name", LEFT)
def test_klippers_criterion_finds_what_klipper_found(name):
    text = read(name)
    real = assess(text)
    radius = re.search(r"#\*# delta_radius = (.*)", text)[1]
    begun = assess(text.replace(f"= {radius}", f"= {float(radius) + 2}"))
    for found in (real, begun):
        assert abs(column(found, "klipper") - column(real, "now")).max() < 2e-4
    for found, key in ((real, "residual_now_mm"), (begun, "residual_klipper_mm")):
        assert rms(found.column(key)) == pytest.approx(LEFT[name], abs=5e-5)


def test_parameters_that_do_not_fit_the_readings_are_named_so():
    assert "do not fit the file's readings (z 0.13 mm rms" in words_of(read("danorder-v400"))[1]
    for name in LEFT:
        assert "are what Klipper's criterion gives" in words_of(read(name))[1]


def test_parameters_that_leave_as_much_as_klippers_fit():
    text = assess(read("danorder-v400"), sigma=[0, 0, 0, 0, 0.01]).answer["config"]
    assert words_of(text, arm=0.347)[1] == (
        "The file's parameters fit the file's readings as those of Klipper's criterion do "
        "(z 0.015 mm rms), angle_b off by 0.02°"
    )


def test_calliper_distances_left_out():
    """Issue's figures by others: heights alone 0.160 mm, Klipper's nine 0.059, plain mean 0.044."""
    held_out = assess(read("phnxdrgn536")).answer["held_out_mm"]
    left = {name: of["distances"] for name, of in held_out.items()}
    assert left["bed heights alone"] == pytest.approx(0.160, abs=5e-4)
    assert left["Klipper's nine parameters"] == pytest.approx(0.059, abs=5e-4)
    assert left["plain mean"] == pytest.approx(0.044, abs=5e-4)
    assert left["one common arm"] < 0.057
    assert left["estimate with tolerances"] < 0.057


def test_twelve_nearly_equal_distances_do_not_support_nine_parameters():
    assert "do not support nine parameters" in " ".join(words_of(read("phnxdrgn536")))


def test_words_say_whether_to_use_it():
    """Of one printer's readings: as they are, with another radius, with absurd arms in use."""
    text = read("phnxdrgn536")
    assert words_of(text)[0].startswith("Keep the file's parameters: they fit the readings")
    other = text.replace("delta_radius = 162.769280", "delta_radius = 164.769280")
    assert words_of(other)[0].startswith("Use the estimate: expected")
    assert words_of(other, arm=0.34)[0].startswith("Check whether the arms as drawn are 340 mm")
    found = assess(re.sub(r"(\*# arm_length) = .*", r"\1 = 163", text), arm=0.345)
    words = found.answer["words"]
    assert (
        words[1] == "The file's parameters cannot bring the nozzle to where its readings were taken"
    )
    assert words[0].endswith("with the file's parameters the nozzle does not reach the bed")
    assert found.answer["bed"]["now"]["rms_mm"] == [None, None, None]
    assert words_of(read("fzechert"))[0].startswith("Keep the file's")


def test_a_value_of_the_main_section_that_overrides_the_calibration_is_the_diagnosis():
    text = read("fzechert")
    for tower in "abc":
        text = text.replace(
            f"[stepper_{tower}]\n", f"[stepper_{tower}]\nposition_endstop: 419\n", 1
        )
    said = words_of(text)[0]
    assert said.startswith(
        "The main section overrides what SAVE_CONFIG wrote: [stepper_a] position"
    )
    assert "= 419 (saved: 419.361417)" in said and "even to 0.0068 mm rms, now to 0.34" in said
    near = re.sub(r"position_endstop: 419", "position_endstop: 419.361", text, count=1)
    assert "overrides" in words_of(near)[0]
    same = read("fzechert").replace("[stepper_a]\n", "[stepper_a]\nposition_endstop: 419.36\n", 1)
    assert words_of(same)[0].startswith("Keep the file's parameters")


def test_angles_of_the_drawing_mean_that_only_the_endstops_were_calibrated():
    said = words_of(read("danorder-v400"))[0]
    assert said.startswith("Only the endstops are calibrated: the towers' angles are the")
    assert "Run DELTA_CALIBRATE" in said and "now to 0.13" in said


@pytest.mark.parametrize("name", ["fzechert", "cupsster"])
def test_heights_alone_never_identify_an_arm(name):
    said = [row["verdict"] for row in assess(read(name)).answer["parameters"]]
    assert "identified" not in said[4:7]


def test_nor_do_hundreds_of_heights():
    made_one, truth = made_printer(seed=1, more=200)
    text = text_of(made_one, truth.readings.heights_only())
    found = assess(text, sigma=[50, 0, 0, 0, 1e-4])  # σ alone would call it seen
    arms = found.answer["parameters"][4:7]
    assert all(arm["verdict"] == "barely" for arm in arms)


@pytest.mark.parametrize("arms", [(0.214, 0.391, 0.288), (0.228, 0.605, 0.288)])
@pytest.mark.parametrize("with_readings", [True, False])
def test_arms_that_nobody_made_are_named(arms, with_readings):
    drawing = {f"stepper_{tower}__arm_length": 0.288 for tower in "abc"}
    made_one, truth = made_printer(**drawing, printer__delta_radius=0.14)
    named = dict(zip(drawing, arms, strict=True))
    text = text_of(changed(made_one, **named), truth.readings)
    said = f"arms of {', '.join(f'{1e3 * arm:.1f}' for arm in arms)} mm differ by"
    if not with_readings:
        with pytest.raises(tp.InputError, match=said):
            assess(text.split("#*# [delta_calibrate]")[0])
        return
    found = assess(text)
    assert any(said in note for note in found.answer["notes"])
    assert abs(found.p[4:7] - truth.p[4:7]).max() < 1.5 * MM  # 288, whatever the file says


def test_a_value_in_the_file_itself_is_taken_out_when_it_is_written():
    text = read("fzechert").replace("[stepper_b]\n", "[stepper_b]\narm_length: 345 # mine\n", 1)
    new = assess(text).answer["config"]
    assert "\n#arm_length: 345 # mine\n" in new
    assert column(assess(new), "now")[5] != 345


def test_values_of_several_lines_and_other_saved_options_stay():
    text = read("fzechert")
    radius = re.search(r"\n#\*# delta_radius = (.*)", text)
    text = text.replace(radius[0], "\n#*# other = 1\n#*# two = a\n#*# \tb")
    text = text.replace("[printer]\n", f"[printer]\ndelta_radius:\n  {radius[1]}\n  # mine\n", 1)
    text = text.replace("[printer]\n", "[gcode_macro X]\ngcode:\n  G28\n\n  G1 X0\n[printer]\n", 1)
    new = assess(text).answer["config"]
    assert f"\n#delta_radius:\n#  {radius[1]}\n#  # mine\n" in new
    assert "gcode:\n  G28\n\n  G1 X0\n" in new
    assert "\n#*# other = 1\n#*# two = a\n#*# \tb\n" in new
    assert assess(new).answer["words"][1].startswith("The file's parameters are truepose's")


def test_shipped_readings_name_their_source():
    for path in REAL.glob("*.cfg"):
        text = path.read_text(encoding="utf-8")
        assert "CC0-1.0" in text and "GitHub repository" in text and "commit" in text


def test_readings_of_no_such_printer_are_not_relied_on():
    text = read("fzechert")
    found = assess(text.replace("height3 = 17.3", "height3 = 20").replace("ht5 = 17.3", "ht5 = 15"))
    assert found.answer["verdict"].startswith("Do not rely on this calibration: heights are")
    assert not found.answer["rely"] and not assess(text).answer["notes"]


def test_parameters_far_from_the_assumed_tolerances_are_noticed():
    printer, _ = made_printer()
    built = made(printer, ASSUMED | {"angle": 2.5 * DEGREE}, 1).readings
    assert "assumed σ seem too small" in " ".join(assess(text_of(printer, built)).answer["notes"])


def test_the_noise_of_many_readings_is_found():
    printer, _ = made_printer()
    noisy = ASSUMED | {"height": 0.1 * MM, "distance": 0.01 * MM}
    noise = assess(text_of(printer, made(printer, noisy, 1, more=43).readings)).answer["noise"]
    assert [noise["heights_mm"], noise["distances_mm"]] == pytest.approx([0.1, 0.022], rel=0.2)
    dof = [noise["heights_dof"], noise["distances_dof"]]
    assert dof == pytest.approx([3 + 50 - 6, 3 + 12 - 5], abs=2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_seven_heights_are_too_few_to_judge_a_printer(seed):
    printer, truth = made_printer(seed=seed)
    words = words_of(text_of(printer, truth.readings.heights_only()))
    assert words[2].startswith("Too few readings to judge this calibration: an error of one")
    assert re.search(r"To show one of 0\.3 mm, add \d+ heights, spread evenly", words[2])
    assert not words[0].startswith("Do not rely")
