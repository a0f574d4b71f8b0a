"""Robot files imported from MJCF and URDF models."""

import mujoco
import numpy as np
import pytest
from test_resource_limits import limited

import truepose as tp
from truepose import robotfile
from truepose.commands.robots import remarks
from truepose.exceptions import InputError
from truepose_mujoco.importers import from_mjcf, from_urdf, robot_of

# A shank that itself moves, two axes that do not meet, two cranks, two rods: one hangs on its crank
# by two hinges about one point, the other on the foot. Sites are where the rods end; one loop is
# drawn not quite closed.
LEG = """
<mujoco model="leg">
  <compiler angle="radian"/>
  <default><geom type="sphere" size="0.01" density="1000"/></default>
  <worldbody>
    <body name="shank" pos="1 2 3" euler="0.3 -0.2 0.5">
      <freejoint/><geom/>
      <body name="cross" pos="0 0 -0.2">
        <joint name="ankle-pitch" axis="0 1 0" range="-0.7 0.5"/><geom/>
        <body name="foot" pos="0.01 0 -0.02" euler="0 0 0.1">
          <joint name="ankle-roll" axis="1 0.1 0" range="-0.3 0.3"/><geom/>
          <site name="A1" pos="-0.04 -0.03 0.01"/><site name="A2" pos="-0.04 0.03 0.01"/>
          <body name="toe" pos="0.1 0 0"><joint name="toe" axis="0 1 0"/><geom/></body>
          <body name="rod2" pos="-0.04 0.03 0.01">
            <joint name="rod2_foot" type="ball"/><geom pos="0 0 0.1" size="0.005"/>
          </body>
        </body>
      </body>
      <body name="crank1" pos="-0.03 0 0">
        <joint name="motor1" axis="1 0 0" range="-1.5 1.5" armature="0.003" ref="0.1"
          actuatorfrcrange="-20 20"/><geom/>
        <site name="B1" pos="-0.005 -0.03 0.002"/>
        <body name="fork" pos="-0.005 -0.03 0.002"><joint name="fork" axis="1 0 0"/>
          <geom size="0.001"/>
          <body name="rod1"><joint name="rod1" axis="0 1 0"/><geom pos="0 0 -0.1" size="0.005"/>
            <site name="end1" pos="0 0 -0.208"/></body></body>
      </body>
      <body name="crank2" pos="-0.03 0 -0.04">
        <joint name="motor2" axis="-1 0 0"/><geom/></body>
    </body>
  </worldbody>
  <equality>
    <connect name="loop1" site1="end1" site2="A1"/>
    <connect name="loop2" body1="rod2" body2="crank2" anchor="0.005 0 0.17"/>
  </equality>
  <actuator><motor joint="motor1"/><motor joint="motor2"/></actuator>
</mujoco>
"""


@pytest.fixture
def model(tmp_path):
    """Return a function that writes a model and the robot that is made of it."""

    def made(text, body="foot"):
        (tmp_path / "leg.xml").write_text(text)
        return tp.Robot(robot_of(from_mjcf(tmp_path / "leg.xml"), body)[0])

    return made


def rods(model, x, q):
    """Length between the rods' ends as MuJoCo has them, with the axes at x and the motors at q."""
    data = mujoco.MjData(model)
    for names, values in ((("ankle-pitch", "ankle-roll"), x), (("motor1", "motor2"), q)):
        for name, value in zip(names, values, strict=True):
            data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_kinematics(model, data)
    at = {name: data.site(name).xpos for name in ("A1", "A2", "B1")}
    crank, held = data.body("crank2"), model.eq_data[1, 3:6]  # MuJoCo's: where the loop is drawn
    at["B2"] = crank.xpos + crank.xmat.reshape(3, 3) @ held
    return np.array([np.linalg.norm(at[f"B{i}"] - at[f"A{i}"]) for i in (1, 2)])


