"""Speed compared with Pinocchio and MuJoCo on the same problem, in one run.

    pip install ".[peers]" && python benchmarks/peers.py --core build/dev/benchmarks/benchmark_core

The problem: LinuxCNC's 6-UPS (robots/stewart), random poses within ±80 mm in x and y, ±60 mm in z
and ±15° in each component of the rotation vector. Inverse: leg lengths and J; forward: the pose
from the lengths, from a seed 1 mm and 1 mrad away in every coordinate and from home, until no loop
is open by more than 1e-12 m.

Neither peer has a forward model of a closed loop. Each gets the tree of its manual (free platform,
six legs of two hinges and a slide, six points to join) and Newton's method in numpy on its own
residuals and Jacobian, as a user of its Python interface would write it. Times are thus those of
Python, except truepose's: batched from Python on every core, and from C++ on one (the benchmark's
own 6-UPS, ±60 mm and ±0.15 rad).
"""

import subprocess
import time

import numpy as np
from printing import arguments
from scipy.spatial.transform import Rotation

import truepose as tp

HALF_WIDTHS = np.array([0.08, 0.08, 0.06, *np.radians([15, 15, 15])])
RESIDUAL = 1e-12  # m
COLUMNS = ("IK + J", "FK from 1 mm, 1 mrad", "FK from home")


class Legs:
    """Bases, platform points and home of the hexapod; each leg's frame has z along it at home."""

    def __init__(self, robot):
        self.base = np.array([chain.base for chain in robot.spec.chain])
        self.pivot = np.array([chain.anchor for chain in robot.spec.chain])
        self.home = np.asarray(robot.home)
        at_home = self.home[:3] + self.pivot - self.base
        self.length = np.linalg.norm(at_home, axis=1)
        self.frame = []
        for z in at_home / self.length[:, None]:
            x = np.cross([0, 1, 0], z)
            x /= np.linalg.norm(x)
            self.frame.append(np.column_stack([x, np.cross(z, x), z]))


class Peer:
    """Newton's method on a peer's residuals and Jacobian.

    A state is the platform's position and quaternion, then two hinges and a slide per leg; a
    velocity has 6 entries for the platform.
    """

    scalar_first = True
    slides = 6 + 3 * np.arange(6) + 2

    def newton(self, q, free):
        for _ in range(50):
            error, A = self.closure(q)
            if np.abs(error).max() < RESIDUAL:
                return q, A
            step = np.zeros(24)
            step[free] = np.linalg.solve(A[:, free], -error)
            q = self.moved(q, step)
        raise RuntimeError(f"{self.name}: no solution in 50 steps")

    def at(self, pose):
        """Return the state at a pose, and the closure's Jacobian."""
        q = self.home.copy()
        turn = Rotation.from_rotvec(pose[3:]).as_quat(scalar_first=self.scalar_first)
        q[:3], q[3:7] = pose[:3], turn
        return self.newton(q, np.arange(6, 24))

    def inverse(self, pose):
        """Return leg lengths and J of the platform's twist at a pose."""
        q, A = self.at(pose)
        rates = np.linalg.solve(A[:, 6:], -A[:, :6])
        return q[9::3], np.linalg.inv(rates[self.slides - 6])

    def forward(self, lengths, q):
        """Return the platform's position for the lengths, from a state."""
        q = q.copy()
        q[9::3] = lengths
        return self.newton(q, np.setdiff1d(np.arange(24), self.slides))[0][:3]


class Pinocchio(Peer):
    name = "Pinocchio, Python"
    scalar_first = False

    def __init__(self, legs):
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        model, none = self.model, pin.SE3.Identity()
        platform = model.addJoint(0, pin.JointModelFreeFlyer(), none, "platform")
        self.pairs = []
        for i in range(6):
            at = pin.SE3(legs.frame[i], legs.base[i])
            joint = 0
            for kind in (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelPZ()):
                joint = model.addJoint(joint, kind, at, f"leg{i}{kind.shortname()}")
                at = none
            ends = (joint, none, "tip"), (platform, pin.SE3(np.eye(3), legs.pivot[i]), "anchor")
            self.pairs.append(
                [
                    model.addFrame(pin.Frame(f"{name}{i}", of, 0, at, pin.FrameType.OP_FRAME))
                    for of, at, name in ends
                ]
            )
        self.data = model.createData()
        self.home = pin.neutral(model)
        self.home[:3] = legs.home[:3]
        self.home[9::3] = legs.length

    def closure(self, q):
        pin, model, data = self.pin, self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        error, A = np.empty(18), np.empty((18, 24))
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        for i, (tip, anchor) in enumerate(self.pairs):
            rows = slice(3 * i, 3 * i + 3)
            error[rows] = data.oMf[tip].translation - data.oMf[anchor].translation
            of_tip = pin.getFrameJacobian(model, data, tip, world)[:3]
            A[rows] = of_tip - pin.getFrameJacobian(model, data, anchor, world)[:3]
        return error, A

    def moved(self, q, step):
        return self.pin.integrate(self.model, q, step)


