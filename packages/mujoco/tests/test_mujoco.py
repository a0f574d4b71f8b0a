"""An independent robot in MuJoCo against truepose's models."""

import dataclasses
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from fixtures import CHAINED

import truepose as tp
from truepose import _core
from truepose.calibration import CalibrationOptions
from truepose.simulation.plants.exact import ExactPlant
from truepose_mujoco import plant, viewing
from truepose_mujoco.body import Body
from truepose_mujoco.mechanism import Mechanism
from truepose_mujoco.plant import MujocoPlant

FREE = {
    "planar_translation": [0, 1],
    "planar": [0, 1, 5],
    "translation": [0, 1, 2],
    "schoenflies": [0, 1, 2, 5],
    "spatial": [0, 1, 2, 3, 4, 5],
}


@pytest.fixture(scope="module")
def settings(request) -> int:
    """How many motor settings each robot is put to (--count 200: the full check)."""
    return min(request.config.getoption("--count") or 6, 200)


def imperfect(robot, rng, turned):
    """Errors of arms and rods, of every part of a pivot; axes turned where every rod can follow."""
    sampled = robot.sample(int(rng.integers(2**32)))
    lengths = {k: p.value for k, p in sampled.parameters.items() if k.endswith((".rod", ".arm"))}
    robot = sampled if robot.spec.passive_axis else robot.replace(lengths)
    sigma = {".yaw": np.radians(0.1), ".tilt": np.radians(0.1), ".rod_difference": 2e-5}
    turns = {
        name: rng.normal(0, s)
        for name in robot.parameters
        for end, s in sigma.items()
        if turned and name.endswith(end)
    }
    return robot.replace(turns)


def stretched(robot):
    """Whether its rods are one too many: MuJoCo's soft loops share the stretch their own way."""
    return "stretch" in robot.full.reason


def somewhere(robot, rng):
    box = robot.spec.fkm_region
    return rng.uniform(box.minimum, box.maximum)


class Moving:
    """A robot in MuJoCo in a state of motion that its loops allow."""

    def __init__(self, robot, x, rate, torque=None, body=None):
        self.robot = robot
        self.body = Body(robot) if body is None else body
        m, d = self.model, self.data = self.body.model, self.body.data
        self.body.stand(self.body.mechanism.posture(x))
        names = ["nacelle.x", "nacelle.y", "nacelle.theta"]
        joints = {m.joint(j).name: m.joint(j).dofadr[0] for j in range(m.njnt)}
        planar = self.body.mechanism.planar
        start = joints.get("nacelle")
        self.dof = (
            [joints[k] for k in names if k in joints]
            if planar
            else [(start or 0) + k for k in range(6)]
        )
        if robot.spec.passive_axis:
            self.dof = [joints[f"axis{j + 1}"] for j in range(robot.n)]
        own = planar or robot.spec.passive_axis
        self.columns = list(range(robot.n)) if own else FREE[robot.spec.mobility]
        mujoco.mj_forward(m, d)
        J, _ = self.closure()
        rest = np.setdiff1d(np.arange(m.nv), self.dof)
        d.qvel[self.dof] = self.to_mujoco(rate)
        d.qvel[rest] = np.linalg.lstsq(J[:, rest], -J[:, self.dof] @ d.qvel[self.dof])[0]
        if torque is not None:
            d.ctrl[:] = torque
        mujoco.mj_forward(m, d)

    def turned(self):
        """Base frame from MuJoCo's: a free body's turns are counted in its own frame."""
        T = np.eye(len(self.dof))
        if len(self.dof) == 6:
            T[3:, 3:] = self.body.frame()[:3, :3]
        return T

    def to_mujoco(self, rate):
        twist = np.zeros(len(self.dof))
        twist[self.columns] = rate
        return self.turned().T @ twist

    def of_nacelle(self, values):
        return (self.turned() @ values[self.dof])[self.columns]

    def closure(self):
        """J and its rate: the loops' ends part by J v."""
        m, d, parts = self.model, self.data, []
        for i in range(self.robot.m):
            for rod, _ in self.body.mechanism.rods(i):
                ends = []
                for site in (m.site(f"{rod}.end").id, m.site(f"{rod}.anchor").id):
                    J, rate = np.zeros((2, 3, m.nv))
                    mujoco.mj_jacSite(m, d, J, None, site)
                    at = d.site_xpos[site]
                    mujoco.mj_jacDot(m, d, rate, None, at, int(m.site_bodyid[site]))
                    ends.append(np.array([J, rate]))
                parts.append(ends[0] - ends[1])
        return np.concatenate(parts, axis=1)

    def rigid_acceleration(self):
        """What MuJoCo's masses, forces and loops give if the loops are rigid (Lagrange)."""
        m, d = self.model, self.data
        J, rate = self.closure()
        M = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, M)
        system = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
        force = d.qfrc_actuator + d.qfrc_passive - d.qfrc_bias
        known = np.concatenate([force, -rate @ d.qvel])
        return self.of_nacelle(np.linalg.lstsq(system, known, rcond=1e-14)[0][: m.nv])


