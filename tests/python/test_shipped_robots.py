"""Every shipped robot against its file, over its whole workspace."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import robotfile


def length_scaled(robot, J):
    """Angles scaled by 0.1 m, so that one number says how well a Jacobian is conditioned."""
    scale = np.array([1.0 if unit == "m" else 0.1 for _, unit in robot.coordinates])
    return J * scale[:, None]


def corners_and_inside(box, count, rng):
    """Half of the poses anywhere in a box, half in its corners."""
    inside = rng.uniform(box.minimum, box.maximum, size=(count, len(box.minimum)))
    corner = np.where(rng.random(inside.shape) < 0.5, box.minimum, box.maximum)
    return np.where((np.arange(count) % 2)[:, None], corner, inside)


def test_twenty_robots_are_shipped():
    names = "h4 par4 delta linear-delta stewart jugglebot hexa hexaglide five-bar 3rpr 3rrr"
    names += " g1-ankle x1-ankle neck 4rrr 3rps 3prs exechon tricept spherical"
    assert set(tp.list_robots()) == set(names.split())


def test_a_shipped_robot_loads_by_name_and_by_path(any_robot):
    path = robotfile.shipped()[any_robot.name]
    assert tp.load(path).parameters == any_robot.parameters
    assert path.parent.name == any_robot.name


def test_a_shipped_robot_has_its_derivation_picture_and_sources(any_robot):
    folder = robotfile.shipped()[any_robot.name].parent
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "](picture.png)" in readme and "ssumed" in readme
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert any_robot.spec.source and any_robot.spec.title


def test_every_pose_of_the_workspace_is_reachable_and_regular(any_robot, rng, count):
    x = corners_and_inside(any_robot.spec.workspace, count, rng)
    assert np.isfinite(any_robot.ikm(x)).all()
    J = any_robot.jacobian(x)
    assert np.linalg.cond(length_scaled(any_robot, J)).max() < 20
    if any_robot.m == any_robot.n:
        assert len(np.unique(np.sign(np.linalg.det(J)))) == 1


def test_fkm_from_1_mm_and_1_mrad_away_finds_every_pose_of_the_workspace(any_robot, rng, count):
    x = corners_and_inside(any_robot.spec.workspace, count, rng)
    guess = x + 1e-3 * rng.choice([-1, 1], size=x.shape)
    assert np.abs(any_robot.fkm(any_robot.ikm(x), guess=guess) - x).max() < 1e-12


def test_fkm_from_home_finds_every_pose_of_the_singularity_free_box(any_robot, rng, count):
    x = corners_and_inside(any_robot.spec.fkm_region, count, rng)
    assert np.abs(any_robot.fkm(any_robot.ikm(x)) - x).max() < 1e-12


@pytest.mark.parametrize("name", ["stewart", "hexa", "hexaglide"])
def test_a_platform_tilted_by_40_degrees_about_any_axis_is_found_from_home(name, rng, count):
    robot = tp.load(name)
    x = corners_and_inside(robot.spec.workspace, count, rng)
    axis = rng.normal(size=(count, 3))
    x[:, 3:] = np.radians(40) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    assert np.abs(robot.fkm(robot.ikm(x)) - x).max() < 1e-12


def test_home_lies_in_both_boxes(any_robot):
    for box in (any_robot.spec.workspace, any_robot.spec.fkm_region):
        assert (box.minimum <= any_robot.home).all() and (any_robot.home <= box.maximum).all()


def test_parameters_are_named_as_the_interface_promises(any_robot):
    names = set(any_robot.parameters)
    for number, chain in enumerate(any_robot.spec.chain, 1):
        wanted = {"base.x", "base.y", "base.z", "anchor.x", "anchor.y", "anchor.z"}
        wanted |= {"encoder_offset", "yaw", "tilt"}
        wanted |= {"arm", "rod"} if chain.actuator == "revolute" else set()
        wanted |= {"rod"} if chain.actuator == "prismatic" else set()
        assert {f"chain{number}.{name}" for name in wanted} <= names
    assert {f"bar{k + 1}.pivot" for k in range(len(any_robot.spec.bar))} <= names
    for number in range(1, len(any_robot.spec.passive_axis) + 1):
        vectors = ("origin", "direction")
        assert {f"axis{number}.{v}.{c}" for v in vectors for c in "xyz"} <= names
    for closure in any_robot.spec.closure:
        assert {f"{closure.name}.{v}.{c}" for v in ("base", "anchor") for c in "xyz"} <= names
        assert (f"{closure.name}.length" in names) == (closure.length is not None)
    for body in any_robot.spec.body:
        assert (f"{body.name}.zero" in names) == (body.joint in ("slide", "hinge"))


def test_every_tolerance_acts(any_robot):
    """No robot file has a tolerance on what the readings do not depend on.

    How far a pair's rods are apart they tell only where these are not equally long.
    """
    x = any_robot.home + 0.01 * np.arange(1, any_robot.n + 1)
    robot = any_robot.with_sensors("all")
    unequal = [name for name in robot.parameters if name.endswith(".rod_difference")]
    robot = robot.replace(dict.fromkeys(unequal, 1e-3))
    for name, parameter in robot.parameters.items():
        if parameter.sigma:
            moved = robot.replace({name: parameter.value + 1e-4})
            level = "full" if name.endswith((".rod_difference", ".rod_spacing")) else "ideal"
            effect = moved.extended_positions(x, level=level) - robot.extended_positions(
                x, level=level
            )
            assert np.abs(effect).max() > 1e-9, name


@pytest.mark.parametrize(("name", "most"), [("h4", 12), ("stewart", 12)])
def test_as_many_sensors_as_fit_can_be_in_use(name, most):
    spec = tp.load(name).spec
    one = spec.sensor[0]
    many = tuple(one.model_copy(update={"name": f"s{k}"}) for k in range(most + 1))
    robot = tp.Robot(spec.model_copy(update={"sensor": many, "sensors": (), "tolerances": {}}))
    names = [sensor.name for sensor in many]
    assert robot.with_sensors(*names[:-1]).rkm(robot.home).shape == (most,)
    with refused(f"^{name}: at most {most} sensors can be in use$", tp.RobotFileError):
        robot.with_sensors(*names)


def test_no_sensor_is_mounted_exactly(any_robot, anywhere, rng):
    """Whatever its zero, its place or its direction do to a reading, tolerances allow for.

    Places along a beam are one with its zero: a column of H_ξ that others span needs no tolerance.
    """
    robot = any_robot.with_sensors("all")
    _, H_xi = robot.expected().linearize(anywhere(any_robot, 50, rng))
    for row, sensor in enumerate(robot.sensors, start=robot.n):
        columns = {
            name: H_xi[:, row, k]
            for k, name in enumerate(robot.parameters)
            if name.startswith(f"{sensor}.") and "gain" not in name and "eccentricity" not in name
        }
        allowed = np.array([columns[name] for name in columns if robot.parameters[name].sigma]).T
        assert allowed.size, sensor
        for name, column in columns.items():
            left = column - allowed @ np.linalg.lstsq(allowed, column, rcond=None)[0]
            assert np.abs(left).max() < 1e-6, name


def test_the_h4s_articulated_nacelle_has_its_inertia_with_the_bars_that_only_translate(h4):
    """Assumed: 0.003 kg·m² about z at θ = 0 in all, the bars as masses at their pivots."""
    bars = sum(bar.mass * bar.pivot**2 for bar in h4.spec.bar)
    assert h4.spec.platform.inertia_z + bars == pytest.approx(0.003, abs=1e-12)


def test_no_drive_is_lighter_than_the_arm_or_carriage_that_it_counts(any_robot):
    for chain in any_robot.spec.chain:
        if chain.actuator == "prismatic":
            assert chain.drive_inertia >= chain.arm_mass
        if chain.actuator == "revolute":
            assert chain.drive_inertia >= chain.arm_mass * chain.arm**2 / 3


def test_the_hexapods_legs_are_as_long_as_linuxcnc_says(stewart):
    legs = stewart.ikm(stewart.home) / 0.0254
    assert legs == pytest.approx([29.7466] * 6, abs=5e-4)


def test_the_delta_stands_where_its_tutorials_formula_says(delta):
    """At x = y = 0 the arm is bent in a vertical plane: two circles meet, by hand."""
    R, r, arm, rod, z = 0.4573 / 12**0.5, 0.115 / 12**0.5, 0.112, 0.232, -0.2
    q = delta.ikm([0, 0, z])
    elbow = np.array([R + arm * np.cos(q[0]), -arm * np.sin(q[0])])
    assert np.hypot(*(elbow - [r, z])) == pytest.approx(rod, abs=1e-12)
    assert q == pytest.approx([q[0]] * 3, abs=1e-14)