class MuJoCo(Peer):
    name = "MuJoCo, Python"

    def __init__(self, legs):
        import mujoco

        def text(values):
            return " ".join(f"{v:.17g}" for v in values)

        inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        sites = "".join(f'<site name="a{i}" pos="{text(p)}"/>' for i, p in enumerate(legs.pivot))
        bodies = f'<body pos="{text(legs.home[:3])}"><freejoint/>{inertia}{sites}</body>'
        turns = Rotation.from_matrix(legs.frame).as_quat(scalar_first=True)
        for i in range(6):
            place = f'pos="{text(legs.base[i])}" quat="{text(turns[i])}"'
            bodies += (
                f'<body {place}><joint axis="1 0 0"/><joint axis="0 1 0"/>'
                f'<joint type="slide" axis="0 0 1"/>{inertia}<site name="t{i}"/></body>'
            )
        joined = "".join(f'<connect site1="t{i}" site2="a{i}"/>' for i in range(6))
        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option jacobian="dense"/><worldbody>{bodies}</worldbody>'
            f"<equality>{joined}</equality></mujoco>"
        )
        self.data = mujoco.MjData(self.model)
        self.home = self.data.qpos.copy()
        self.home[9::3] = legs.length

    def closure(self, q):
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeConstraint(model, data)
        return data.efc_pos, data.efc_J.reshape(18, 24)

    def moved(self, q, step):
        self.mujoco.mj_integratePos(self.model, q, step, 1)
        return q


def median_time(calls):
    """Return the median time of single calls, s."""
    times = []
    for call in calls:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def measure_peer(peer, robot, x, near):
    q, J, home = robot.ikm(x), robot.jacobian(x), peer.home
    for k in (0, len(x) // 2):  # check that the results agree
        lengths, peer_J = peer.inverse(x[k])
        assert np.abs(lengths - q[k]).max() < 1e-10
        assert abs(abs(np.linalg.det(peer_J)) / abs(np.linalg.det(J[k])) - 1) < 1e-8
        assert np.abs(peer.forward(q[k], home) - x[k, :3]).max() < 1e-10
    seeds = [peer.at(pose)[0] for pose in near]
    each = range(len(x))
    return (
        median_time([lambda k=k: peer.inverse(x[k]) for k in each]),
        median_time([lambda k=k: peer.forward(q[k], seeds[k]) for k in each]),
        median_time([lambda k=k: peer.forward(q[k], home) for k in each]),
    )


def measure_truepose(robot, x, near):
    x, near = np.tile(x, (100, 1)), np.tile(near, (100, 1))
    q = robot.ikm(x)
    calls = (
        lambda: (robot.ikm(x), robot.jacobian(x)),
        lambda: robot.fkm(q, guess=near),
        lambda: robot.fkm(q),
    )
    return tuple(median_time([call] * 9) / len(x) for call in calls)


def measure_core(program):
    table = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    cells = [line.split(" | ") for line in table.splitlines()[2:]]
    median = {name.strip("| "): 1e-6 * float(time) for name, time, _ in cells}
    names = ("IKM + J", "FKM from 1 mm, 1 mrad", "FKM from home")
    return tuple(median[f"6-UPS {name}"] for name in names)


def main():
    options = arguments(__doc__, core="", poses=1000)
    robot = tp.load("stewart")
    rng = np.random.default_rng(1)
    x = robot.home + HALF_WIDTHS * rng.uniform(-1, 1, (options.poses, 6))
    near = x + 1e-3 * rng.choice([-1, 1], size=x.shape)

    rows = {"truepose, Python, batched": measure_truepose(robot, x, near)}
    if options.core:
        rows["truepose, C++, one core"] = measure_core(options.core)
    for peer in (Pinocchio, MuJoCo):
        try:
            ready = peer(Legs(robot))
        except ImportError as error:
            print(f"{peer.name}: SKIPPED, {error.name} is not installed (pip install '.[peers]')")
            continue
        rows[peer.name] = measure_peer(ready, robot, x, near)

    print(f"\nµs per pose (times truepose's from Python), median of {options.poses} poses")
    print(f"{'':28s}" + "".join(f"{column:>26s}" for column in COLUMNS))
    ours = rows["truepose, Python, batched"]
    for name, times in rows.items():
        cells = (f"{t * 1e6:.3g} ({t / o:.3g}×)" for t, o in zip(times, ours, strict=True))
        print(f"{name:28s}" + "".join(f"{cell:>26s}" for cell in cells))


if __name__ == "__main__":
    main()
