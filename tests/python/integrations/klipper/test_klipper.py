"""Delta printers by Klipper's saved readings, against Klipper's own results."""

import dataclasses
import re

import numpy as np
import pytest
from printer_files import REAL, changed, made_printer, made_text, read, text_of
from printer_trials import drawn, poses, trials
from printer_trials import made as made_of
from scipy.optimize import least_squares
from truepose.integrations.klipper.config import SAVED_HEADER, Config, rewritten
from truepose.integrations.klipper.criterion import errors, klipper, rms, weight
from truepose.integrations.klipper.estimate import (
    Assumed,
    UnfitError,
    estimate,
    knowing,
    prior,
    verdict,
)
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.noise import judge
from truepose.integrations.klipper.printer import DEGREE, MM, options, printer_of, probe_offset
from truepose.integrations.klipper.prints import over_the_bed

import truepose as tp
from truepose.integrations.klipper import figures, held_out, output, review
from truepose.integrations.klipper.assessment import assess

#: z rms that Klipper's parameters leave, mm.
LEFT = {"phnxdrgn536": 0.0183, "fzechert": 0.0063, "cupsster": 0.0759}


def printer(name: str):
    return printer_of(Config.parse(read(name)))


def in_the_files_units(kinematics: str, p: np.ndarray) -> np.ndarray:
    return p / np.array([option.scale for option in options(kinematics).values()])


@pytest.mark.parametrize("name", LEFT)
def test_klippers_criterion_finds_what_klipper_found(name):
    real = printer(name)
    model = Model(real)
    begun = real.values.copy()
    begun[0] += 2 * MM
    begun[1] += 0.2 * DEGREE
    begun[-3:] -= 1 * MM
    for start in (real.values, begun):
        found = klipper(model, start, real.readings)
        off = in_the_files_units("delta", found - real.values)
        assert abs(off).max() < 1e-3  # mm, degrees
    for p in (real.values, found):
        left = errors(model, p, real.readings).heights
        assert rms(left) / MM == pytest.approx(LEFT[name], abs=5e-5)


def test_parameters_that_do_not_fit_the_readings_are_named_so():
    found = assess(Config.parse(read("danorder-v400")))
    assert not found.as_klipper_would
    assert any(
        "do not fit the file's readings (z 0.13 mm rms" in line for line in review.words(found)
    )
    assert all(assess(Config.parse(read(name))).as_klipper_would for name in LEFT)


@pytest.mark.parametrize("name", [*LEFT, "danorder-v400"])
def test_an_estimate_in_the_file_is_called_one(name):
    text = output.config_text(assess(Config.parse(read(name))))
    words = review.words(assess(Config.parse(text)))
    assert words[0].startswith("The file's parameters are truepose's estimate, not what Klipper's")
    assert "do not tell apart" not in words[-1]
    assert words[-1].startswith("Keep the file's parameters")


def test_parameters_that_leave_as_much_as_klippers_fit():
    fine = Assumed(height=0.01 * MM)
    text = output.config_text(assess(Config.parse(read("danorder-v400")), assumed=fine))
    found = assess(Config.parse(text), arm=0.347)
    assert not found.holds_estimate and not found.as_klipper_would
    assert review.words(found)[0] == (
        "The file's parameters fit the file's readings as those of Klipper's criterion do "
        "(z 0.015 mm rms), angle_b off by 0.02°"
    )


def test_calliper_distances_left_out():
    """Issue's figures by others: heights alone 0.160 mm, Klipper's nine 0.059, plain mean 0.044."""
    found = assess(Config.parse(read("phnxdrgn536")))
    left = {way.name: rms(way.distances) / MM for way in found.held_out}
    assert left["bed heights alone"] == pytest.approx(0.160, abs=5e-4)
    assert left["Klipper's nine parameters"] == pytest.approx(0.059, abs=5e-4)
    assert left["plain mean"] == pytest.approx(0.044, abs=5e-4)
    assert left["one common arm"] < 0.057
    assert left[held_out.ESTIMATE] < 0.057


