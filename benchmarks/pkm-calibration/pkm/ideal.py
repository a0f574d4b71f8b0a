"""Kinematics with one rod per chain in numpy, vectorised over poses; shares no code with truepose.

Baselines: the nominal model, and plain least squares of its parameters by scipy.
"""

from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pkm.poses import difference, position, rotation

#: Parameters of a chain that least squares identify, with their size.
SIZES = {"base": 3, "anchor": 3, "arm": 1, "rod": 1, "offset": 1}
#: Bounds of least squares, in tolerances (σ) about the nominal values.
BOUND = 5.0


class Ideal:
    """The model of a robot; parameters p are errors in units of their tolerances."""

    def __init__(self, robot: dict[str, Any]):
        self.robot, self.names, self.n = robot, robot["pose"], len(robot["chains"])
        chains, sigma = robot["chains"], robot["tolerances"]
        self.kind = chains[0]["motor"]
        hinges = {f"bar{k + 1}": bar["hinge"] for k, bar in enumerate(robot["bars"])}
        self.nominal = {
            "base": np.array([c["base"] for c in chains]),
            "anchor": np.array([c["anchor"] for c in chains]),
            "arm": np.array([[c.get("arm", 0.0)] for c in chains]),
            "rod": np.array([[c.get("rod", 0.0)] for c in chains]),
            "offset": np.zeros((self.n, 1)),
        }
        self.hinge = np.array([hinges.get(c["on"], [0.0, 0.0, 0.0]) for c in chains])
        self.on_bar = np.array([c["on"] != "platform" for c in chains])
        self.u = np.array([c.get("axis", [0.0, 0.0, 0.0]) for c in chains])
        self.e = np.array([c.get("arm_zero", [0.0, 0.0, 0.0]) for c in chains])
        units = [np.tile(np.broadcast_to(sigma[key], size), self.n) for key, size in SIZES.items()]
        self.unit = np.concatenate(units)
        self.used = np.flatnonzero(self.unit)
        spatial = np.zeros((6, self.n))
        spatial[[0, 1, 2, 5] if self.n == 4 else np.arange(self.n), np.arange(self.n)] = 1
        self.free = spatial  # columns of the twist that the platform has

    def parameters(self, p: np.ndarray) -> dict[str, np.ndarray]:
        """Return the geometry of p, (number of used parameters,)."""
        full = np.zeros(len(self.unit))
        full[self.used] = p * self.unit[self.used]
        parts = np.split(full, np.cumsum([size * self.n for size in SIZES.values()])[:-1])
        return {
            key: self.nominal[key] + part.reshape(self.n, -1)
            for (key, part) in zip(SIZES, parts, strict=True)
        }

    def _closure(
        self, x: np.ndarray, q: np.ndarray, g: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, ...]:
        """Return rods v (N, n, 3), gaps (N, n), J of the gaps by the platform's twist, arms, turns.

        v points from the platform to the motor's side; arms are the changes of its ends by the
        arm's length and by the motor.
        """
        at = q[..., None] + g["offset"]  # (N, n, 1)
        B, length, arm = g["base"], g["rod"][:, 0], np.zeros((*q.shape, 3))
        by_q = np.broadcast_to(self.u, arm.shape)
        if self.kind == "hinge":
            side = np.cross(self.u, self.e)
            arm = self.e * np.cos(at) + side * np.sin(at)
            B, by_q = B + g["arm"] * arm, g["arm"] * (side * np.cos(at) - self.e * np.sin(at))
        elif self.kind == "slide":
            B = B + self.u * at
        else:
            length = at[..., 0]
        turning = np.where(self.on_bar[:, None], self.hinge, g["anchor"])
        still = np.where(self.on_bar[:, None], g["anchor"], 0.0)
        R = rotation(self.names, x).as_matrix()
        lever = np.einsum("kij,cj->kci", R, turning)
        v = B - position(self.names, x)[:, None] - lever - still
        J = np.concatenate([v, np.cross(lever, v)], axis=2) @ self.free
        return v, ((v**2).sum(axis=2) - length**2) / 2, J, arm, by_q, R

    def fkm(self, q: np.ndarray, p: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return the poses (N, n) of motor readings (N, n) by Newton's iteration."""
        g, x = self.parameters(p), guess.copy()
        for _ in range(30):
            _, gap, J, *_ = self._closure(x, q, g)
            # A step out of all proportion belongs to a geometry that does not close.
            step = np.clip(np.linalg.solve(J, gap[..., None])[..., 0], -0.3, 0.3)
            x = self.moved(x, step)
            if np.abs(step).max() < 1e-9:
                break
        return x

    def moved(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return poses x after small twists."""
        there = x + step
        if self.n == 6:
            turn = Rotation.from_rotvec(np.atleast_2d(step)[:, 3:].copy())
            there[:, 3:] = (turn * rotation(self.names, x)).as_rotvec()
        return there

    def jacobian(self, x: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the twists of poses x (N, n) by used parameters and motors, (N, n, p + n)."""
        g = self.parameters(p)
        v, _, J, arm, by_q, R = self._closure(x, q, g)
        leg = self.kind == "leg"
        length = (q + g["offset"][:, 0]) if leg else np.broadcast_to(g["rod"][:, 0], q.shape)
        turned = np.where(self.on_bar[:, None], v, np.einsum("kij,kci->kcj", R, v))
        motor = -length if leg else (v * by_q).sum(axis=2)
        rows = [v, -turned, (v * arm).sum(axis=2)[..., None], -length[..., None], motor[..., None]]
        parts = []  # of gaps, (N, n, parameters): each chain's parameters change its gap alone
        for row in rows:
            part = np.einsum("kcs,cd->kcds", row, np.eye(self.n))
            parts.append(part.reshape(*q.shape, -1))
        by_p = (np.concatenate(parts, axis=2) * self.unit)[..., self.used]
        return np.linalg.solve(J, np.concatenate([by_p, parts[-1]], axis=2))

    def sensors(self, x: np.ndarray) -> np.ndarray:
        """Return what the redundant sensors read at poses, (N, r), mounted as in the file."""
        turn, values = rotation(self.names, x), []
        for sensor in self.robot["sensors"]:
            if sensor["kind"] == "hinge":
                values.append(x[:, 3])
                continue
            point = position(self.names, x) + turn.apply(sensor["target"])
            values.append(np.linalg.norm(point - sensor["origin"], axis=1))
        return np.stack(values, axis=1)


def predict(
    model: Ideal, q: np.ndarray, p: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return poses and covariances from motor readings; root rootᵀ is the covariance of p."""
    x = model.fkm(q, p, np.tile(model.robot["home"]["pose"], (len(q), 1)))
    J, motor = model.jacobian(x, q, p), model.robot["motor_readings"]
    by_p, by_q = J[..., : len(p)] @ root, J[..., len(p) :]
    noise = motor["noise"] ** 2 + motor["step"] ** 2 / 12
    return x, by_p @ by_p.transpose(0, 2, 1) + noise * by_q @ by_q.transpose(0, 2, 1)


def nominal(model: Ideal, log: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the held-out poses of the nominal geometry; σ from the tolerances."""
    count = len(model.used)
    return predict(model, log["held_out"][:, : model.n], np.zeros(count), np.eye(count))


def plain_least_squares(model: Ideal, log: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Fit all lengths, points and offsets of the chains; no prior, no robust loss.

    The tracker's poses where there are any, else the redundant sensors, taken as mounted nominally.
    The covariance is the usual one, residual variance · (JᵀJ)⁺.
    """
    read, robot, n = log["calibration"], model.robot, model.n
    q, seen = read[:, :n], log["measured"]
    start = model.fkm(q, np.zeros(len(model.used)), np.tile(robot["home"]["pose"], (len(q), 1)))
    tracker = [robot["tracker"]["position" if k < 3 else "angle"] for k in range(n)]
    sensor = [np.hypot(s["noise"], s["step"] / 12**0.5) for s in robot["sensors"]]

    def residuals(p: np.ndarray) -> np.ndarray:
        x = model.fkm(q, p, start)
        if seen is not None:
            return (difference(model.names, x, seen) / tracker).ravel()
        return ((model.sensors(x) - read[:, n:]) / sensor).ravel()

    def slopes(p: np.ndarray) -> np.ndarray:
        x = model.fkm(q, p, start)
        twist = model.jacobian(x, q, p)[..., : len(p)]
        if seen is not None:
            return (twist / np.array(tracker)[:, None]).reshape(-1, len(p))
        steps = 1e-6 * np.eye(n)
        by_x = [(model.sensors(model.moved(x, d)) - model.sensors(x)) / 1e-6 for d in steps]
        by_p = np.einsum("nks,knp->ksp", by_x, twist) / np.array(sensor)[:, None]
        return by_p.reshape(-1, len(p))

    fit = least_squares(residuals, np.zeros(len(model.used)), jac=slopes, bounds=(-BOUND, BOUND))
    _, S, Vt = np.linalg.svd(fit.jac, full_matrices=False)
    known = 1e-6 * S[0] < S
    variance = 2 * fit.cost / max(len(fit.fun) - known.sum(), 1)
    root = np.sqrt(variance) * Vt[known].T / S[known]
    return predict(model, log["held_out"][:, :n], fit.x, root)
