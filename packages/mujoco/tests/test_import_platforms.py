"""Robots imported from models: six rods, deltas, planar robots, four-bars."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import least_squares

import truepose as tp
from truepose.exceptions import InputError
from truepose.robot import workspace_samples
from truepose_mujoco.importers import from_mjcf, from_urdf, robot_of

EIGHT = 'name = "eight"\nmobility = "spatial"\nhome = [0, 0, 1.2, 0, 0, 0]\n' + "".join(
    f'[[chain]]\nactuator = "telescopic"\nbase = [{x}, {y}, {z}]\nanchor = [{0.05 * x}, '
    f"{-0.05 * y if x < 0 else 0.05 * y}, {0.1 - z / 15}]\n"
    for x in (-2, 2)
    for y in (-2, 2)
    for z in (0, 3)
)


def numbers(vector, digits=15):
    return " ".join(f"{v:.{digits}f}" for v in vector)


def turned(angle, vector):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ vector


def closed(robot, count=20):
    """Return poses in the workspace; each is where its motors bring the platform."""
    x = workspace_samples(robot, count, np.random.default_rng(1))
    assert np.allclose(robot.fkm(robot.ikm(x), guess=x), x, atol=1e-9)
    return x


def closed_in_mujoco(model, motors, q):
    """Return where MuJoCo's loops have the plate with the motors at q."""
    data, start = mujoco.MjData(model), model.qpos0.copy()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    joints = [model.joint(name) for name in motors]
    for joint, value in zip(joints, q, strict=True):
        start[joint.qposadr] = value
    free = np.setdiff1d(np.arange(model.nv), [joint.dofadr[0] for joint in joints])

    def gaps(motion):
        step, data.qpos[:] = np.zeros(model.nv), start
        step[free] = motion
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        return data.efc_pos[: data.ne].copy()

    found = least_squares(gaps, np.zeros(len(free)), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(found.fun).max() < 1e-12
    return data.body("plate").xpos.copy()


@pytest.fixture
def imported(tmp_path):
    """Return a function that writes an MJCF model and returns the robot of its body."""

    def made(bodies, loops, motors, body="plate"):
        (tmp_path / "model.xml").write_text(
            '<mujoco><compiler angle="radian"/><default><geom size="0.01"/></default><worldbody>'
            f"{bodies}</worldbody><equality>{loops}</equality>"
            f"<actuator>{''.join(f'<motor joint={name!r}/>' for name in motors)}</actuator>"
            "</mujoco>"
        )
        return tp.Robot(robot_of(from_mjcf(tmp_path / "model.xml"), body)[0])

    return made


@pytest.mark.parametrize(
    "name",
    ["stewart", "hexa", "hexaglide", "delta", "linear-delta", "3rpr", "five-bar", "4rrr", "eight"],
)
def test_an_exported_robot_comes_back(name, tmp_path, run):
    (tmp_path / "eight.toml").write_text(EIGHT)
    known = "eight.toml" if name == "eight" else name
    robot = tp.load(tmp_path / known if name == "eight" else name)
    assert run("export", "mjcf", known, "-o", "model.xml")[0] == 0
    status, _, errors = run(
        "import", "mjcf", "model.xml", "--platform", "nacelle", "-o", "back.toml"
    )
    assert (status, errors) == (0, "")
    back = tp.load(tmp_path / "back.toml")
    assert back.spec.mobility == robot.spec.mobility and back.full.exists == robot.full.exists
    assert np.allclose(back.home, robot.home)
    box = back.spec if name == "eight" else robot.spec
    x = workspace_samples(tp.Robot(box), 20, np.random.default_rng(1))
    assert np.allclose(back.ikm(x), robot.ikm(x), rtol=0, atol=1e-9)
    assert run("check", "back.toml")[0] == 0


# A toe on a crank, in the plane y = 0; the rod hangs on the crank.
CRANK = """
<body name="crank" pos="0 0 0.3"><joint name="motor" axis="0 1 0" range="-1 1"/><geom/>
  <body name="rod" pos="-0.05 0 0"><joint name="knuckle" type="{}" axis="{}"/><geom/>
    <site name="end" pos="0 0 -0.3"/></body></body>
<body name="toe"><joint name="toe" axis="0 1 0" range="-0.8 0.8"/><geom pos="0 0 -0.03"/>
  <site name="heel" pos="-0.05 0 0"/></body>"""
CLOSE = '<connect site1="end" site2="heel"/>'


def test_a_hinge_parallel_to_all_axes_is_as_good_as_a_ball(imported):
    hinge = imported(CRANK.format("hinge", "0 -1 0"), CLOSE, ["motor"], "toe")
    ball = imported(CRANK.format("ball", "0 1 0"), CLOSE, ["motor"], "toe")
    x = closed(hinge)
    assert np.allclose(hinge.ikm(x), x, atol=1e-12)  # a parallelogram
    assert np.allclose(hinge.ikm(x), ball.ikm(x), rtol=0, atol=1e-12)
    with pytest.raises(InputError, match="knuckle, a hinge, ends a rod: must be a ball, a univers"):
        imported(CRANK.format("hinge", "0 1 0.1"), CLOSE, ["motor"], "toe")


def six(turn, loose=False, digits=15):
    """Six cranks in vertical planes through z, as some heads have; anchors turned about z."""
    bodies, loops = "", ""
    for k, at in enumerate(np.radians([12, 48, 132, 168, 252, 288])):
        horn, rod = turned(at, [0.06, 0, 0]), turned(at, [0.03, 0, 0])
        end = turned(at + turn * (-1) ** k, [0.04, 0, 0.12]) - horn - rod
        joint = f'<joint name="b{k}" type="ball"/>'
        if loose and k == 0:
            joint = f'<joint name="b0" axis="{numbers(turned(at, [0, 1, 0]))}"/>'
        bodies += (
            f'<body pos="{numbers(horn, digits)}"><joint name="servo{k}" range="-1 1" '
            f'axis="{numbers(turned(at, [0, 1, 0]), digits)}"/><geom/>'
            f'<body name="rod{k}" pos="{numbers(rod, digits)}">{joint}<geom/></body></body>'
        )
        loops += f'<connect body1="rod{k}" body2="plate" anchor="{numbers(end, digits)}"/>'
    plate = '<body name="plate" pos="0 0 0.12"><freejoint/><geom/></body>'
    return bodies + plate, loops, [f"servo{k}" for k in range(6)]


@pytest.mark.parametrize("digits", [5, 15])
def test_six_rods_that_meet_an_axis_leave_the_turn_about_it_free(digits, imported):
    with pytest.raises(InputError) as error:
        imported(*six(0.0, digits=digits))
    assert "plate: no home at the model's pose" in str(error.value)
    assert "the chains do not constrain the platform against turning about z" in str(error.value)
    assert "\n" not in str(error.value)
    robot = imported(*six(np.radians(20), digits=digits))  # and -20 degrees, in turn
    assert robot.spec.mobility == "spatial" and np.allclose(robot.ikm(robot.home), 0, atol=1e-6)
    closed(robot)


@pytest.mark.parametrize("kind", ["six rods", "delta", "planar"])
def test_mujoco_s_loops_bring_the_plate_where_the_robot_is(kind, imported, tmp_path):
    made, axes = {
        "six rods": (lambda: six(np.radians(20)), np.eye(3)),
        "delta": (lambda: delta(True), np.eye(3)),
        "planar": (lambda: planar(["a", "b", "c"]), [[1, 0, 0], [0, 0, -1]]),
    }[kind]
    bodies, loops, motors = made()
    robot = imported(bodies, loops, motors)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    for pose in closed(robot, 5):
        place = axes @ closed_in_mujoco(model, motors, robot.ikm(pose))
        assert np.allclose(place, pose[: len(place)], rtol=0, atol=1e-9)


def test_a_rod_on_a_hinge_among_rods_on_balls_is_refused(imported):
    with pytest.raises(InputError) as error:
        imported(*six(np.radians(20), loose=True))
    assert "plate: b0, a hinge, ends a rod: must be a ball, a universal" in str(error.value)
    assert str(error.value).endswith("or a hinge parallel to all axes, and servo1 is not")


def delta(tree, offset=0.0):
    """The shipped delta, arms and rods drawn level and upright: its loops are open."""
    shipped, bodies, loops = tp.load("delta"), "", ""
    ends = [
        (k, side, chain, np.array(chain.axis) * side * 0.03)
        for k, chain in enumerate(shipped.spec.chain)
        for side in (1, -1)
    ]
    corner = np.array(shipped.spec.chain[0].anchor) + ends[0][3] if tree else np.zeros(3)
    sites = "".join(
        f'<site name="A{k}{side}" pos="{numbers(np.array(chain.anchor) + off - corner)}"/>'
        for k, side, chain, off in ends
    )
    for k, side, chain, off in ends:
        if side == 1:
            bodies += (
                f'<body name="arm{k}" pos="{numbers(chain.base)}"><joint name="motor{k}" '
                f'axis="{numbers(chain.axis)}" range="-0.7854 1.7453"/><geom/>'
            )
        at = np.array(chain.arm_zero) * chain.arm + off * (1 + offset * (k == 1 and side == 1))
        inner = f'<site name="B{k}{side}" pos="0 0 {-chain.rod}"/>'
        if tree and not k and side == 1:
            inner = (
                f'<body name="plate" pos="0 0 {-chain.rod}"><joint type="ball"/><geom/>{sites}'
                "</body>"
            )
        else:
            loops += f'<connect site1="B{k}{side}" site2="A{k}{side}"/>'
        joint = '<joint type="ball"/>' if k else '<joint axis="0 1 0"/><joint axis="1 0 0"/>'
        bodies += f'<body name="rod{k}{side}" pos="{numbers(at)}">{joint}<geom/>{inner}</body>'
        bodies += "</body>" * (side == -1)
    if not tree:
        bodies += f'<body name="plate" pos="0 0 -0.2"><freejoint/><geom/>{sites}</body>'
    return bodies, loops, [f"motor{k}" for k in range(3)]


@pytest.mark.parametrize("tree", [False, True], ids=["free", "hung on a rod"])
def test_a_delta_is_three_chains_of_two_parallel_rods(tree, imported):
    robot, shipped = imported(*delta(tree)), tp.load("delta")
    assert robot.spec.mobility == "translation" and robot.full
    assert [chain.rod_spacing for chain in robot.spec.chain] == pytest.approx([0.06] * 3)
    x = closed(robot)
    # The plate's frame is at the first rod's end where the plate hangs on it.
    corner = np.array(robot.spec.chain[0].anchor) - shipped.spec.chain[0].anchor
    assert np.allclose(robot.ikm(x), shipped.ikm(x + corner * [1, 1, 1]), rtol=0, atol=1e-9)


def test_a_pair_of_rods_that_is_no_parallelogram_is_refused(imported):
    with pytest.raises(
        InputError, match="rod11 and rod1-1 are no parallelogram, with ends equally"
    ):
        imported(*delta(False, offset=0.1))


def planar(names, joint="hinge"):
    """Return a planar 3-RRR in the plane y = 0, at home; its plate hangs on the first rod."""
    shipped, bodies, loops = tp.load("3rrr"), "", ""
    tall = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # z of the robot is -y of the model

    def at(vector):
        return numbers(tall @ vector)

    q, chains = shipped.ikm(shipped.home), shipped.spec.chain
    sites = "".join(
        f'<site name="A{k}" pos="{at(np.subtract(chain.anchor, chains[0].anchor))}"/>'
        for k, chain in enumerate(chains)
    )
    for k, chain in enumerate(chains):
        B = chain.arm * turned(q[k], np.array(chain.arm_zero))
        A = np.array([*shipped.home[:2], 0]) + chain.anchor - chain.base - B
        inner = f'<site name="B{k}" pos="{at(A)}"/>'
        if k == 0:
            inner = f'<body name="plate" pos="{at(A)}"><joint axis="0 -1 0"/><geom/>{sites}</body>'
        else:
            loops += f'<connect site1="B{k}" site2="A{k}"/>'
        bodies += (
            f'<body pos="{at(chain.base)}"><joint name="{names[k]}" axis="0 -1 0"/><geom/>'
            f'<body name="rod{k}" pos="{at(B)}"><joint name="elbow{k}" type="{joint}" '
            f'axis="0 1 0"/><geom/>{inner}</body></body>'
        )
    return bodies, loops, names


def test_a_planar_robot_on_hinges_has_the_plane_of_its_hinges(imported):
    robot, shipped = imported(*planar(["a", "b", "c"])), tp.load("3rrr")
    assert robot.spec.mobility == "planar"
    assert np.abs(robot.spec.gravity) == pytest.approx([0, 9.81, 0])  # in its plane
    assert np.isfinite(robot.ikm(closed(robot), own_mode=True)).all()

    def sizes(robot):
        points = np.array([(chain.base, chain.anchor) for chain in robot.spec.chain])
        between = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=2)
        return [(c.arm, c.rod, *of) for c, of in zip(robot.spec.chain, between, strict=True)]

    assert np.allclose(sizes(robot), sizes(shipped))