def test_twelve_nearly_equal_distances_support_neither_nine_parameters_nor_a_scale():
    found = assess(Config.parse(read("phnxdrgn536")))
    words = " ".join(review.words(found))
    assert "do not support nine parameters" in words
    assert found.scale.verdict == "barely"
    assert abs(found.scale.value) < found.scale.sigma < 1.2e-3
    assert "barely identified" in words


def test_words_say_whether_to_use_it():
    """Of one printer's readings: as they are, with wrong arms as drawn, with absurd ones in use."""
    text = read("phnxdrgn536")
    assert review.words(assess(Config.parse(text)))[-1].startswith("Use the estimate: expected")
    kept = review.words(assess(Config.parse(text), arm=0.34))[-1]
    assert kept.startswith("Keep the file's parameters, and look whether the arms as drawn are 340")
    short = re.sub(r"(\*# arm_length) = .*", r"\1 = 163", text)
    found = assess(Config.parse(short), arm=0.345)
    words = review.words(found)
    assert (
        words[0] == "The file's parameters cannot bring the nozzle to where its readings were taken"
    )
    assert words[-1].endswith("with the file's parameters the nozzle does not reach the bed")
    assert len(found.before.points) == 0 and len(figures.bed(found).axes) == 9
    assert review.words(assess(Config.parse(read("fzechert"))))[-1].startswith("Keep the file's")


def test_the_estimate_is_the_minimum_of_its_own_cost():
    """Another way there: Klipper's parameters, κ and b as the unknowns, by scipy alone."""
    real, assumed = printer("phnxdrgn536"), Assumed()
    model = Model(real)
    known = prior(model, real, assumed, arm=0.345)
    sigma = np.array([*known.sigma, assumed.shrinkage, assumed.width])
    free = sigma > 0
    readings = real.readings

    def residual(u: np.ndarray) -> np.ndarray:
        theta = np.array([*known.mean, 0.0, 0.0])
        theta[free] += sigma[free] * u
        e = errors(model, theta[:-2], readings)
        d = (1 - theta[-2]) * e.lengths + theta[-1] - readings.distances
        return np.concatenate([u, e.heights / assumed.height, d / assumed.distance])

    fit = least_squares(residual, np.zeros(free.sum()))
    found = estimate(model, readings, known, assumed)
    unknown = np.array([*(found.p - known.mean), found.shrinkage, found.width])[free] / sigma[free]
    spread = np.sqrt(np.diag(found.covariance)[free]) / sigma[free]
    np.testing.assert_allclose(unknown, fit.x, atol=0.02)  # a step's count has a σ, too
    own = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    np.testing.assert_allclose(spread, own, rtol=0.03)


@pytest.mark.parametrize("name", ["fzechert", "cupsster"])
def test_heights_alone_never_identify_an_arm(name):
    found = assess(Config.parse(read(name)))
    learnt = found.estimate.learnt(found.model.names)
    said = [
        verdict(f"arm_{tower}", learnt[f"arm_{tower}"], found.printer.readings) for tower in "abc"
    ]
    assert "identified" not in said


def test_nor_do_a_thousand_heights():
    made, model, truth = made_printer()
    rng = np.random.default_rng(1)
    turn, ring = rng.uniform(0, 2 * np.pi, 999), made.radius * np.sqrt(rng.uniform(size=999))
    at = np.stack([ring * np.cos(turn), ring * np.sin(turn), np.full(999, 0.016)], axis=1)
    many = dataclasses.replace(
        truth.readings.heights_only(),
        heights=at[:, 2],
        height_steps=model.steps(truth.p, at),
        height_names=tuple(f"height{k}" for k in range(999)),
        probed=999,
    )
    loose = Assumed(arm=20 * MM, height=0.001 * MM)  # so that σ by itself would call them seen
    found = estimate(model, many, prior(model, made, loose), loose)
    learnt = found.learnt(model.names)
    assert learnt["arm_b"].verdict == "identified"
    assert verdict("arm_b", learnt["arm_b"], many) == "barely"


