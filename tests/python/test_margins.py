"""Are a linearised loop's margins the simulated robot's, and do chosen gains keep them?"""

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.simulation import gains
from truepose.simulation.effects import Effects
from truepose.simulation.linear import Gains, plants
from truepose.simulation.loci import Responses, worst


@pytest.mark.parametrize("law", ["joint", "redundant", "estimated"])
@pytest.mark.parametrize("groups", [["delay"], ["compliance"], ["delay", "compliance"]])
def test_a_simulated_robot_swings_up_where_its_gain_margin_ends(h4, law, groups):
    robot, effects = h4.unquantised(), Effects().only(*groups)
    loop = Responses(plants(robot, [robot.home], law, effects, 1e-3))
    margin = loop.common(Gains(40, 300))[0].more
    late = []
    for share in (0.93, 1.07):  # gains times k: poles times √k, damping times √k
        root = np.sqrt(share * margin)
        controller = tp.Controller(
            law=law, frequency=40 * root, damping=root, velocity_bandwidth=300
        )
        run = tp.simulate(
            robot,
            controller=controller,
            start=robot.home + np.array([1e-5, 0, 0, 0]),
            end=robot.home,
            duration=0.01,
            hold=1.5,
            effects=effects,
        )
        late.append(np.ptp(run.x[-200:], axis=0).max())
    assert late[0] < 1e-6
    assert late[1] > 1e-4


def test_two_cycles_more_are_borne_and_three_not_where_the_delay_margin_lies_between(h4):
    loop = Responses(plants(h4, [h4.home], "redundant", Effects().only("delay"), 1e-3))
    poles = next(
        found
        for found in (Gains(f, 10 * f) for f in range(60, 150))
        if 2.2 < loop.common(found)[0].delay < 2.8
    )
    radius = []
    for more in (2, 3):
        late = replace(loop.plants[0], late=1 + more)
        radius.append(abs(np.linalg.eigvals(late.closed(poles))).max())
    assert radius[0] < 1 < radius[1]


def test_chosen_gains_keep_the_margins_that_they_promise_at_every_corner(h4):
    chosen = gains.choose(h4, "redundant", Effects(), 1e-3)
    found = gains.responses(h4, "redundant", Effects(), 1e-3)
    assert len(found.plants) == 17 and found.stable(chosen)
    of_each = sum(found.alone(chosen) + found.torques(chosen), found.common(chosen))
    assert gains.kept(worst(of_each))


#: A count of these motors moves the nacelle by more than 50 µm: they hunt by it.
COARSE = ("3rrr", "five-bar")


@pytest.mark.parametrize("name", [name for name in tp.robots() if name not in COARSE])
def test_with_all_effects_a_robot_comes_to_rest_under_the_law_alone(name):
    robot = tp.load(name)
    run = tp.simulate(robot, effects=Effects(), hold=0.8)
    last = run.time >= run.time[-1] - 0.2
    swing = np.ptp(run.x[last], axis=0)
    for (_, unit), far in zip(robot.coordinates, swing, strict=True):
        assert far <= (50e-6 if unit == "m" else np.radians(0.05))
    limits = [chain.torque_limit for chain in robot.spec.chain]
    assert (run.torque[last].std(axis=0) <= 0.02 * np.array(limits)).all()


@pytest.mark.parametrize("law", ["joint", "redundant"])
def test_counts_shake_motors_by_some_twice_what_white_noise_would(h4, law):
    chosen = gains.choose(h4, law, Effects(), 1e-3)
    run = tp.simulate(h4, controller=law, effects=Effects(), hold=0.8)
    loop = Responses(plants(h4, [run.x_d[-1]], law, Effects(), 1e-3))
    predicted = loop.dither(chosen, h4.reading_sigma).max()
    # Counts at rest are no white noise: a loop hunts by one.
    assert 0.5 < run.torque[-200:].std(axis=0).max() / predicted < 3


def test_a_period_at_which_no_gains_hold_the_robot_is_refused_with_the_reason(h4):
    with pytest.raises(tp.InputError, match=r"h4: period 0\.05 s: .* cycles are left"):
        tp.Controller.for_robot(h4, period=0.05)


def test_without_effects_a_law_keeps_the_papers_poles(h4):
    for effects in (None, Effects.none()):
        assert tp.simulate(h4, effects=effects).controller.frequency == 150