def reduced(robot, x, rate, torque):
    return robot.acceleration(x, rate, torque)


def some_torque(robot, rng):
    limits = np.array([chain.torque_limit for chain in robot.spec.chain])
    return rng.uniform(-0.2, 0.2, robot.m) * limits


def holding_torque(robot, x):
    """Torques under which the reduced model stands still."""
    still = np.zeros(robot.n)
    weight = reduced(robot, x, still, np.zeros(robot.m))
    pushed = [reduced(robot, x, still, unit) - weight for unit in np.eye(robot.m)]
    return np.linalg.lstsq(np.transpose(pushed), -weight)[0]


@pytest.mark.parametrize("name", CHAINED)
def test_every_robot_stands_closed_at_home(name, rng):
    truth = imperfect(tp.load(name), rng, turned=bool(tp.load(name).full))
    body = Body(truth)
    assert body.gap() < (1e-3 if stretched(truth) else 1e-12)
    assert body.coordinates() == pytest.approx(truth.home, abs=1e-12)
    assert body.model.nu == truth.m


def test_an_upright_leg_stands_closed_at_home():
    """Its direction is the chain's axis, so these two span no plane."""
    robot = tp.load("stewart")
    end = robot.home[:2] + np.array(robot.spec.chain[0].anchor[:2])
    truth = robot.replace(dict(zip(("chain1.base.x", "chain1.base.y"), end, strict=True)))
    body = Body(truth)
    assert body.gap() < 1e-12
    assert body.coordinates() == pytest.approx(truth.home, abs=1e-12)


def test_both_rods_of_a_pair_are_there(h4):
    truth = h4.replace({"chain2.rod_difference": 1e-3})
    ends = [Body(truth).model.site(f"rod2{side}.end").pos[0] for side in "+-"]
    assert ends == pytest.approx([0.4805, 0.4795], abs=1e-12)


@pytest.mark.parametrize("name", CHAINED)
def test_statics_agree_with_every_rod_by_itself(name, rng, settings):
    """Motors held anywhere: 1 µm and 1e-5 rad, with errors of geometry, axes and rods.

    Where the rods are one too many, 10 µm and 1e-4 rad, of some 0.3 mm that they stretch. Motors
    beyond the freedoms are held where all loops close.
    """
    robot = tp.load(name)
    truth = imperfect(robot, rng, turned=bool(robot.full))
    level = "full" if truth.full else "ideal"
    plant, mechanism = MujocoPlant(truth), Mechanism(truth)
    for _ in range(settings):
        q = (truth if robot.m > robot.n else robot).ikm(somewhere(robot, rng))
        settled = plant.settle_at(q)
        expected = mechanism.posture(truth.fkm(q, guess=settled.x, level=level))
        off = 10 if stretched(truth) else 1
        assert np.abs(settled.frame[:3, 3] - expected.D).max() < off * 1e-6
        assert np.abs(settled.frame[:3, :3] - expected.R).max() < off * 1e-5