def test_balls_do_not_hold_a_plate_in_a_plane(imported):
    with pytest.raises(InputError, match="a hinge parallel to all axes, and elbow1 is not"):
        imported(*planar(["a", "b", "c"], "ball"))


def test_a_free_body_needs_as_many_motors_as_it_has_freedoms(imported):
    bodies, loops, _ = six(np.radians(20))
    few = loops.rpartition("<connect")[0]
    with pytest.raises(InputError, match="plate: 6 freedoms, 5 motors with a rod or leg: too few"):
        imported(bodies, few, [f"servo{k}" for k in range(5)])


def more_rods(count):
    """Return the six rods, with more on the first crank."""
    bodies, loops, motors = six(np.radians(20))
    for k in range(count):
        rod = f'<body name="more{k}" pos="0.03 0 0.01"><joint type="ball"/><geom/></body>'
        bodies = bodies.replace('<body name="rod0"', f'{rod}<body name="rod0"')
        loops += f'<connect body1="more{k}" body2="plate" anchor="0 0.01 0.1"/>'
    return bodies, loops, motors


SLANTED = """
<body name="toe" pos="0 0 0.3"><joint axis="0 1 0"/><geom/><site name="heel" pos="0.1 0 0"/></body>
<body pos="0.1 0 0"><joint type="ball"/><geom/>
  <body><joint name="motor" type="slide" axis="0.1 0 1"/>
  <geom/><site name="end" pos="0 0 0.3"/></body></body>"""


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (more_rods(1), "moves two rods: only a delta"),
        (more_rods(2), "moves 3 rods: too many"),
        (
            (
                '<body name="sled"><joint type="slide"/>'
                + CRANK.format("ball", "0 1 0").replace(
                    '<body name="toe">', '</body><body name="toe">'
                ),
                CLOSE,
                ["motor"],
            ),
            "toe: its motors stand on sled, which does not carry it",
        ),
        (
            (
                CRANK.format("ball", "0 1 0").replace(
                    '<joint name="toe" axis="0 1 0" range="-0.8 0.8"/>',
                    '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>',
                ),
                CLOSE,
                ["motor"],
            ),
            "toe: motor moves out of the plane of its slides",
        ),
        ((SLANTED, CLOSE, ["motor"]), "toe: motor does not slide along its leg, between its two e"),
    ],
    ids=["two rods", "three rods", "another base", "out of its plane", "aside of a leg"],
)
def test_motors_and_rods_that_do_not_fit_are_named(model, said, imported):
    with pytest.raises(InputError, match=said) as error:
        imported(*model, "plate" if "plate" in model[0] else "toe")
    assert "\n" not in str(error.value)