def test_an_ankle_of_a_model_closes_as_the_model_does(model, rng):
    robot = model(LEG)
    assert [name for name, _ in robot.coordinates] == ["ankle_pitch", "ankle_roll"]
    assert np.allclose(robot.spec.passive_axis[0].limits, (-0.7, 0.5))
    assert np.allclose(robot.spec.chain[0].limits, (-1.5, 1.5))
    assert robot.spec.chain[0].torque_limit == 20
    whole = mujoco.MjModel.from_xml_string(LEG)
    drawn = rods(whole, [0, 0], [0.1, 0])
    x = rng.uniform([-0.5, -0.2], [0.4, 0.2], size=(300, 2))
    q = robot.ikm(x, errors="nan")
    there = np.isfinite(q).all(axis=1)
    assert there.mean() > 0.5
    for pose, motors in zip(x[there], q[there], strict=True):
        assert np.allclose(rods(whole, pose, motors), [c.rod for c in robot.spec.chain], atol=1e-12)
    assert 1e-4 < abs(drawn[0] - robot.spec.chain[0].rod) < 5e-3
    assert drawn[1] == pytest.approx(robot.spec.chain[1].rod, abs=1e-12)


def test_an_ankle_has_the_model_s_masses(model):
    robot = model(LEG)
    ball = 1000 * 4 / 3 * np.pi * 0.01**3
    assert robot.spec.platform.mass == pytest.approx(ball)
    assert robot.spec.chain[0].drive_inertia == pytest.approx(0.003 + 0.4 * ball * 0.01**2)
    assert robot.spec.chain[0].rod_mass == pytest.approx(ball / 8)


#: Actuators of a joint whose own range is 20 N·m, and the most that they give it.
ACTUATORS = {
    "a control of a motor": ('<motor joint="motor1" ctrlrange="-9 9" gear="-2"/>', 18),
    "a control through a gain": (
        '<general joint="motor1" ctrlrange="-3 3" gainprm="4" gear="0.5"/>',
        6,
    ),
    "a force, before the gear": ('<motor joint="motor1" forcerange="-4 4" gear="3"/>', 12),
    "the tighter of both": ('<motor joint="motor1" ctrlrange="-7 7" forcerange="-5 5"/>', 5),
    "the joint's own": ('<motor joint="motor1" ctrlrange="-50 50" forcerange="-40 40"/>', 20),
    "a servo's force, not its setpoint": (
        '<position joint="motor1" kp="1e4" ctrlrange="-1 1" forcerange="-11 11"/>',
        11,
    ),
    "a servo without any": ('<position joint="motor1" kp="1e4" ctrlrange="-1 1"/>', 20),
    "two together": (
        '<motor joint="motor1" ctrlrange="-3 3"/><pid joint="motor1" kp="1e4" forcerange="-4 4"/>',
        7,
    ),
}


@pytest.mark.parametrize("what", ACTUATORS)
def test_a_motor_s_torque_limit_is_what_mujoco_lets_it_give(what, model):
    actuators, most = ACTUATORS[what]
    leg = LEG.replace('<motor joint="motor1"/>', actuators)
    robot = model(leg)
    assert robot.spec.chain[0].torque_limit == pytest.approx(most)
    assert robot.spec.chain[1].torque_limit is None
    whole = mujoco.MjModel.from_xml_string(leg)
    data = mujoco.MjData(whole)
    data.ctrl[:-1] = 1e6  # of all but the other motor
    mujoco.mj_forward(whole, data)
    dof = whole.jnt_dofadr[whole.joint("motor1").id]
    assert abs(data.qfrc_actuator[dof]) == pytest.approx(most)


def test_a_rotor_in_an_actuator_is_felt_through_its_gear(model):
    leg = LEG.replace('<motor joint="motor2"/>', '<motor joint="motor2" gear="9" armature="1e-4"/>')
    felt = [model(text).spec.chain[1].drive_inertia or 0 for text in (leg, LEG)]
    assert felt[0] - felt[1] == pytest.approx(9**2 * 1e-4, abs=1e-6)


def test_what_truepose_exports_comes_back(tmp_path, run):
    robot = tp.load("g1-ankle")
    assert run("export", "mjcf", "g1-ankle", "-o", "ankle.xml")[0] == 0
    status, out, _ = run("import", "mjcf", "ankle.xml", "--pivot", "nacelle", "-o", "back.toml")
    assert status == 0 and "back.toml" in out
    back = tp.load(tmp_path / "back.toml")
    box = robot.spec.workspace
    x = np.random.default_rng(1).uniform(box.minimum, box.maximum, size=(200, robot.n))
    assert np.allclose(back.ikm(x), robot.ikm(x), atol=1e-9)