@pytest.mark.parametrize("name", ["g1-ankle", "x1-ankle", "neck"])
def test_a_pivot_without_weight_settles_where_the_forward_model_says(name, rng):
    """Under their weight MuJoCo's soft loops deflect by some 1e-9 m."""
    robot = tp.Robot(tp.load(name).spec.model_copy(update={"gravity": (0.0, 0.0, 0.0)}))
    plant = MujocoPlant(robot)
    for _ in range(10):
        q = robot.ikm(somewhere(robot, rng))
        assert plant.settle_at(q).x == pytest.approx(robot.fkm(q), abs=1e-12)


def test_motors_where_no_pose_closes_the_loops():
    """Elbows 0.6 m apart, two rods of 0.25 m between them."""
    with pytest.raises(tp.PoseError, match=r"five-bar: motors at q = .*: the loops cannot close"):
        MujocoPlant(tp.load("five-bar")).settle_at([3.1, 0.04])


@pytest.mark.parametrize("name", CHAINED)
def test_accelerations_are_the_reduced_models(name, rng):
    """Slender rods, arms, bars, legs: to rounding against MuJoCo's own rigid equations."""
    truth = imperfect(tp.load(name), rng, turned=False)
    body = Body(truth)
    for _ in range(20):
        x, rate = somewhere(truth, rng), rng.normal(0, 0.3, truth.n)
        torque = some_torque(truth, rng)
        moving = Moving(truth, x, rate, torque, body)
        if name == "par4":  # its four-bar is one more loop
            continue
        expected = reduced(truth, x, rate, torque)
        error = np.abs(moving.rigid_acceleration() - expected).max()
        assert error < 1e-8 * np.abs(expected).max()


@pytest.mark.parametrize("name", CHAINED)
def test_motion_under_torques_is_the_reduced_models(name, rng, settings):
    """What MuJoCo's solver makes of soft loops, once they have taken up the load: 0.5 %."""
    truth = imperfect(tp.load(name), rng, turned=False)
    body = Body(truth)
    body.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for _ in range(settings):
        torque = some_torque(truth, rng)
        moving = Moving(truth, somewhere(truth, rng), rng.normal(0, 0.1, truth.n), torque, body)
        mujoco.mj_step(body.model, body.data, 20)
        mujoco.mj_forward(body.model, body.data)
        x, rate = body.coordinates(), moving.of_nacelle(body.data.qvel)
        expected = reduced(truth, x, rate, torque)
        error = np.abs(moving.of_nacelle(body.data.qacc) - expected).max()
        assert error < 5e-3 * np.abs(expected).max()


@pytest.mark.parametrize("name", CHAINED)
def test_one_second_of_free_motion_is_the_reduced_models(name, rng):
    """From home at 0.03 m/s or rad/s and more, under the torques that would hold it there."""
    truth = imperfect(tp.load(name), rng, turned=False)
    x, rate = truth.home, rng.normal(0, 0.03, truth.n)
    torque = holding_torque(truth, x)
    (end,), _, status, _ = _core.advance(truth.core, x, rate, torque, 1.0, 1000)
    assert status == 0
    body = Body(truth)
    body.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    Moving(truth, x, rate, torque, body)
    mujoco.mj_step(body.model, body.data, round(1 / body.model.opt.timestep))
    (half,), *_ = _core.advance(truth.core, x, rate, torque, 0.5, 500)
    assert np.abs(np.array([end, half])[:, : truth.n] - x).max() > 2e-3
    assert body.coordinates() == pytest.approx(np.array(end)[: truth.n], abs=10e-6)


