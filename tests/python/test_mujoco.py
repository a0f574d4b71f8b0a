"""Does an independent robot, in MuJoCo, do what truepose's models say?"""

import sys

import numpy as np
import pytest

import truepose as tp
from truepose import _core, simulations
from truepose.plants.mjcf import Mechanism, to_mjcf

mujoco = pytest.importorskip("mujoco")

from truepose.plants.mujoco import Body, MujocoPlant  # noqa: E402

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


def padded(values):
    return [*map(float, values), *[0.0] * (6 - len(values))]


def imperfect(robot, rng, turned):
    """Errors of every length; axes turned where every rod can follow."""
    if all(chain.actuator == "revolute" for chain in robot.spec.chain):
        robot = tp.with_paper_errors(robot, int(rng.integers(2**32)))
    sigma = {".yaw": np.radians(0.1), ".tilt": np.radians(0.1), ".rod_difference": 2e-5}
    turns = {
        name: rng.normal(0, s)
        for name in robot.parameters
        for end, s in sigma.items()
        if turned and name.endswith(end)
    }
    return robot.replace(turns)


def somewhere(robot, rng):
    box = robot.spec.singularity_free
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
        self.dof = [joints[k] for k in names if k in joints] if planar else [start + k for k in range(6)]
        self.columns = list(range(robot.n)) if planar else FREE[robot.spec.mobility]
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
            T[3:, 3:] = self.body.nacelle()[1]
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
        for i in range(self.robot.n):
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
    values, status = _core.acceleration(robot._core, padded(x), padded(rate), padded(torque))
    assert status == 0
    return np.array(values)[: robot.n]


def some_torque(robot, rng):
    limits = np.array([chain.torque_limit for chain in robot.spec.chain])
    return rng.uniform(-0.2, 0.2, robot.n) * limits


def test_every_robot_stands_closed_at_home(any_robot):
    body = Body(any_robot)
    assert body.gap() < 1e-12
    assert body.coordinates() == pytest.approx(any_robot.home, abs=1e-12)
    assert body.model.nu == any_robot.n


def test_both_rods_of_a_pair_are_there(h4):
    truth = h4.replace({"chain2.rod_difference": 1e-3})
    ends = [
        Body(truth).model.site(f"rod2{side}.end").pos[0] for side in "+-"
    ]
    assert ends == pytest.approx([0.4805, 0.4795], abs=1e-12)


def test_loose_rods_are_refused():
    """An H4 whose chains 1 and 2 share a bar."""
    h4 = tp.load("h4")
    chains = [c.model_copy(update={"bar": b}) for c, b in zip(h4.spec.chain, (1, 1, 2, 2), strict=True)]
    try:
        loose = tp.Robot(h4.spec.model_copy(update={"chain": tuple(chains)}))
    except tp.RobotFileError:
        pytest.skip("the loader itself refuses it")
    with pytest.raises(tp.InputError, match="loose"):
        Mechanism(loose)


@pytest.mark.parametrize("name", tp.robots())
def test_statics_agree_with_every_rod_by_itself(name, rng, settings):
    """Motors held anywhere: 1 µm and 1e-5 rad, with errors of geometry, axes and rods."""
    robot = tp.load(name)
    truth = imperfect(robot, rng, turned=bool(robot.full))
    level = "full" if truth.full else "ideal"
    plant, mechanism = MujocoPlant(truth), Mechanism(truth)
    for _ in range(settings):
        q = robot.ikm(somewhere(robot, rng))
        settled = plant.settle_at(q)
        expected = mechanism.posture(truth.fkm(q, guess=settled.x, level=level))
        assert np.abs(settled.frame[:3, 3] - expected.D).max() < 1e-6
        assert np.abs(settled.frame[:3, :3] - expected.R).max() < 1e-5


def test_motors_where_no_pose_closes_the_loops(delta):
    with pytest.raises(tp.PoseError, match=r"delta: motors at q = .*: a loop stays open by"):
        MujocoPlant(delta).settle_at([1.5, -0.7, -0.7])


@pytest.mark.parametrize("name", tp.robots())
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


@pytest.mark.parametrize("name", tp.robots())
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
