"""Geometric parameters and their effect."""

import numpy as np
import pytest
from fixtures import refused

X_D = np.array([0.03, -0.02, -0.42, 0.15])


def test_the_h4_has_the_parameters_its_interface_promises(h4):
    promised = ["base.x", "base.y", "base.z", "arm", "rod", "encoder_offset", "yaw", "tilt"]
    promised += ["anchor.x", "anchor.y", "anchor.z", "rod_difference", "rod_spacing", "gain"]
    harmonics = [f"eccentricity.{harmonic}" for harmonic in ("c1", "s1", "c2", "s2")]
    promised += harmonics
    names = {f"chain{i}.{name}" for i in range(1, 5) for name in promised}
    names |= {"bar1.pivot", "bar2.pivot"}
    mounted = {"z_telemeter": ("origin", "direction", "target", "normal")}
    mounted |= {f"wire{i}": ("origin", "target") for i in (1, 2, 3)}
    for sensor in ("theta", "elbow1", "elbow2", "elbow3", "elbow4", "pivot1", "pivot2", *mounted):
        names |= {f"{sensor}.offset", f"{sensor}.gain"}
        if sensor.startswith(("theta", "elbow", "pivot")):
            names |= {f"{sensor}.{harmonic}" for harmonic in harmonics}
        vectors = mounted.get(sensor, ())
        names |= {f"{sensor}.{vector}.{axis}" for vector in vectors for axis in "xyz"}
    assert set(h4.parameters) == names


def test_an_interval_is_known_by_its_mean_and_its_standard_deviation(h4):
    rod = h4.parameters["chain2.rod"]
    assert rod.value == 0.48
    assert rod.mean == pytest.approx(0.48 + 0.0035)  # [-3, 10] mm
    assert rod.sigma == pytest.approx(0.013 / np.sqrt(12))


@pytest.mark.parametrize(
    ("name", "sigma"),
    [("chain1.yaw", np.radians(0.1)), ("chain3.base.z", 3e-4), ("theta.gain", 0.0)],
)
def test_a_sigma_leaves_the_mean_at_the_drawn_value(h4, name, sigma):
    parameter = h4.parameters[name]
    assert parameter.mean == parameter.value
    assert parameter.sigma == pytest.approx(sigma, rel=1e-5)


def test_what_is_known_beforehand_does_not_move_with_the_value(h4):
    moved = h4.replace({"chain1.rod": 0.49}).parameters["chain1.rod"]
    assert moved == h4.parameters["chain1.rod"]._replace(value=0.49)


def test_replace_returns_a_copy(h4):
    before = h4.ikm(X_D)
    longer = h4.replace({"chain1.rod": 0.483}).replace({"chain2.arm": 0.261})
    assert longer.parameters["chain1.rod"].value == 0.483
    assert longer.parameters["chain2.arm"].value == 0.261
    assert h4.parameters["chain1.rod"].value == 0.48
    assert np.array_equal(h4.ikm(X_D), before) and (longer.ikm(X_D) != before)[:2].all()


def test_sensors_are_chosen_by_name_and_read_in_that_order(h4):
    both = h4.with_sensors("z_telemeter", "theta")
    assert (h4.sensors, h4.r) == (("theta",), 1)
    assert (both.sensors, both.r) == (("z_telemeter", "theta"), 2)
    assert both.rkm(X_D) == pytest.approx([-X_D[2], X_D[3]])
    assert h4.with_sensors().rkm(X_D).shape == (0,)


def test_a_copy_with_other_sensors_keeps_its_parameters(h4):
    copy = h4.replace({"chain1.rod": 0.483}).with_sensors("z_telemeter").without_quantization()
    assert copy.with_gravity((0, 0, 0)).parameters["chain1.rod"].value == 0.483


def test_what_a_robot_hands_out_cannot_change_it(h4):
    h4.home[:] = 1
    h4.parameters.clear()
    assert h4.home.tolist() == [0, 0, -0.4, 0] and len(h4.parameters) > 40
    with pytest.raises(AttributeError):
        h4.n = 5
    with pytest.raises(AttributeError, match="with_file"):
        h4.spec.name = "h5"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"chain1.rd": 0.5}, "^unknown parameter 'chain1.rd'; did you mean 'chain1.rod'"),
        ({"chain1.rod": -0.5}, r"^chain1.rod = -0.5: must be greater than 0 \(m\)$"),
        ({"bar1.pivot": 0}, "^bar1.pivot = 0: must be greater than 0"),
        ({"chain2.rod_spacing": 0}, "^chain2.rod_spacing = 0: must be greater than 0"),
        ({"chain1.eccentricity.c1": 0.2}, r"^chain1.eccentricity.c1 = 0.2: must be between -0.1 "),
        ({"theta.gain": 0.0}, "^theta.gain = 0.0: must not be 0: the reading would be"),
        ({"chain1.yaw": float("nan")}, "^chain1.yaw = nan: must be a finite number$"),
    ],
)
def test_replace_says_what_is_wrong(h4, change, message):
    with refused(message):
        h4.replace(change)