@pytest.mark.parametrize("law", ["joint", "tej"])
def test_under_control_it_rests_where_the_statics_say(h4, truth, table2, law):
    poses = table2[[3, 300, 620]]
    found = MujocoPlant(truth).visit(h4, poses, tp.Controller(law=law))
    assert found.status.tolist() == ["ok"] * 3
    assert found.x == pytest.approx(tp.steady_state(h4, truth, poses, law, gravity=True), abs=5e-6)
    assert found.frame[:, :3, 3] == pytest.approx(found.x[:, :3], abs=1e-12)
    assert found.q_e == pytest.approx(truth.extended_positions(found.x), abs=2e-5)


def test_an_encoder_says_counts(h4, truth, table2):
    plant = MujocoPlant(truth, tp.Effects().only("quantization"))
    q_e = plant.visit(h4, table2[:2], tp.Controller(law="joint")).q_e
    counts = q_e / h4.resolution
    assert counts == pytest.approx(np.round(counts), abs=1e-6)


def test_eccentric_encoders_read_as_the_robot_says(h4):
    effects = tp.Effects().only("eccentricity")
    found = MujocoPlant(h4, effects).visit(h4, [[0.02, 0, -0.4, 0.1]], tp.Controller(law="joint"))
    eccentric = effects.geometry(h4, 0)
    assert found.q_e == pytest.approx(eccentric.extended_positions(found.x), abs=1e-7)
    assert np.abs(found.q_e - h4.extended_positions(found.x)).max() > 1e-5


def test_arms_yield_at_their_roots_under_what_they_carry(h4, truth, rng):
    """Arms hang lower than their motors, by the torque over the stiffness."""
    effects = dataclasses.replace(tp.Effects.none(), arm_stiffness=2e4)
    q = h4.ikm(somewhere(h4, rng))
    settled = MujocoPlant(truth, effects).settle_at(q)
    sag = holding_torque(truth, settled.x) / effects.arm_stiffness
    expected = truth.fkm(q - sag, level="full")
    assert np.abs(expected - truth.fkm(q)).max() > 2e-5
    assert settled.x == pytest.approx(expected, abs=2e-7)


def test_legs_yield_along_themselves(stewart, rng):
    """By what they carry of the platform and of their own halves, over the stiffness."""
    effects = dataclasses.replace(tp.Effects.none(), rod_stiffness=5e6)
    x = somewhere(stewart, rng)
    q = stewart.ikm(x)
    settled = MujocoPlant(stewart, effects).settle_at(q)
    expected = stewart.fkm(q - holding_torque(stewart, x) / effects.rod_stiffness)
    assert np.abs(expected - x).max() > 5e-6
    assert settled.x == pytest.approx(expected, abs=2e-7)


def test_rods_yield_one_by_one(truth, rng):
    """The nacelle stands where rods as long as each has become put it; springs carry its weight."""
    effects = dataclasses.replace(tp.Effects.none(), rod_stiffness=5e6)
    q = truth.ikm(somewhere(truth, rng))
    body = MujocoPlant(truth, effects).body()
    settled = body.settle_at(q)
    stretch = {
        rod: body.data.qpos[body.model.joint(f"{rod}.stretch").qposadr[0]]
        for i in range(4)
        for rod, _ in body.mechanism.rods(i)
    }
    longer = {}
    for i in range(1, 5):
        plus, minus = (stretch[f"rod{i}{side}"] for side in "+-")
        longer[f"chain{i}.rod"] = truth.parameters[f"chain{i}.rod"].value + (plus + minus) / 2
        longer[f"chain{i}.rod_difference"] = plus - minus
    assert settled.x == pytest.approx(truth.replace(longer).fkm(q, level="full"), abs=5e-7)
    carried = sum(
        -5e6 * value * body.data.body(rod).xmat[6] for rod, value in stretch.items()
    )  # each rod's end leads down its x axis
    weight = 9.81 * (0.6 + 2 * 0.2 + 4 * 0.1)
    assert carried == pytest.approx(weight, rel=0.1)


