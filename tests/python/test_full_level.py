"""level="full", where every rod closes its own loop, and where it is refused."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp

X_D = np.array([0.03, -0.02, -0.42, 0.15])

PAR4 = """
name = "par4"
mobility = "schoenflies"
home = [0.0, 0.0, -0.7, 0.0]
chain_defaults = { actuator = "revolute", arm = 0.375, rod = 0.8 }
chain = [
  { base = [0.2, 0.2, 0], arm_zero = [0.6, 0.8, 0], axis = [-0.8, 0.6, 0], anchor = [0, 0.06, 0], bar = 1 },
  { base = [-0.2, 0.2, 0], arm_zero = [-0.6, 0.8, 0], axis = [-0.8, -0.6, 0], anchor = [0, 0.06, 0], bar = 2 },
  { base = [-0.2, -0.2, 0], arm_zero = [-0.6, -0.8, 0], axis = [0.8, -0.6, 0], anchor = [0, -0.06, 0], bar = 2 },
  { base = [0.2, -0.2, 0], arm_zero = [0.6, -0.8, 0], axis = [0.8, 0.6, 0], anchor = [0, -0.06, 0], bar = 1 },
]
bar = [{ direction = [1, 0, 0], pivot = 0.06 }, { direction = [-1, 0, 0], pivot = 0.06 }]
platform = { bars = "four_bar" }
"""  # noqa: E501

LINEAR_DELTA = """
name = "linear-delta"
mobility = "translation"
home = [0.0, 0.0, -0.5]
workspace = { minimum = [-0.1, -0.1, -0.6], maximum = [0.1, 0.1, -0.4] }
chain_defaults = { actuator = "prismatic", rod = 0.6, working_mode = 1 }
chain = [
  { base = [0.35, 0, 0], anchor = [0.05, 0, 0] },
  { base = [-0.175, 0.3, 0], anchor = [-0.025, 0.043, 0] },
  { base = [-0.175, -0.3, 0], anchor = [-0.025, -0.043, 0] },
]
"""


@pytest.fixture
def paired(request, load, h4, delta):
    """Return a robot whose chains are spatial parallelograms."""
    return {"h4": h4, "delta": delta}.get(request.param) or load(LINEAR_DELTA)


every_paired = pytest.mark.parametrize("paired", ["h4", "delta", "linear-delta"], indirect=True)


def built(robot, rng):
    """Return the robot with 0.1° (1σ) of yaw and tilt on every axis."""
    names = [f"chain{i}.{angle}" for i in range(1, robot.n + 1) for angle in ("yaw", "tilt")]
    return robot.replace(
        dict(zip(names, np.radians(0.1) * rng.normal(size=len(names)), strict=True))
    )


@every_paired
def test_with_exact_axes_both_levels_agree_to_rounding(paired, anywhere, rng):
    x = anywhere(paired, 200, rng)
    assert paired.full
    q = paired.ikm(x, level="full")
    assert np.abs(q - paired.ikm(x)).max() < 1e-13
    assert np.abs(paired.fkm(q, level="full") - x).max() < 1e-12
    assert np.abs(paired.jacobian(x, level="full") - paired.jacobian(x)).max() < 1e-11
    assert (
        np.abs(paired.extended_positions(x, level="full") - paired.extended_positions(x)).max()
        < 1e-13
    )
    assert np.abs(paired.residual_motion(x)).max() < 1e-12


def test_axis_errors_move_an_h4_from_its_ideal_model_by_the_derived_amounts(h4, table2):
    """0.11, 0.20, 0.14 mm and 0.14°: what three computations outside this project found.

    To first order, with 0.1° (1σ) of yaw and tilt on every axis: variances add, no robot is drawn.
    """
    sigma, step = np.radians(0.1), 1e-5
    variance, turned = np.zeros(4), np.zeros(4)
    for name in h4.parameters:
        if name.endswith((".yaw", ".tilt")):
            robot = h4.replace({name: step})
            off = table2 - robot.fkm(robot.ikm(table2, level="full"), table2)
            variance += np.mean((off / step * sigma) ** 2, axis=0)
            turned += np.mean((robot.residual_motion(table2) / step * sigma) ** 2, axis=0)
    rms = np.sqrt(variance)
    assert rms[:3] * 1e3 == pytest.approx([0.11, 0.20, 0.14], rel=0.1)
    assert np.degrees(rms[3]) == pytest.approx(0.14, rel=0.1)
    assert np.degrees(np.sqrt(turned)) == pytest.approx([0.17, 0.17, 0.135, 0.135], rel=0.1)


def test_a_sensor_at_a_pivot_reads_the_bars_turn_too(h4, rng):
    robot = built(h4.with_sensors("pivot2"), rng)
    assert robot.rkm(X_D) == pytest.approx([X_D[3]], abs=1e-15)
    turn = robot.residual_motion(X_D)[3]
    assert abs(turn) > 1e-5
    assert robot.rkm(X_D, level="full") == pytest.approx([X_D[3] - turn], abs=1e-14)


def test_a_telemeter_sees_the_nacelles_tilt(h4, rng):
    robot = built(h4.with_sensors("z_telemeter"), rng)
    tilt = robot.residual_motion(X_D)[:2]
    # The plane through D with normal (τ_y, -τ_x, 1), where the upright line of the base meets it.
    expected = -X_D[2] - tilt[1] * X_D[0] + tilt[0] * X_D[1]
    assert robot.rkm(X_D, level="full") == pytest.approx([expected], abs=1e-6)
    assert robot.rkm(X_D) == pytest.approx([-X_D[2]])
    assert abs(expected + X_D[2]) > 1e-5


def test_the_longer_rod_lowers_its_side_of_a_delta(delta):
    """Chain 1's rods are 80 mm apart along +y: 20 µm turn the nacelle about -x, by 20/80 mrad."""
    turn = delta.replace({"chain1.rod_difference": 2e-5}).residual_motion(delta.home)
    assert turn[0] == pytest.approx(-2.5e-4, rel=0.5) and turn[0] < 0
    assert np.allclose(
        delta.replace({"chain1.rod_difference": -2e-5}).residual_motion(delta.home),
        -turn,
        atol=2e-7,
    )