@pytest.mark.parametrize("arms", [(0.214, 0.391, 0.288), (0.228, 0.605, 0.288)])
@pytest.mark.parametrize("with_readings", [True, False])
def test_arms_that_nobody_made_are_named(arms, with_readings):
    drawing = {f"arm_{tower}": 0.288 for tower in "abc"} | {"radius": 0.14}
    made, _, truth = made_printer(**drawing)
    text = text_of(changed(made, arm_a=arms[0], arm_b=arms[1], arm_c=arms[2]), truth.readings)
    named = f"arms of {', '.join(f'{1e3 * arm:.1f}' for arm in arms)} mm differ by"
    if not with_readings:
        with pytest.raises(tp.InputError, match=named):
            assess(Config.parse(text.split("#*# [delta_calibrate]")[0]))
        return
    found = assess(Config.parse(text))
    assert any(named in note for note in found.notes)
    assert abs(found.estimate.p[4:7] - truth.p[4:7]).max() < 1.5 * MM  # 288, whatever the file says


@pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])
def test_positions_are_klippers(kinematics):
    """By formulas of their own: three spheres; an arm's angle in its plane."""
    made, model, truth = made_printer(kinematics, seed=4)
    touched, ends = poses(made.radius)
    x = np.concatenate([touched, ends.reshape(-1, 3)])
    p = dict(zip(model.names, truth.p, strict=True))
    ends = np.array([p[f"endstop_{tower}"] for tower in "abc"])
    steps = np.zeros((len(x), 3))
    for k, tower in enumerate("abc"):
        c, s = np.cos(p[f"angle_{tower}"]), np.sin(p[f"angle_{tower}"])

        def motor(at, c=c, s=s, tower=tower):
            if kinematics == "delta":
                away = np.hypot(at[:, 0] - p["radius"] * c, at[:, 1] - p["radius"] * s)
                return at[:, 2] + np.sqrt(p[f"arm_{tower}"] ** 2 - away**2)
            out = at[:, 0] * c + at[:, 1] * s - p["shoulder_radius"]
            up, aside = at[:, 2] - p["shoulder_height"], at[:, 1] * c - at[:, 0] * s
            arm, rod2 = p[f"upper_arm_{tower}"], p[f"lower_arm_{tower}"] ** 2 - aside**2
            reach2 = out**2 + up**2
            bend = np.arccos((reach2 + arm**2 - rod2) / (2 * arm * np.sqrt(reach2)))
            return np.arctan2(up, out) + bend

        at_end = motor(np.array([[0.0, 0.0, ends[k]]]))
        steps[:, k] = (at_end - motor(x)) / made.step[k]
    np.testing.assert_allclose(model.steps(truth.p, x), steps, atol=1e-6)
    np.testing.assert_allclose(model.positions(truth.p, steps), x, atol=1e-9)


@pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])
def test_jacobians_are_slopes(kinematics):
    _, model, truth = made_printer(kinematics, seed=2)
    steps, h = truth.readings.distance_steps[:, 1], 1e-6
    x = model.positions(truth.p, steps)
    for function, J in (
        (model.xi, model.xi_jacobian(truth.p)),
        (lambda p: model.positions(p, steps), model.position_jacobian(truth.p, x)),
    ):
        for k, e in enumerate(h * np.eye(len(truth.p))):
            slope = (function(truth.p + e) - function(truth.p - e)) / (2 * h)
            np.testing.assert_allclose(J[..., k], slope, atol=1e-8)


def test_the_weight_of_a_height_is_klippers():
    readings = printer("phnxdrgn536").readings
    assert weight(readings) == 12 / (0.5 * 7)
    assert weight(readings.heights_only()) == 1
    by_hand = dataclasses.replace(readings, probed=5)  # heights found by hand do not count there
    assert weight(by_hand) == 12 / (0.5 * 5)
    assert by_hand.without(heights=[0]).probed == 5
    assert by_hand.without(heights=[6]).probed == 4


@pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])
def test_what_is_written_is_read_again(kinematics, tmp_path):
    text, _ = made_text(kinematics, seed=3)
    text = text.replace("[delta_calibrate]", "#keep: me\n[delta_calibrate]", 1)
    found = assess(Config.parse(text))
    new = output.config_text(found)
    again = printer_of(Config.parse(new))
    np.testing.assert_allclose(
        in_the_files_units(kinematics, again.values),
        in_the_files_units(kinematics, found.estimate.p),
        atol=6e-7,
    )
    np.testing.assert_array_equal(again.readings.height_steps, found.printer.readings.height_steps)
    assert "#keep: me" in new
    assert new.count("SAVE_CONFIG") == 1
    (tmp_path / "printer.toml").write_text(output.robot_text(found), encoding="utf-8")
    robot = tp.load(tmp_path / "printer.toml")
    rows = -found.printer.readings.height_steps * found.printer.step
    x = found.model.positions(found.estimate.p, found.printer.readings.height_steps)
    np.testing.assert_allclose(robot.fkm(rows), x, atol=1e-9)
    J = found.model.position_jacobian(found.estimate.p, x)
    noise = robot.jacobian(x) ** 2 @ robot.reading_sigma**2
    own = np.einsum("nip,pq,niq->ni", J, found.estimate.covariance_p, J) + noise
    told = np.diagonal(tp.accuracy(robot, x), axis1=1, axis2=2)
    np.testing.assert_allclose(told, own, rtol=1e-3)


@pytest.mark.parametrize(
    ("kinematics", "arm"), [("delta", None), ("delta", 0.3455), ("rotary_delta", None)]
)
def test_the_same_readings_never_count_twice(kinematics, arm):
    """An estimate from a file with an estimate is the same one: the nominal geometry stays."""
    text = read("phnxdrgn536") if kinematics == "delta" else made_text(kinematics, seed=3)[0]
    if arm is None:
        text = re.sub(r"\n#arm_length.*", "", text)  # the file says of no drawing
    first = assess(Config.parse(text), arm)
    new = output.config_text(first)
    again = assess(Config.parse(new))
    assert again.prior.arm == pytest.approx(first.prior.arm, abs=1e-9)
    np.testing.assert_allclose(again.estimate.p, first.estimate.p, rtol=0, atol=1e-7)
    own = new.split(SAVED_HEADER)[0]
    assert output.config_text(again).split(SAVED_HEADER)[0] == own


def test_a_value_in_the_file_itself_is_taken_out_when_it_is_written():
    text = read("fzechert").replace("[stepper_b]\n", "[stepper_b]\narm_length: 345 # mine\n", 1)
    new = output.config_text(assess(Config.parse(text)))
    assert "\n#arm_length: 345 # mine\n" in new
    assert printer_of(Config.parse(new)).parameters["arm_b"] != 0.345


def test_left_out_is_left_out():
    """A reading's own error does not help to predict it."""
    made, model, truth = made_printer(seed=6)
    known = prior(model, made, Assumed())
    ways = held_out.ways(model, made.values, truth.readings, known.mean)
    spoilt = truth.readings.distances.copy()
    spoilt[3] += 0.3 * MM
    off = dataclasses.replace(truth.readings, distances=spoilt)
    before, after = (
        held_out.leave_one_out(
            model, of, ways, judge(model, of, estimate(model, of, known, Assumed()))
        )
        for of in (truth.readings, off)
    )
    for one, other in zip(before, after, strict=True):
        exact = one.name != held_out.ESTIMATE  # that one to first order
        change = pytest.approx(-0.3 * MM, abs=2e-8 if exact else 1e-6)
        assert other.distances[3] - one.distances[3] == change


def test_many_readings_are_left_out_in_parts():
    made, model, truth = made_printer(seed=6)
    rng = np.random.default_rng(2)
    turn, ring = rng.uniform(0, 2 * np.pi, 60), made.radius * np.sqrt(rng.uniform(size=60))
    at = np.stack([ring * np.cos(turn), ring * np.sin(turn), np.full(60, 0.016)], axis=1)
    many = dataclasses.replace(
        truth.readings.heights_only(),
        heights=at[:, 2] + 3e-5 * rng.standard_normal(60),
        height_steps=model.steps(truth.p, at),
        height_names=tuple(f"height{k}" for k in range(60)),
        probed=60,
    )
    fits = []

    def way(part):
        fits.append(len(part.heights))
        return truth.p

    by = judge(model, many, estimate(model, many, prior(model, made, Assumed()), Assumed()))
    found, _ = held_out.leave_one_out(model, many, {"the truth": way}, by)
    assert fits == [57] * 12 + [58] * 12
    np.testing.assert_allclose(found.heights, at[:, 2] - many.heights, atol=1e-9)