def test_play_hides_between_the_encoder_and_the_nacelle(h4):
    """It is left on the side that it came from."""
    effects = tp.Effects().only("backlash")
    turned = [[0, 0, -0.4, angle] for angle in (0.3, 0, -0.3, 0)]
    found = MujocoPlant(h4, effects).visit(h4, turned, tp.Controller(law="joint", frequency=60))
    hidden = found.q_e[:, 4] - np.arctan2(found.frame[:, 1, 0], found.frame[:, 0, 0])
    half = effects.tool_backlash / 2
    assert np.abs(hidden) == pytest.approx([half] * 4, rel=0.2)
    assert np.sign(hidden).tolist() == [-1, 1, 1, -1]


def test_friction_stops_short_of_what_the_controller_asks_for(h4, table2):
    free, rubbing = (
        MujocoPlant(h4, effects).visit(h4, table2[[3, 300]], tp.Controller(law="joint"))
        for effects in (tp.Effects.none(), tp.Effects().only("friction"))
    )
    q_d = h4.ikm(table2[[3, 300]])
    kp = np.array(tp.Controller(law="joint", gains="diagonal").settings(h4, h4.home).kp)[:4]
    held = np.abs(kp * (rubbing.q_e - free.q_e)[:, :4])  # N·m against friction
    most = tp.Effects().motor_friction + 16 * 4 * tp.Effects().joint_friction
    assert (held > 1e-3).any() and (held < most).all()
    assert np.abs(free.q_e[:, :4] - q_d).max() < np.abs(rubbing.q_e[:, :4] - q_d).max()


def test_a_warm_robot_is_another_one_by_the_hour(h4):
    effects = tp.Effects().only("thermal")
    plant = MujocoPlant(h4, effects, pose_time=3600)
    x_d = [[0, 0, -0.4, 0]] * 3
    found = plant.visit(h4, x_d, tp.Controller(law="joint", frequency=60))
    warm = [tp.steady_state(h4, effects.geometry(h4, t), x_d[0], "joint") for t in (0, 3600, 7200)]
    assert found.x == pytest.approx(np.array(warm), abs=5e-6)


def test_a_pose_out_of_reach_is_reported_and_the_next_one_served(h4, table2):
    poses = [[0, 0, -2, 0], table2[3]]
    found = MujocoPlant(h4).visit(h4, poses, tp.Controller(law="joint"))
    assert found.status.tolist() == ["chain 1: unreachable", "ok"]
    assert np.isnan(found.x[0]).all() and np.isfinite(found.x[1]).all()


def test_a_loop_that_is_unstable_is_no_pose(h4, table2):
    """Arms on springs, a cycle of delay and a velocity that comes late."""
    plant = MujocoPlant(h4, tp.Effects().only("compliance", "delay"))
    found = plant.visit(h4, table2[:1], tp.Controller(law="joint", velocity_bandwidth=500))
    assert found.status[0].startswith(("does not come to rest", "lost"))
    assert np.isnan(found.x).all()


def test_the_same_seed_gives_the_same_visit(h4, table2):
    first, second = (
        MujocoPlant(h4, tp.Effects(), seed=3).visit(h4, table2[:2], tp.Controller()) for _ in "12"
    )
    assert np.array_equal(first.q_e, second.q_e, equal_nan=True)
    assert np.array_equal(first.frame, second.frame, equal_nan=True)