@pytest.fixture
def hexapod(tmp_path):
    """Return the stewart's URDF: its plate hangs on leg 6, the others stand upright and open."""
    shipped, links, joints, loops = tp.load("stewart"), ["base", "plate", "ankle"], [], []

    def joint(name, kind, parent, child, at, rpy=(0, 0, 0)):
        limit = '<limit lower="-0.2" upper="0.4" effort="500" velocity="1"/>' * (kind[0] == "p")
        joints.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(at)}" rpy="{numbers(rpy)}"/><axis xyz="0 0 1"/>{limit}</joint>'
        )

    for k, chain in enumerate(shipped.spec.chain, 1):
        leg = np.array([0, 0, 0.508]) + chain.anchor - chain.base
        last = k == len(shipped.spec.chain)
        pitch, yaw = np.arctan2(np.hypot(*leg[:2]), leg[2]), np.arctan2(leg[1], leg[0])
        links += [f"lower{k}", f"upper{k}"]
        joint(
            f"hip{k}", "continuous", "base", f"lower{k}", chain.base, (0, pitch * last, yaw * last)
        )
        joint(f"slide{k}", "prismatic", f"lower{k}", f"upper{k}", (0, 0, 0.3))
        if last:
            end = (0, 0, np.linalg.norm(leg) - 0.3)
            joint("unturn", "fixed", f"upper{k}", "level", end, (0, -pitch, 0))
            joint("foot6", "continuous", "level", "ankle", (0, 0, 0), (0, 0, -yaw))
            joint("under", "fixed", "ankle", "plate", -np.array(chain.anchor))
            links.append("level")
            continue
        links += [f"tip{k}", f"eye{k}"]
        joint(f"top{k}", "fixed", f"upper{k}", f"tip{k}", (0, 0, 0.4))
        joint(f"on{k}", "fixed", "plate", f"eye{k}", chain.anchor)
        loops.append([f"top{k}", f"eye{k}"] if k % 2 else [f"tip{k}", f"on{k}"])
    (tmp_path / "six.urdf").write_text(
        f"<robot name='six'>{''.join(f'<link name={n!r}/>' for n in links)}{''.join(joints)}"
        "</robot>"
    )
    slides, hips = ([f"{part}{k}" for k in range(1, 7)] for part in ("slide", "hip"))
    (tmp_path / "six.yaml").write_text(
        f"closed_loop: {loops}\ntype: {['3d'] * 5}\nname_mot: {slides}\n"
        f"joint_name: {[*hips, 'foot6']}\njoint_type: {['UJOINT_XY'] * 6 + ['SPHERICAL']}\n"
    )
    return tmp_path / "six.urdf", tmp_path / "six.yaml"


def test_a_plate_that_hangs_on_one_of_its_legs_is_a_free_body(hexapod):
    """Loops of a URDF name links, or joints for the frames of their children."""
    spec, _ = robot_of(from_urdf(*hexapod), "plate")
    robot, shipped = tp.Robot(spec), tp.load("stewart")
    assert spec.mobility == "spatial" and np.allclose(robot.home, shipped.home, atol=1e-9)
    assert spec.chain[0].limits == pytest.approx((0.5, 1.1))  # of its length
    assert spec.chain[0].torque_limit == 500
    x = closed(robot)
    start = [0.7] * 5 + [robot.spec.chain[5].encoder_offset]  # lengths at zero
    assert np.allclose(robot.ikm(x) + start, shipped.ikm(x), rtol=0, atol=1e-9)
