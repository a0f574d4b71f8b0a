"""The consistency test of tolerances. By the log's own χ²."""

import functools
import re

import numpy as np
import pytest
from scipy.stats import chi2

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.calibration.learnt import FALSE_ALARMS, SEEN

ELBOWS = ("elbow1", "elbow2", "elbow3", "elbow4")

#: Robot, sensors, level of the robot that is read, poses.
CASES = {
    "h4, theta": ("h4", ("theta",), "ideal", 40),
    "h4, theta, elbows": ("h4", ("theta", *ELBOWS), "ideal", 100),
    "h4, every rod": ("h4", ("theta", *ELBOWS), "full", 50),
    "delta": ("delta", ELBOWS[:3], "ideal", 60),
    "stewart": ("stewart", ("roll", "pitch"), "ideal", 40),
}


def drawn(robot, seed, times):
    """A robot whose errors are normal, all of them `times` what its tolerances say."""
    rng = np.random.default_rng(seed)
    known = robot.parameters
    return robot.replace(
        {name: p.mean + times * p.sigma * rng.normal() for name, p in known.items() if p.sigma > 0}
    )


@functools.cache
def robot_of(case):
    name, sensors, _, _ = CASES[case]
    return tp.load(name).with_sensors(*sensors)


def calibrated(case, anywhere, seed, times):
    _, _, level, poses = CASES[case]
    robot = robot_of(case)
    x = anywhere(robot, poses, np.random.default_rng([seed, poses]))
    q_e = drawn(robot, seed, times).read(x, seed=seed, level=level)
    error = "on" if level == "full" else "off"
    options = CalibrationOptions(model_error=error, cause="ignore")
    return tp.calibrate(robot, q_e, options=options)


def said(fit):
    return any("too small by a factor" in note for note in fit.notes)


def seen(fit):
    return sum(ratio <= SEEN for ratio, _ in fit.worst_known(len(fit.names)))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("times", [1, 2])
def test_tolerances_twice_too_small_are_said_and_right_ones_are_not(
    case, times, anywhere, robots_drawn
):
    """As often as χ² itself would tell: 9 of 10 robots from fifteen combinations on."""
    fits = [calibrated(case, anywhere, seed, times) for seed in range(robots_drawn)]
    counts = np.array([seen(fit) for fit in fits])
    assert [fit.departure.combinations for fit in fits] == counts.tolist() and (counts > 0).all()
    power = chi2.sf(chi2.isf(FALSE_ALARMS, counts) / times**2, counts).mean()
    scatter = np.sqrt(power * (1 - power) / len(fits))
    often = np.mean([said(fit) for fit in fits])
    assert abs(often - power) < 0.05 + 3.29 * scatter
    if times == 1:
        assert often < 0.01 + 3.29 * np.sqrt(0.01 / len(fits))
    elif counts.min() >= 15:
        assert often >= 0.9
    factor = np.sqrt(np.mean([fit.departure.factor**2 for fit in fits]))
    assert factor == pytest.approx(times, rel=0.15)


def test_the_note_gives_factor_and_combinations(anywhere):
    fit = calibrated("stewart", anywhere, 1, 2)
    (note,) = fit.notes
    factor = re.search(
        r"^the tolerances seem too small by a factor of about (\S+), judged by the (\d+) comb", note
    )
    assert 1.6 < float(factor[1]) < 2.4 and int(factor[2]) == seen(fit)


def test_a_longer_log_that_contradicts_a_calibration_doubts_it(anywhere):
    """The robot was taken apart in between: it is another one, of the same drawing."""
    robot, rng = robot_of("delta"), np.random.default_rng(7)
    few, many = anywhere(robot, 6, rng), anywhere(robot, 200, rng)
    first = tp.calibrate(
        robot, drawn(robot, 1, 1).read(few, seed=1), options=CalibrationOptions(model_error="off")
    )
    same, rebuilt = (drawn(robot, seed, 1).read(many, seed=2) for seed in (1, 2))
    assert not tp.calibrate(first.robot, same, options=CalibrationOptions(model_error="off")).notes
    (note,) = tp.calibrate(
        first.robot, rebuilt, options=CalibrationOptions(model_error="off", cause="ignore")
    ).notes
    assert note.startswith("the last calibration's σ seem too small by a factor of about")