def test_the_exported_file_is_a_model_and_is_replaced_by_force_only(run, tmp_path):
    words = ("export", "mjcf", "h4", "-o", "h4.xml")
    assert run(*words)[:2] == (0, "Wrote h4.xml\n")
    assert run("export", "mjcf", "h4")[1] == (tmp_path / "h4.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "h4.xml"))
    assert (model.nu, model.nv) == (4, 28)
    status, _, err = run(*words)
    assert status == 2 and "exists; --force" in err and run(*words, "--force")[0] == 0


def test_without_a_screen_one_line_says_so(run, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    status, _, err = run("view", "h4")
    assert (status, err.count("\n")) == (2, 1) and "--png" in err


def test_a_picture_without_a_screen_or_one_line(run, monkeypatch, tmp_path):
    """Where no OpenGL driver is installed, the line says what to install."""
    monkeypatch.delenv("DISPLAY", raising=False)
    status, _, err = run("view", "delta", "--png", "delta.png")
    if status:
        assert (status, err.count("\n")) == (2, 1) and "libegl1" in err
        return
    from matplotlib.image import imread

    picture = imread(tmp_path / "delta.png")
    assert picture.shape[:2] == (1200, 1600) and picture[..., :3].std() > 0.05


def test_a_driver_that_is_not_there_is_one_line(tmp_path):
    """In a process of its own: MuJoCo refuses the driver when it is imported."""
    program = "from truepose.commands.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, "view", "delta", "--png", "delta.png"],
        env=os.environ | {"MUJOCO_GL": "nonsense"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    err = done.stderr
    assert (done.returncode, err.count("\n")) == (2, 1) and "MUJOCO_GL: nonsense" in err


def test_a_picture_is_a_file_like_others(h4, tmp_path):
    (tmp_path / "out.png").write_bytes(b"mine")
    with pytest.raises(tp.InputError, match="exists; --force"):
        viewing.picture(h4, tmp_path / "out.png")


def test_a_real_robot_on_its_own_calibration_rests_where_the_exact_statics_say(h4, table2):
    """Under the law of the estimate, every rod by itself in robot, calibration and controller."""
    robot, poses = h4.with_sensors("theta", "z_telemeter"), table2[::200]
    true = robot.sample(11).with_level("full")
    readings = true.read(tp.steady_state(robot, true, table2, "joint"))
    believed = tp.calibrate(robot, readings, options=CalibrationOptions(cause="ignore")).robot
    expected = tp.steady_state(believed, true, poses, "estimated")
    controller = tp.Controller(law="estimated", integral=20.0)
    visit = MujocoPlant(true).visit(believed, poses, controller)
    assert (visit.status == "ok").all()
    assert np.abs(visit.x - expected).max() < 2e-5  # counts
    usual = tp.steady_state(robot, true, poses, "joint")
    off = [np.linalg.norm((x - poses)[:, :3], axis=1) for x in (visit.x, usual)]
    assert off[0].max() < 0.2 * off[1].max()


def test_a_shell_in_mujoco_waits_for_its_brakes_and_refuses_what_it_never_starts(h4):
    SafetyShell = pytest.importorskip("truepose_safety").SafetyShell
    poses = [[0.002, 0, -0.4, 0]]
    slow = MujocoPlant(h4, safety=SafetyShell(brake=0.2), timestep=1e-4)
    visit = slow.visit(h4, poses, tp.Controller(period=1e-4))
    assert visit.x[0] == pytest.approx(poses[0], abs=5e-4)
    narrow = SafetyShell(tracking=2e-3, deviation=2.1e-3)
    with pytest.raises(tp.PoseError, match="h4: the safety shell does not start"):
        MujocoPlant(h4.sample(1), safety=narrow).visit(h4, poses, tp.Controller())


@pytest.mark.parametrize("monitored", [False, True])
def test_a_frozen_bus_in_mujoco_is_stopped_by_the_brakes(h4, monitored):
    SafetyShell = pytest.importorskip("truepose_safety").SafetyShell
    monitor = tp.FaultMonitor() if monitored else None
    shell = {"safety": SafetyShell(), "monitor": monitor, "duration": 0.3}
    poses = [[0.03, 0, -0.45, 0.1], h4.home]
    healthy = MujocoPlant(h4, **shell).visit(h4, poses, tp.Controller())
    assert healthy.status.tolist() == ["ok", "ok"]
    frozen = [tp.faults.Fault("frame", "stuck", at=0.15)]
    stopped = MujocoPlant(h4, faults=frozen, **shell).visit(h4, poses, tp.Controller())
    said = "safety shell: stale frame at 0.152 s, stopped by brake"
    assert stopped.status.tolist() == [said, said]
    with pytest.raises(tp.InputError, match="needs a safety shell"):
        MujocoPlant(h4, monitor=tp.FaultMonitor())


MOVE = np.array([[0.05, -0.05, -0.45, 0.1]])


@pytest.mark.parametrize(("kind", "size"), [("bias", 0.01), ("gain", 1.05)])
def test_a_faulty_reading_moves_the_robot_as_in_exact_statics(h4, kind, size):
    faults, controller = [tp.faults.Fault("q1", kind, 0, size)], tp.Controller(law="joint")
    found = MujocoPlant(h4, faults=faults).visit(h4, MOVE, controller)
    statics = ExactPlant(h4, level="ideal", faults=faults).visit(h4, MOVE, controller)
    assert found.status.tolist() == ["ok"]
    assert found.x == pytest.approx(statics.x, abs=2e-5)
    assert found.q_e == pytest.approx(statics.q_e, abs=2e-4)


def test_a_motor_whose_encoder_is_stuck_is_driven_to_its_limit(h4):
    stuck = [tp.faults.Fault("q1", "stuck", 0)]
    assert MujocoPlant(h4, faults=stuck).visit(h4, MOVE, tp.Controller(law="joint")).status != "ok"


def test_a_robot_whose_readings_are_missing_for_two_cycles_arrives(h4):
    lost = tp.faults.Fault("theta", "dropout", at=0.1, until=0.102)
    usual, found = (
        MujocoPlant(h4, faults=faults).visit(h4, np.repeat(MOVE, 2, axis=0), tp.Controller())
        for faults in ((), [lost])
    )
    assert found.status.tolist() == ["no answer in 2 cycles: not finite", "ok"]
    assert found.x == pytest.approx(usual.x, abs=1e-4)


def test_a_stuck_reading_stays_so_from_pose_to_pose(h4, monkeypatch):
    """Without faults ranges of poses have a robot each, which begins at home: here one a pose."""
    monkeypatch.setattr(plant, "_RANGE", 1)
    stuck = tp.faults.Fault("theta", "stuck", at=10.0)  # before the second pose
    poses = np.repeat(MOVE, 3, axis=0) * [[1, 1, 1, 1], [1, 1, 1, -1], [1, 1, 1, 0]]
    found = MujocoPlant(h4, faults=[stuck]).visit(h4, poses, tp.Controller(law="joint"))
    assert found.status.tolist() == ["ok"] * 3
    assert found.x[:, 3] == pytest.approx(poses[:, 3], abs=1e-4)
    assert found.q_e[:, 4] == pytest.approx(MOVE[0, 3], abs=1e-4)
    assert found.q_e[1, 4] == found.q_e[2, 4]


def test_delays_that_the_model_states_are_compensated(h4):
    prompt = h4.with_sensors("theta", "z_telemeter").without_quantization()
    late = {"sample_period": 0.01, "latency": 0.008}
    sensors = tuple(s.model_copy(update=late) for s in prompt.spec.sensor)
    values = {name: parameter.value for name, parameter in prompt.parameters.items()}
    robot = tp.Robot(prompt.spec.model_copy(update={"sensor": sensors}), values)
    x, controller = [[0.03, 0.02, -0.4, 0.1]], tp.Controller(law="estimated", frequency=60)
    usual = MujocoPlant(prompt).visit(prompt, x, controller).x
    stated = MujocoPlant(robot).visit(robot, x, controller)
    assert stated.status.tolist() == ["ok"] and abs(stated.x - usual).max() < 1e-4
    omitted = MujocoPlant(robot).visit(prompt, x, controller)
    assert omitted.status[0] != "ok" or abs(omitted.x - usual).max() > 1e-4