def test_a_reading_is_the_motors_angle_less_its_offset(h4):
    offset = h4.replace({"chain3.encoder_offset": 0.01})
    assert h4.ikm(X_D) - offset.ikm(X_D) == pytest.approx([0, 0, 0.01, 0], abs=1e-15)


@pytest.mark.parametrize(
    ("name", "value", "reading"),
    [
        ("theta.offset", 0.01, X_D[3] - 0.01),
        ("theta.gain", 1.02, X_D[3] * 1.02),
        ("z_telemeter.offset", 0.001, -X_D[2] - 0.001),
        ("z_telemeter.gain", 0.99, -X_D[2] * 0.99),
    ],
)
def test_a_sensor_reads_gain_times_value_less_offset(h4, name, value, reading):
    robot = h4.with_sensors(name.split(".")[0]).replace({name: value})
    assert robot.rkm(X_D) == pytest.approx([reading], abs=1e-15)


def turned(vector, axis, angle):
    """Right-hand rule, by Rodrigues' formula."""
    along = np.dot(axis, vector) * axis
    return along + np.cos(angle) * (vector - along) + np.sin(angle) * np.cross(axis, vector)


@pytest.mark.parametrize("chain", [1, 2, 3, 4])
@pytest.mark.parametrize(("yaw", "tilt"), [(0.02, 0.0), (0.0, 0.03), (-0.05, 0.04)])
def test_yaw_adds_to_alpha_and_tilt_turns_u_about_e(h4, chain, yaw, tilt):
    """The arm, drawn by hand with its turned axes, still ends one rod away from A."""
    robot = h4.replace({f"chain{chain}.yaw": yaw, f"chain{chain}.tilt": tilt})
    spec, z = h4.spec.chain[chain - 1], np.array([0, 0, 1.0])
    alpha = np.arctan2(spec.arm_zero[1], spec.arm_zero[0]) + yaw
    e = np.array([np.cos(alpha), np.sin(alpha), 0])
    u = turned(turned(np.array(spec.axis), z, yaw), e, tilt)
    q = robot.ikm(X_D)[chain - 1]
    B = np.array(spec.base) + 0.26 * (np.cos(q) * e + np.sin(q) * np.cross(u, e))
    c, s = 0.06 * np.cos(X_D[3]), 0.06 * np.sin(X_D[3])
    side = 1 if chain in (1, 4) else -1
    A = X_D[:3] + side * np.array([c, s, 0]) + spec.anchor
    assert np.linalg.norm(B - A) == pytest.approx(0.48, abs=1e-14)
    assert abs(q - h4.ikm(X_D)[chain - 1]) > 1e-5


def test_each_parameter_moves_some_reading_by_its_first_order_effect(h4):
    """No parameter is dead, and a small one acts in proportion; two act at the full level.

    One of them, the spacing of a pair's rods, where the rods are not equally long.
    But for the z telemeter's: moved within its plane, its line tilted, its directions lengthened,
    it reads the same.
    """
    robot = h4.with_sensors("all")
    robot = robot.replace({f"chain{i}.rod_difference": 1e-3 for i in range(1, 5)})
    gauges = {f"z_telemeter.{name}" for name in ("direction.x", "direction.y")}
    gauges |= {f"z_telemeter.{name}.z" for name in ("direction", "normal")}
    gauges |= {f"z_telemeter.{end}.{axis}" for end in ("origin", "target") for axis in "xy"}
    for name, parameter in robot.parameters.items():
        if name in gauges:
            continue
        level = "full" if name.endswith(("rod_difference", "rod_spacing")) else "ideal"
        effects = [
            robot.replace({name: parameter.value + step}).extended_positions(X_D, level=level)
            - robot.extended_positions(X_D, level=level)
            for step in (1e-5, 2e-5)
        ]
        largest = np.abs(effects[0]).max()
        assert largest > 1e-8, name
        assert np.abs(effects[1] - 2 * effects[0]).max() < 1e-3 * largest, name