def test_a_print_shows_scale_and_skew():
    """Seen by a square of 100 mm, printed with parameters that are wrong."""
    made, model, truth = made_printer()
    found = estimate(model, truth.readings, prior(model, made, Assumed()), Assumed())
    believed = found.p + np.array([1, 0, 0, 0, 0.5, -0.5, 0.2, 0, 0, 0]) * MM
    believed[1] += 0.3 * DEGREE
    square = 50 * MM * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    printed = model.positions(found.p, model.steps(believed, square))
    x, y = printed[0] - printed[1], printed[2] - printed[3]
    sides = np.linalg.norm([x, y], axis=1) / 0.1
    shape = over_the_bed(model, believed, found, 50 * MM).shape
    assert shape.scale[0] == pytest.approx(sides.mean() - 1, rel=0.15)
    assert shape.stretch[0] == pytest.approx(sides[0] - sides[1], rel=0.15)
    assert shape.skew[0] == pytest.approx(x @ y / 0.01, rel=0.15)
    assert shape.print_scale[0] == pytest.approx(shape.scale[0] - found.shrinkage, rel=1e-9)
    assert all(abs(value) > 1e-4 for value in (shape.scale[0], shape.stretch[0], shape.skew[0]))


def test_where_a_print_stands_is_no_error():
    made, model, truth = made_printer()
    found = estimate(model, truth.readings, prior(model, made, Assumed()), Assumed())
    turned = found.p.copy()
    turned[[model.names.index(f"angle_{tower}") for tower in "abc"]] += 1 * MM
    bed = over_the_bed(model, turned, found, made.radius)
    assert abs(bed.offset).max() < 1e-3 * made.radius * 1e-3  # of second order


def test_shipped_readings_name_their_source():
    for path in REAL.glob("*.cfg"):
        text = path.read_text(encoding="utf-8")
        assert "CC0-1.0" in text and "GitHub repository" in text and "commit" in text


@pytest.mark.parametrize("kinematics", ["delta", "rotary_delta"])
def test_printers_as_drawn_reach_their_poses(kinematics):
    made = drawn(kinematics)
    assert all(np.isfinite(Model(made).steps(made.values, x)).all() for x in poses(made.radius))


def test_a_probe_is_at_the_nozzle_where_the_file_gives_no_offset():
    section, offset = probe_offset(Config.parse("[probe]\ny_offset: -20\nz_offset: 18.5\n"))
    assert section == "probe" and offset == pytest.approx((0.0, -0.02, 0.0185))
    assert probe_offset(Config.parse("[printer]\n")) is None


@pytest.mark.parametrize("tower", "abc")
def test_a_printer_with_an_arm_that_is_too_short_is_no_robot(tower):
    made, model, _ = made_printer()
    p = prior(model, made, Assumed()).mean.copy()
    p[model.names.index(f"arm_{tower}")] = 0.05
    with pytest.raises(UnfitError, match="an arm does not reach"):
        knowing(model, p, 1e-8 * np.eye(len(p)), "a test")


def test_what_all_points_share_has_no_sigma():
    """A turn of all towers is no error of x or y, however little is known of it."""
    made, model, truth = made_printer()
    found = estimate(model, truth.readings, prior(model, made, Assumed()), Assumed())
    turn = np.zeros(len(found.covariance))
    turn[[model.names.index(f"angle_{tower}") for tower in "abc"]] = 0.01
    loose = dataclasses.replace(found, covariance=found.covariance + np.outer(turn, turn))
    known, unknown = (over_the_bed(model, found.p, of, made.radius) for of in (found, loose))
    np.testing.assert_allclose(unknown.sigma, known.sigma, rtol=1e-6)


def test_readings_of_no_such_printer_are_not_relied_on():
    text = (
        read("fzechert").replace("height3 = 17.3", "height3 = 20").replace("ht5 = 17.3", "ht5 = 15")
    )
    found = assess(Config.parse(text))
    assert review.words(found)[-1].startswith("Do not rely on this calibration: heights are")
    assert not assess(Config.parse(read("fzechert"))).notes