# What is done to the leg, and what is said of it.
WRONG = {
    "a rod's end that is a hinge": (
        ('<joint name="rod2_foot" type="ball"/>', '<joint name="rod2_foot"/>'),
        "foot: rod2_foot, a hinge, ends a rod: must be a ball, a universal joint or a connect",
    ),
    "rods that cannot spin": (
        (
            '<connect name="loop1" site1="end1" site2="A1"/>',
            "",
        ),
        "foot: 2 freedoms, 1 motors with a rod or leg: too few motors",
    ),
    "a passive axis that is driven": (
        ('<motor joint="motor2"/>', '<motor joint="motor2"/><motor joint="ankle-roll"/>'),
        "foot: ankle-roll is driven: an axis of a rotational platform is passive",
    ),
    "a crank that is not driven": (
        ('<motor joint="motor2"/>', ""),
        "foot: motor2, which moves a rod, is not driven",
    ),
    "a ball for an ankle": (
        ('<joint name="ankle-roll" axis="1 0.1 0" range="-0.3 0.3"/>', '<joint type="ball"/>'),
        "a passive axis must be a hinge of its own",
    ),
    "a loop without a rod": (
        (
            'body1="rod2" body2="crank2" anchor="0.005 0 0.17"',
            'body1="foot" body2="crank2" anchor="0 0 0"',
        ),
        "loop2 joins it to crank2, turned by motor2, without a rod between",
    ),
    "a motor that is coupled to another": (
        ("</equality>", '<joint name="gear" joint1="motor1" joint2="motor2"/></equality>'),
        "foot: motor1 is coupled by gear: motors must move independently",
    ),
    "motors on two bodies": (
        ('<body name="crank2" pos="-0.03 0 -0.04">', '</body><body name="b"><body name="crank2">'),
        "motors motor1 and motor2 stand on two bodies, shank and world: must be the same",
    ),
    "no XML": (("<mujoco", "<mujoc"), "leg.xml: not XML: "),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_a_robot_file_cannot_say_is_named(what, model):
    (old, new), said = WRONG[what]
    assert old in LEG
    with pytest.raises(InputError) as error:
        model(LEG.replace(old, new))
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_body_that_is_not_there_is_told_from_those_that_are(tmp_path, run):
    (tmp_path / "leg.xml").write_text(LEG)
    status, out, err = run("import", "mjcf", "leg.xml", "--pivot", "foo", "-o", "x.toml")
    assert (status, out) == (2, "") and not (tmp_path / "x.toml").exists()
    assert err.startswith("truepose: error: unknown body 'foo'; did you mean 'foot'?")
    for body in ("shank", "cross", "toe"):
        status, out, err = run("import", "mjcf", "leg.xml", "--pivot", body)
        assert status == 2 and err.count("\n") == 1


def test_a_motor_beyond_its_limit_wherever_it_could_stand_is_refused(tmp_path, run):
    """The crank is drawn a little off where its loop closes, which is beyond its range."""
    (tmp_path / "leg.xml").write_text(LEG.replace('range="-1.5 1.5"', 'range="-0.2 0.2"'))
    status, out, err = run("import", "mjcf", "leg.xml", "--pivot", "foot", "-o", "x.toml")
    assert (status, out) == (2, "") and not (tmp_path / "x.toml").exists()
    assert err == (
        "truepose: error: leg.xml: foot: no home at the model's pose, zero, mid-range: "
        "home = [0.0, 0.0]: beyond a joint limit, chain 1: 0.239714 of [-0.2, 0.2]\n"
    )


def test_that_home_was_moved_is_said_and_why(tmp_path, run):
    """A foot that is drawn beyond its own range."""
    said = "home is mid-range, not the model's pose: home = [0.0, 0.0]: beyond a joint limit"
    (tmp_path / "leg.xml").write_text(LEG.replace('range="-0.7 0.5"', 'range="0.1 0.5"'))
    status, out, err = run("import", "mjcf", "leg.xml", "--pivot", "foot", "-o", "x.toml")
    assert (status, err) == (0, "") and said in out
    assert tp.load(tmp_path / "x.toml").home == pytest.approx([0.3, 0])
    status, out, err = run("import", "mjcf", "leg.xml", "--pivot", "foot")
    assert status == 0 and said in err and said not in out  # standard output is the file
    (tmp_path / "leg.xml").write_text(LEG)
    assert "home is" not in run("import", "mjcf", "leg.xml", "--pivot", "foot")[2]


def test_an_imported_robot_lacks_its_tolerances_alone(tmp_path, run):
    (tmp_path / "leg.xml").write_text(LEG)
    status, out, _ = run("import", "mjcf", "leg.xml", "--pivot", "foot", "-o", "x.toml")
    assert status == 0 and "to add by hand: [tolerances]" in out
    assert "[workspace] is 85 % of the axes' ranges about home" in out
    box = tp.load(tmp_path / "x.toml").spec.workspace
    assert np.allclose((box.minimum, box.maximum), 0.85 * np.array([[-0.7, -0.3], [0.5, 0.3]]))
    assert "all of 101^2 = 10201 poses" in run("check", "x.toml")[1]
    assert run("info", "x.toml", "--samples", "50")[0] == 0
    with (tmp_path / "x.toml").open("a") as file:
        file.write('[tolerances]\n"chain*.rod" = { sigma = 0.0002 }\n')
    for command in ("accuracy", "faults", "simulate-log"):
        assert run(command, "x.toml")[0] == 0


def test_an_axis_without_a_range_works_where_the_rods_let_it(model):
    robot = model(LEG.replace('range="-0.7 0.5"', ""))
    box = np.array([robot.spec.workspace.minimum, robot.spec.workspace.maximum])
    assert np.allclose(box[0], -box[1]) and 0.1 < box[1, 0] < np.pi / 2
    x = np.random.default_rng(1).uniform(*box, size=(500, 2))
    assert np.isfinite(robot.ikm(x, errors="nan", own_mode=True)).all()


URDF = """
<robot name="neck">
  <link name="torso"/>
  <link name="head"><visual><geometry><mesh filename="no.stl"/></geometry></visual></link>
  <link name="crank"/><link name="rod_low"/><link name="rod_high"/>
  <link name="low_tip"/><link name="high_tip"/>
  <joint name="nod" type="revolute"><parent link="torso"/><child link="head"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="0.5" effort="9" velocity="1"/>
  </joint>
  <joint name="motor" type="continuous"><parent link="torso"/><child link="crank"/>
    <origin xyz="-0.05 0.01 0.1"/><axis xyz="0 1 0"/></joint>
  <joint name="foot" type="continuous"><parent link="crank"/><child link="rod_low"/>
    <origin xyz="-0.04 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="low" type="fixed"><parent link="rod_low"/><child link="low_tip"/>
    <origin xyz="0.01 0 0.11" rpy="0 0.2 0"/></joint>
  <joint name="top" type="continuous"><parent link="head"/><child link="rod_high"/>
    <origin xyz="-0.08 0.03 0.02"/><axis xyz="1 0 0"/></joint>
  <joint name="high" type="fixed"><parent link="rod_high"/><child link="high_tip"/>
    <origin xyz="0 0.02 -0.1" rpy="0.1 0 0.4"/></joint>
</robot>
"""
LOOPS = """
closed_loop: [[low_tip, high_tip]]
type: ['6d']
name_mot: [motor]
joint_name: [foot, top]
joint_type: [SPHERICAL, UJOINT_XY]
"""


@pytest.fixture
def neck(tmp_path):
    """Return a function that writes a URDF and its loops, and the robot that is made of them."""

    def made(urdf=URDF, loops=LOOPS):
        (tmp_path / "neck.urdf").write_text(urdf)
        (tmp_path / "neck.yaml").write_text(loops)
        return robot_of(from_urdf(tmp_path / "neck.urdf", tmp_path / "neck.yaml"), "head")[0]

    return made


def test_a_rod_that_a_urdf_welds_of_two_halves_is_as_long_as_both(neck):
    spec = neck()
    # The tips' frames coincide: foot to tip, tip to top, each in its own half.
    turn = _rotation(0.1, 0, 0.4) @ _rotation(0, 0.2, 0).T
    low, high = np.array([0.01, 0, 0.11]), np.array([0, 0.02, -0.1])
    assert spec.chain[0].rod == pytest.approx(np.linalg.norm(high - turn @ low), abs=1e-12)
    assert spec.chain[0].arm == pytest.approx(0.04)
    assert spec.passive_axis[0].limits == (-0.5, 0.5) and spec.passive_axis[0].name == "nod"
    robot = tp.Robot(spec)
    assert any("all of 1001^1" in line for line in remarks(robot))
    assert robot.fkm(robot.ikm([0.2])) == pytest.approx([0.2], abs=1e-12)
    again = robotfile.parse(robotfile.to_toml(spec, {}), "again")
    assert again.model_dump() == spec.model_dump()


def _rotation(roll, pitch, yaw):
    """Return a URDF's orientation."""
    c, s = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    z = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    return z @ y @ x


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("low_tip, ", "lowtip, ", "neck.yaml: unknown link 'lowtip'; did you mean 'low_tip'?"),
        ("'6d'", "'5d'", "neck.yaml: unknown type '5d'"),
        (
            "['6d']",
            "['6d', '3d']",
            "neck.yaml: 1 of closed_loop, 2 of type: the numbers must be equal",
        ),
        ("SPHERICAL", "SCREW", "neck.yaml: unknown joint_type 'SCREW'"),
        ("SPHERICAL", "UJOINT_ZX", "foot and top are both universal joints, which hold the rod's"),
        ("[motor]", "[moter]", "neck.yaml: unknown joint 'moter'; did you mean 'motor'?"),
        ("[motor]", "[[motor]]", "neck.yaml: unknown joint"),
        ("[motor]", "[nod]", "head: nod is driven: an axis of a rotational platform is passive"),
        ("closed_loop", "\t: [", "neck.yaml: not YAML: "),
        (LOOPS, "7", "neck.yaml: must have the keys closed_loop, type, name_mot"),
    ],
)
def test_loops_that_are_not_as_they_must_be_are_told(neck, old, new, said):
    with pytest.raises(InputError) as error:
        neck(loops=LOOPS.replace(old, new))
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_urdf_that_is_none_is_told(neck):
    for text, said in (
        ("<robot", "not XML"),
        ("<sdf/>", "<sdf>: the root of a URDF must be <robot>"),
    ):
        with pytest.raises(InputError, match=said):
            neck(urdf=text)


