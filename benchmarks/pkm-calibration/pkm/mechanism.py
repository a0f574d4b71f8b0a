"""Robots as rigid bodies in MuJoCo, loops closed by Newton's iteration on its Jacobians.

Every arm, carriage, leg, rod, bar and the platform is a body. MuJoCo's own loop constraints are
soft; here the gap between each rod's end and its anchor is solved to 1e-12 m instead.
"""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from pkm.poses import position, rotation

_INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
_GAP = 1e-11  # m, largest accepted gap of a rod's end


def text(vector: Any) -> str:
    """Return a vector as an attribute."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(vector))


class Machine:
    """A robot of given geometry: a description with `lengths` and `ends` of every rod."""

    def __init__(self, geometry: dict[str, Any]):
        self.geometry, self.names = geometry, geometry["pose"]
        self.planar = self.names == ["x", "y"]
        self.model = mujoco.MjModel.from_xml_string(self._xml())
        self.data = mujoco.MjData(self.model)
        self.loops = [
            (self.model.site(f"end{k}").id, self.model.site(f"anchor{k}").id)
            for k in range(self.model.nsite // 2)
        ]
        joints = [self.model.joint(j) for j in range(self.model.njnt)]
        self.at = {joint.name: int(joint.qposadr[0]) for joint in joints}
        self.dofs = {joint.name: int(joint.dofadr[0]) for joint in joints}
        self.motors = [f"motor{i}" for i in range(len(geometry["chains"]))]
        self.motor = [self.at[name] for name in self.motors]

    def _xml(self) -> str:
        home = position(self.names, self.geometry["home"]["pose"])
        hinges = {f"bar{k + 1}": bar["hinge"] for k, bar in enumerate(self.geometry["bars"])}
        sites = dict.fromkeys(["platform", *hinges], "")  # of anchors, by body
        out, count = [], 0
        for i, chain in enumerate(self.geometry["chains"]):
            on, anchor = chain["on"], np.array(chain["anchor"])
            there = home + anchor + hinges.get(on, np.zeros(3))  # bars are not turned at home
            body, ends = self._chain(i, chain, there, count)
            out.append(body)
            for end in ends:
                sites[on] += f'<site name="anchor{count}" pos="{text(anchor + end)}"/>'
                count += 1
        own = '<joint name="platform" type="free"/>'
        if self.planar:
            own = "".join(
                f'<joint name="{name}" type="slide" axis="{text(axis)}" ref="{text(ref)}"/>'
                for name, axis, ref in zip("xy", np.eye(3), home, strict=False)
            )
        out.append(f'<body pos="{text(home)}">{own}{_INERTIA}{sites["platform"]}')
        out += [
            f'<body pos="{text(hinge)}"><joint name="{bar}" axis="0 0 1"/>{_INERTIA}'
            f"{sites[bar]}</body>"
            for bar, hinge in hinges.items()
        ]
        body = "".join([*out, "</body>"])
        return f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>'

    def _chain(
        self, i: int, chain: dict[str, Any], there: np.ndarray, count: int
    ) -> tuple[str, list[np.ndarray]]:
        """Return a chain's bodies at home, and its rods' ends relative to the anchor."""
        q, base = self.geometry["home"]["motors"][i], np.array(chain["base"])
        turning = '<joint type="hinge" axis="0 0 1"/>' if self.planar else '<joint type="ball"/>'
        leg = (there - base) / np.linalg.norm(there - base)
        u = np.array(chain.get("axis", leg))
        kind = "hinge" if chain["motor"] == "hinge" else "slide"
        motor = f'<joint name="motor{i}" ref="{q!r}" axis="{text(u)}" type="{kind}"/>{_INERTIA}'
        if chain["motor"] == "leg":
            site = f'<site name="end{count}" pos="{text(q * u)}"/>'
            inner = f"{turning}{_INERTIA}<body>{motor}{site}</body>"
            return f'<body pos="{text(base)}">{inner}</body>', list(chain["ends"])
        elbow = np.zeros(3)
        if kind == "hinge":
            e = np.array(chain["arm_zero"])
            elbow = chain["arm"] * (e * np.cos(q) + np.cross(u, e) * np.sin(q))
        else:
            base = base + q * u
        out, ends = f'<body pos="{text(base)}">{motor}', []
        for length, near, far in rods(chain):
            along = there + far - base - elbow - near
            end = length * along / np.linalg.norm(along)
            out += (
                f'<body pos="{text(elbow + near)}">{turning}{_INERTIA}'
                f'<site name="end{count + len(ends)}" pos="{text(end)}"/></body>'
            )
            ends.append(far)
        return f"{out}</body>", ends

    def close(self, fixed: np.ndarray) -> float:
        """Close all loops with these degrees of freedom fixed, (nv,); return the gap, m.

        RuntimeError: they do not close.
        """
        model, data, step = self.model, self.data, np.zeros(self.model.nv)
        gaps, rows = np.empty((len(self.loops), 3)), np.empty((len(self.loops), 3, model.nv))
        one, other, gap = np.empty((3, model.nv)), np.empty((3, model.nv)), np.inf
        for _ in range(30):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            for k, (end, anchor) in enumerate(self.loops):
                gaps[k] = data.site_xpos[end] - data.site_xpos[anchor]
                mujoco.mj_jacSite(model, data, one, None, end)
                mujoco.mj_jacSite(model, data, other, None, anchor)
                rows[k] = one - other
            before, gap = gap, float(np.abs(gaps).max())
            if gap < 1e-12 or (gap < _GAP and gap > 0.5 * before):
                return gap
            # Least norm: a rod does not spin about itself.
            J = rows.reshape(-1, model.nv)[:, ~fixed]
            step[~fixed] = np.linalg.lstsq(J, -gaps.ravel())[0]
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        raise RuntimeError(f"{self.geometry['name']}: loops do not close: gap {gap:.2g} m")

    def motors_for(self, pose: np.ndarray) -> np.ndarray:
        """Return the motors of a pose of the nominal robot, reached from home in three steps."""
        data, start = self.data, np.array(self.geometry["home"]["pose"])
        mujoco.mj_resetData(self.model, data)
        bars = [name for name in self.at if "bar" in name]
        fixed = np.zeros(self.model.nv, dtype=bool)
        fixed[[self.dofs[name] for name in bars]] = True
        if self.planar:
            fixed[[self.dofs["x"], self.dofs["y"]]] = True
        else:
            fixed[self.dofs["platform"] : self.dofs["platform"] + 6] = True
        for share in (1 / 3, 2 / 3, 1):
            x = start + share * (pose - start)
            if self.planar:
                data.qpos[[self.at["x"], self.at["y"]]] = x
            else:
                turn = rotation(self.names, x).as_quat(scalar_first=True)
                at = self.at["platform"]
                data.qpos[at : at + 7] = np.concatenate([x[:3], turn])
            data.qpos[[self.at[name] for name in bars]] = -x[-1]
            self.close(fixed)
        return data.qpos[self.motor].copy()

    def move_to(self, motors: np.ndarray, start: np.ndarray) -> None:
        """Close the loops at these motor positions, from `start`, the state of a like machine."""
        self.data.qpos[:] = start
        self.data.qpos[self.motor] = motors
        fixed = np.zeros(self.model.nv, dtype=bool)
        fixed[[self.dofs[name] for name in self.motors]] = True
        self.close(fixed)

    @property
    def turn(self) -> Rotation:
        """Rotation of the platform."""
        if self.planar:
            return Rotation.identity()
        at = self.at["platform"]
        return Rotation.from_quat(self.data.qpos[at + 3 : at + 7], scalar_first=True)

    @property
    def pose(self) -> np.ndarray:
        """Coordinates of the platform."""
        at, n = self.at["x" if self.planar else "platform"], len(self.names)
        place = self.data.qpos[at : at + min(3, n)].copy()
        if self.names[-1] == "theta":
            R = self.turn.as_matrix()
            return np.append(place, np.arctan2(R[1, 0], R[0, 0]))
        return np.concatenate([place, self.turn.as_rotvec()])[: max(n, len(place))]

    def sensors(self) -> np.ndarray:
        """Return the exact readings of the redundant sensors."""
        place, turn = position(self.names, self.pose), self.turn
        values = []
        for sensor in self.geometry["sensors"]:
            if sensor["kind"] == "hinge":
                value = -self.data.qpos[self.at[sensor["bar"]]]
            else:
                value = np.linalg.norm(place + turn.apply(sensor["target"]) - sensor["origin"])
            values.append(value - sensor["offset"])
        return np.array(values)


def rods(chain: dict[str, Any]) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Give every rod's length, its start from the elbow or carriage, its end from the anchor."""
    spacing, pair = chain.get("spacing", 0.0), len(chain["lengths"]) > 1
    across = np.array(chain.get("pair_axis", chain["axis"]))
    nominal = np.array(chain.get("nominal_axis", across))
    sides = (0.5, -0.5) if pair else (0.0,)
    for side, length, end in zip(sides, chain["lengths"], chain["ends"], strict=True):
        yield length, side * spacing * across, side * spacing * nominal + end