def test_the_noise_of_many_readings_is_found():
    made, model, _ = made_printer()
    noisy = Assumed(height=0.1 * MM, distance=0.01 * MM)
    readings = made_of(model, made, noisy, 1, more=43).readings
    first = estimate(model, readings, prior(model, made, Assumed()), Assumed())
    noise = judge(model, readings, first).noise
    assert noise.sigma == pytest.approx([0.1 * MM, 0.022 * MM], rel=0.2)
    assert noise.dof == pytest.approx([3 + 50 - 6, 3 + 12 - 5], abs=2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_seven_heights_are_too_few_to_judge_a_printer(seed):
    made, _, truth = made_printer(seed=seed)
    text = text_of(made, truth.readings.heights_only())
    words = review.words(assess(Config.parse(text)))
    assert words[-2].startswith("Too few readings to judge this calibration: an error of one")
    assert re.search(r"To show one of 0\.3 mm, add \d+ heights, spread evenly", words[-2])
    assert not words[-1].startswith("Do not rely")


@pytest.mark.parametrize("off", [0.0, 0.3, -0.3])
def test_one_wrong_height_of_many_is_named(off):
    made, model, _ = made_printer()
    readings = made_of(model, made, Assumed(), 5, more=18).readings.heights_only()
    heights = readings.heights.copy()
    heights[9] += off * MM
    text = text_of(made, dataclasses.replace(readings, heights=heights))
    words = review.words(assess(Config.parse(text)))
    assert not any(line.startswith("Too few") for line in words)
    warned = re.match(r"Do not rely on this calibration: height9 = .*?: (\S+) mm off", words[-1])
    assert bool(warned) == bool(off)
    assert not off or float(warned[1]) == pytest.approx(off, abs=0.1)


@pytest.mark.parametrize(("distances", "more"), [(True, 0), (False, 18)])
def test_sampled_printers_are_inside_their_intervals_and_are_not_warned_of(distances, more):
    """Of other noise than assumed. `benchmarks/printers.py` has the figures of many more."""
    ran = list(trials("delta", 25, 0, distances, noise=(0.01 * MM, 0.1 * MM), more=more))
    inside = np.mean([trial.inside for trial in ran], axis=0)
    assert (inside > 0.9).all() and inside.mean() < 0.99
    assert not any(trial.rejected for trial in ran)
    can = [trial for trial in ran if trial.shows]
    assert len(can) > 12 if more else not can
    assert all(trial.found for trial in can)


def test_a_file_that_is_rewritten_keeps_its_other_saved_options():
    text = (
        "[printer]\nkinematics: delta\nDelta_Radius: 150.0\n\n[stepper_a]\n#Arm_Length: 345.0\n\n"
        + SAVED_HEADER
        + "#*# [stepper_a]\n#*# position_endstop = 301.5\n#*# angle = 210.25\n"
    )
    config = Config.parse(text)
    assert config.off == {("stepper_a", "arm_length"): 345.0}  # Klipper's options have no case
    changes = {"printer": {"delta_radius": "151.5"}, "stepper_a": {"position_endstop": "302.5"}}
    again = Config.parse(rewritten(config, changes, {}))
    assert again.values["stepper_a"] == {"position_endstop": "302.5", "angle": "210.25"}
    assert again.values["printer"] == {"kinematics": "delta", "delta_radius": "151.5"}
    assert again.off == {("printer", "delta_radius"): 150.0, **config.off}


def test_a_value_of_several_lines_is_taken_out_whole():
    text = "[printer]\nmacro:\n  G28\n\n  G1 X0\nkinematics: delta\nradius:\n  150\n  # mine\n"
    new = rewritten(Config.parse(text), {"printer": {"radius": "151"}}, {})
    own = new.split(SAVED_HEADER)[0]
    assert own == text.replace("radius:\n  150\n  # mine", "#radius:\n#  150\n#  # mine") + "\n"
    assert Config.parse(new).values["printer"]["macro"] == "\nG28\n\nG1 X0"