def test_a_crank_s_inertia_is_about_its_axis_wherever_its_mass_is(model):
    """A box beside the axis, and leaning: parallel axis theorem, rotated principal inertia."""
    box = '<geom type="box" size="0.01 0.02 0.03" pos="0.01 0.02 -0.015" euler="0.4 0.2 -0.3"/>'
    joint = '<joint name="motor1" axis="1 0 0"/>'
    alone = mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian"/><default><geom density="1000"/></default><worldbody>'
        f"<body>{joint}{box}</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(alone)
    mujoco.mj_forward(alone, data)
    mass = np.zeros((1, 1))
    mujoco.mj_fullM(alone, data, mass)
    crank = 'actuatorfrcrange="-20 20"/><geom/>'
    assert crank in LEG
    robot = model(LEG.replace(crank, crank.replace("<geom/>", box)))
    assert robot.spec.chain[0].drive_inertia == pytest.approx(0.003 + mass[0, 0])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_leg_of_a_model_reads_its_slide(model, sign):
    """A plate on one axis, 0.3 m above the base, and a leg that slides beside it."""
    robot = model(
        f"""<mujoco model="plate"><compiler angle="radian"/><default><geom size="0.01"/></default>
        <worldbody><body name="base"><geom/>
          <body name="plate" pos="0 0 0.3">
            <joint name="tilt" axis="0 1 0" range="-0.5 0.5"/><geom/><site name="A" pos="0.1 0 0"/>
          </body>
          <body name="lower" pos="0.1 0 0"><joint name="foot" type="ball"/><geom/>
            <body name="upper"><joint name="leg" type="slide" axis="0 0 {sign}"/><geom/>
              <site name="end" pos="0 0 0.3"/></body></body>
        </body></worldbody>
        <equality><connect site1="end" site2="A"/></equality>
        <actuator><motor joint="leg"/></actuator></mujoco>""",
        "plate",
    )
    for tilt in (-0.3, 0.0, 0.4):
        length = np.hypot(0.1 * np.cos(tilt) - 0.1, 0.3 - 0.1 * np.sin(tilt))
        assert robot.ikm([tilt])[0] == pytest.approx(sign * (length - 0.3), abs=1e-12)
    ball = 1000 * 4 / 3 * np.pi * 0.01**3  # that slides
    assert robot.spec.chain[0].drive_inertia == pytest.approx(ball)


