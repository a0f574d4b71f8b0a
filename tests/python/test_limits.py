"""Limits of a control cycle: derived, given, refused where they have no meaning, printed."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.control.limits import stop_text
from truepose.faults.fault import FRAME

Limits = tp.control.Limits


@pytest.mark.parametrize("name, times", [("delta", 0.12 / 0.05), ("h4", 1)])
def test_motors_may_rest_off_by_three_times_the_friction_of_given_effects(name, times):
    robot = tp.load(name)
    off = []
    for effects in (None, tp.Effects()):  # 0.12 N·m; assumed are 1 % of the torque limit
        limits = Limits(effects=effects).limits(robot)
        off.append(limits.motors("rests") - limits.motors("count"))
    assert off[1] == pytest.approx(times * off[0])


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"speed": 0.5}, "safety: speed of motor"),
        ({"box": [[-1, -1, -0.39, -4], [1, 1, 1, 4]]}, "safety: the path leaves box"),
        ({"box": [[-1, -1], [1, 1]]}, "box: must be lowest and highest coordinates"),
        ({"tracking": 1e-6}, "safety: motor 1: tracking 1e-06"),
        ({"slew": 10.0}, "slew 10 at least 6000"),
        ({"deviation": [1, 2]}, "deviation"),
        ({"age": 20}, "age 20"),
        ({"speed": np.inf}, "speed = inf: must be a finite number greater than 0"),
    ],
)
def test_limits_below_the_need_of_a_path_are_refused(h4, settings, message):
    move = tp.simulation.paths.Line(
        start=h4.home, end=np.add(h4.home, [0.05, 0, 0, 0]), duration=0.2
    )
    with refused(message) as error:
        Limits(**settings).limits(h4).require_path(*move.setpoints(h4, 1e-3))
    assert "\n" not in str(error.value)


def test_a_motor_without_a_torque_limit_has_no_limits(h4):
    weak = h4.with_each("chain", lambda chain: {"torque_limit": None})
    with refused("motor 1 has no torque_limit"):
        Limits().limits(weak)


def test_a_stop_is_told_in_one_line():
    time, none = np.arange(3) * 0.1, np.full(3, -1)
    said = stop_text(time, np.array([0, 0, 15]), np.array([0, 0, 14]), np.array([-1, -1, 2]))
    assert said == "safety shell: overspeed of motor 3 at 0.200 s, stopped by brake"
    assert stop_text(time, np.zeros(3, int), np.zeros(3, int), none) == ""


@pytest.mark.parametrize(
    "name, value",
    [
        ("stop", 0), ("window", 9), ("held", "x"),
        ("stop", 5.1), ("brake", 0.51), ("counter", "no"), ("effects", "all"),
    ],
)  # fmt: skip
def test_settings_without_a_meaning_are_refused(name, value):
    with refused(name):
        Limits(**{name: value})


def test_own_limits_are_printed_as_given(h4):
    limits = Limits(tracking=0.01, stop=0.1).limits(h4)
    rows = {row["limit"]: row for row in limits.table()}
    assert rows["tracking"]["default"] == rows["stop"]["default"] == "given"
    assert rows["tracking"]["motor 4"] == 0.01 and "Stopping distance" in repr(limits)
    assert limits.stopping_distance(0.3) < limits.stopping_distance(0.6)


def test_a_frame_takes_only_faults_of_no_single_reading(h4):
    with refused("kind of a frame"):
        tp.simulate(h4, faults=[tp.faults.Fault(FRAME, "bias", size=0.1)])