def test_without_parallelograms_the_full_level_is_the_ideal_one(stewart):
    robot = stewart
    x = robot.home
    assert robot.full and "ideal level itself" in robot.full.reason
    assert np.array_equal(robot.ikm(x, level="full"), robot.ikm(x))
    assert np.array_equal(robot.jacobian(x, level="full"), robot.jacobian(x))
    assert robot.residual_motion(x).shape == (0,)
    assert "chain1.rod_difference" not in robot.parameters


def test_one_rod_too_many_is_closed_by_what_the_rods_stretch(load, rng):
    """A Par4's four-bar nacelle: its readings and poses agree, and its model error is not zero."""
    robot = load(PAR4)
    assert robot.full
    assert robot.full.reason.startswith("8 rods, 7 freedoms: overconstrained by 1, closed by")
    real = robot.replace({f"chain{k}.tilt": 2e-3 * rng.normal() for k in range(1, 5)})
    x = robot.home + rng.uniform(-0.05, 0.05, (50, 4))
    assert real.fkm(real.ikm(x, level="full"), level="full") == pytest.approx(x, abs=1e-12)
    assert np.abs(real.fkm(real.ikm(x, level="full")) - x)[:, :3].max() > 5e-5


def test_a_rigid_nacelle_is_overconstrained_and_keeps_its_ideal_level(load):
    robot = load(PAR4.replace(", bar = 1 }", " }").replace(", bar = 2 }", " }"))
    assert not robot.full
    assert robot.full.reason == "overconstrained by 2: 8 rods, 6 freedoms"
    assert np.isfinite(robot.ikm(robot.home)).all()
    for call in (robot.ikm, robot.rkm, robot.fkm, robot.jacobian, robot.extended_positions):
        with refused(r"^par4: level='full': overconstrained by 2: [^\n]*$"):
            call(robot.home, level="full")
    with refused("overconstrained by 2"):
        robot.residual_motion(robot.home)
    with refused("overconstrained by 2"):
        robot.with_level("full")


@pytest.mark.parametrize("level", ["Full", "", 2, ["full"]])
def test_an_unknown_level_lists_the_choices(h4, level):
    for call in (h4.ikm, h4.rkm, h4.fkm, h4.jacobian, h4.extended_positions):
        with refused(r"^unknown level .*\(choices: ideal, full\)$"):
            call(X_D, level=level)


def test_what_cannot_be_reached_is_an_error_or_nan_at_the_full_level(h4):
    far = np.array([X_D, [0, 0, -2, 0]])
    with refused(r"pose \(1,\) x = .*chain 1: unreachable", tp.PoseError):
        h4.ikm(far, level="full")
    q = h4.ikm(far, errors="nan", level="full")
    assert np.isfinite(q[0]).all() and np.isnan(q[1]).all()
    assert np.isnan(h4.residual_motion(far, errors="nan")[1]).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rod_spacing = 0.08 ", "rod_spacing = 0.0", "rod_spacing = 0.0: .*greater than 0"),
        ("arm = 0.26 ", "arm = 0.26\npair_axis = [0, 0, 1]", "'pair_axis' is for prismatic chains"),
        (
            "bar = 1        #",
            "bar = 3        #",
            "theta: bar = 3, but .* 2 bars",
        ),
        ("[platform]", '[platform]\nbars = "welded"', "platform.bars = 'welded': .*four_bar"),
    ],
)
def test_a_file_that_misdescribes_rods_or_bars_is_refused(load, h4_text, old, new, message):
    assert old in h4_text
    with refused(message, tp.RobotFileError):
        load(h4_text.replace(old, new, 1))