BODY = '<body name="{name}"><joint/><geom size="1"/>{more}</body>'
MANY = '<replicate count="{count}" offset="0 0 1">{body}</replicate>'
MODEL = "<mujoco><asset>{assets}</asset><worldbody>{bodies}</worldbody></mujoco>"


def models(folder, kind):
    """Write a small model, model.xml, of very many bodies."""
    many = MANY.format(count=100_000_000, body=BODY.format(name="a", more=""))
    assets = ""
    if kind == "nested":
        many = MANY.format(count=1000, body=MANY.format(count=1000, body=many))
    elif kind == "include":
        (folder / "other.xml").write_text(f"<mujocoinclude>{many}</mujocoinclude>")
        many = '<include file="other.xml"/>'
    elif kind == "attach":
        for k in range(12):  # each file has ten of the one before
            own = "".join(
                f'<frame><attach model="m" body="a" prefix="p{i}"/></frame>' for i in range(10)
            )
            inner = MODEL.format(
                assets=f'<model name="m" file="m{k - 1}.xml"/>' * (k > 0),
                bodies=BODY.format(name="a", more=own * (k > 0)),
            )
            (folder / f"m{k}.xml").write_text(inner)
        assets, many = '<model name="m" file="m11.xml"/>', '<attach model="m" body="a" prefix="q"/>'
    (folder / "model.xml").write_text(
        MODEL.format(assets=assets, bodies=BODY.format(name="foot", more="") + many)
    )


@pytest.mark.parametrize("kind", ["replicate", "nested", "include", "attach"])
def test_a_model_of_very_many_copies_is_refused_in_one_line(tmp_path, kind):
    models(tmp_path, kind)
    status, errors = limited("import", "mjcf", "model.xml", "--pivot", "foot", cwd=tmp_path)
    assert status == 2 and errors.count("\n") == 1, errors
    assert errors.startswith("truepose: error: model.xml: ") and "more than 10000; lower" in errors


@pytest.mark.parametrize(
    "loops",
    [
        "a0: &a0 [x]\n"
        + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
        + "type: [*a11]\nclosed_loop: [[a, b]]\n",
        "a0: &a0 {x: 1}\n"
        + "".join(
            f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 10)}]}}\n" for k in range(1, 12)
        ),
        "type: [" + "x, " * 200_000 + "]\n",
    ],
    ids=["lists", "merged", "long"],
)
def test_yaml_that_unfolds_is_refused_in_one_line(tmp_path, loops):
    (tmp_path / "robot.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    (tmp_path / "loops.yaml").write_text(loops)
    words = ("import", "urdf", "robot.urdf", "loops.yaml", "--pivot", "a")
    status, errors = limited(*words, cwd=tmp_path)
    assert status == 2 and errors.count("\n") == 1, errors
    assert errors.startswith("truepose: error: loops.yaml: ")
    assert "not supported; write the value instead" in errors or "more than 262144" in errors


def test_comments_and_a_few_copies_are_read(tmp_path):
    """What MuJoCo takes for a comment, XML does not; copies that are few are copied."""
    body = MANY.format(count=3, body=BODY.format(name="a", more=""))
    text = MODEL.format(
        assets="", bodies=f"<!-- two -- or three: <replicate count='1e9'> -->{body}"
    )
    (tmp_path / "model.xml").write_text(text)
    assert len(from_mjcf(tmp_path / "model.xml").links) == 3
