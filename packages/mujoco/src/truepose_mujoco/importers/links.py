"""Rigid bodies of a model, and the links and loops between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.linalg import inv

from truepose.arguments import Array
from truepose.exceptions import InputError, choose

#: m, plus this share of the model's size; axes that pass each other nearer than that meet.
MEET = 1e-6


@dataclass(eq=False)
class Link:
    """Connection of two rigid bodies: joints at one place, or a point that closes a loop.

    All vectors are in the world frame, with every joint at zero.
    """

    name: str  #: of its first joint, or of the closure
    bodies: tuple[int, int]  #: the one towards the world first; for a closure in its own order
    points: Array  #: (2, 3) position of the link on each body
    axes: Array  #: (k, 3) axes of rotation, the base's first, or direction of a slide
    anchors: Array  #: (k, 3) a point of each axis, on the first body
    slides: bool = False
    loose: bool = False  #: free, or axes that do not meet
    ids: tuple[int, ...] = ()  #: of its joints

    @property
    def turns(self) -> int:
        """Number of rotations about one common point; 0 without such a point."""
        return 0 if self.slides or self.loose else len(self.axes)

    def other(self, body: int) -> int:
        """Return the other body."""
        return self.bodies[1 - self.bodies.index(body)]

    def point_on(self, body: int) -> Array:
        """Return the link's position on a body."""
        return self.points[self.bodies.index(body)]


@dataclass(frozen=True)
class Closure:
    """Closure of a loop: by a point, or by a whole frame if `held` is given."""

    name: str
    bodies: tuple[int, int]
    points: Array  #: (2, 3) at zero
    held: Array | None  #: (4, 4) frame of the second body in the first


class Model:
    """A compiled model with all joints at zero."""

    def __init__(self, model: mujoco.MjModel):
        self.model = model
        self.data = mujoco.MjData(model)
        scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        at = model.jnt_qposadr[np.isin(model.jnt_type, scalar)]
        self.data.qpos[at] = 0.0  # at qpos0 they may have any value
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)

    def actuators(self) -> dict[int, list[int]]:
        """Return the actuators of each driven joint."""
        kinds, found = mujoco.mjtTrn, dict[int, list[int]]()
        driving = int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)
        for k in np.flatnonzero(np.isin(self.model.actuator_trntype, driving)).tolist():
            found.setdefault(int(self.model.actuator_trnid[k, 0]), []).append(k)
        return found

    def equalities(self, kind: Any) -> Iterator[tuple[int, str, tuple[int, int]]]:
        """Yield number, name and both objects of the active equalities of a kind."""
        model = self.model
        for k in np.flatnonzero((model.eq_type == int(kind)) & model.eq_active0).tolist():
            name = model.equality(k).name or f"equality {k + 1}"
            yield k, name, (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))

    def closures(self) -> Iterator[Closure]:
        """Yield the closure of every loop equality."""
        model, data, kinds = self.model, self.data, mujoco.mjtEq
        for kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            for k, name, ids in self.equalities(kind):
                if model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
                    bodies = int(model.site_bodyid[ids[0]]), int(model.site_bodyid[ids[1]])
                    first, second = (_frame(data.site_xpos[i], data.site_xmat[i]) for i in ids)
                    points = np.array([first[:3, 3], second[:3, 3]])
                    of_first, of_second = (self.frame(body) for body in bodies)
                    held = inv(of_first) @ first @ inv(second) @ of_second  # both coincide
                else:
                    bodies, R = ids, np.zeros(9)
                    anchors = model.eq_data[k, :6].reshape(2, 3)
                    points = _moved([self.frame(body) for body in bodies], anchors)
                    mujoco.mju_quat2Mat(R, model.eq_data[k, 6:10])
                    held = _frame(model.eq_data[k, 3:6], R)
                yield Closure(name, bodies, points, held if kind == kinds.mjEQ_WELD else None)

    def frame(self, body: int) -> Array:
        """Return a body's frame, (4, 4), every joint at zero."""
        return _frame(self.data.xpos[body], self.data.xmat[body])


class _Bodies:
    """Rigid bodies formed of MuJoCo's bodies; parts that are apart at zero are moved together."""

    def __init__(self, count: int):
        self.part = np.arange(count)  #: rigid body of each body: the number of its first part
        self.put = np.tile(np.eye(4), (count, 1, 1))  #: displacement of each body at zero

    def pair(self, bodies: Sequence[int]) -> tuple[int, int]:
        """Return the rigid bodies of two bodies."""
        return int(self.part[bodies[0]]), int(self.part[bodies[1]])

    def drawn(self, bodies: Sequence[int], points: Array) -> Array:
        """Return a point of each body after the body's displacement."""
        return _moved(self.put[list(bodies)], points)

    def moved(self) -> set[int]:
        """Return the rigid bodies with a displaced part."""
        displaced = (np.abs(self.put - np.eye(4)) > MEET).any(axis=(1, 2))
        return {*self.part[displaced].tolist()}

    def join(self, a: int, b: int, step: Array) -> None:
        """Join two bodies; `step`, (4, 4), moves b from its pose at zero to where a holds it."""
        low, high = sorted(self.pair((a, b)))
        if low == high:
            return
        motion = self.put[a] @ step @ inv(self.put[b])
        moved = self.part == high
        self.put[moved] = (inv(motion) if self.part[b] == low else motion) @ self.put[moved]
        self.part[moved] = low


class Mechanism:
    """Rigid bodies and links between them; a body has the number of its first part."""

    def __init__(
        self,
        m: Model,
        path: Path,
        closures: Sequence[Closure],
        motors: set[int],
        retyped: dict[int, str],  #: axes of rotation of joints that are not of the model's type
    ):
        self._kinds = mujoco.mjtJoint
        model = self.model = m.model  #: MuJoCo's model
        self.data = m.data  #: MuJoCo's data, with every joint at zero
        self.source = path.name  #: the file's name
        self.name = model.names[: model.names.index(b"\0")].decode() or path.stem
        self.motors = motors  #: driven joints
        self.actuators = m.actuators()  #: by joint
        hinges = np.flatnonzero(model.jnt_type == int(self._kinds.mjJNT_HINGE))
        self.hinges = {*hinges.tolist()} - {*retyped}
        #: Joints that an equality couples, and its name.
        self.coupled = {
            joint: name for _, name, ids in m.equalities(mujoco.mjtEq.mjEQ_JOINT) for joint in ids
        }
        bodies = _Bodies(model.nbody)
        joints = [
            [k for k in range(first, first + count) if retyped.get(k) != ""]
            for first, count in zip(model.body_jntadr, model.body_jntnum, strict=True)
        ]
        pairs = list(enumerate(model.body_parentid.tolist()))
        for body, parent in pairs[1:]:
            if not joints[body]:
                bodies.join(parent, body, np.eye(4))
        for c in closures:
            if c.held is not None:
                a, b = c.bodies
                bodies.join(a, b, m.frame(a) @ c.held @ inv(m.frame(b)))
        self.links = [
            self._link(joints[body], (parent, body), bodies, retyped)
            for body, parent in pairs
            if joints[body]
        ]
        for c in closures:
            if c.held is None:
                points = bodies.drawn(c.bodies, c.points)
                ball = np.eye(3), np.tile(points[0], (3, 1))
                self.links.append(Link(c.name, bodies.pair(c.bodies), points, *ball))
        self.body_of = bodies.part.tolist()  #: rigid body of each of MuJoCo's bodies
        self.moved = bodies.moved()  #: rigid bodies joined by a loop of parts apart at zero

    def body(self, name: str) -> int:
        """Return the rigid body that contains the named body."""
        names = [self.name_of(k) for k in range(self.model.nbody)]
        if name not in names:
            raise InputError(choose("body", name, names[1:]))
        return self.body_of[names.index(name)]

    def name_of(self, body: int) -> str:
        """Return a body's name."""
        return self.model.body(body).name or f"body {body}"

    def at(self, body: int, but: Link | None = None) -> list[Link]:
        """Return a body's links, without `but`."""
        return [link for link in self.links if body in link.bodies and link is not but]

    def _link(
        self, ids: list[int], pair: tuple[int, int], bodies: _Bodies, retyped: dict[int, str]
    ) -> Link:
        """Return one link of all joints of one of MuJoCo's bodies."""
        model, data, kinds = self.model, self.data, self._kinds
        frame = data.xmat[pair[1]].reshape(3, 3)
        axes, anchors = [], []
        for k in ids:
            turned = [data.xaxis[k]]
            if k in retyped or model.jnt_type[k] == kinds.mjJNT_BALL:
                turned = [frame[:, "XYZ".index(c)] for c in retyped.get(k, "XYZ")]
            axes += turned
            anchors += [data.xanchor[k]] * len(turned)
        point = meeting(np.array(anchors), np.array(axes)) if len(axes) > 1 else anchors[0]
        at = anchors[0] if point is None else point
        types = model.jnt_type[ids].tolist()
        slide = int(kinds.mjJNT_SLIDE) in types
        return Link(
            name=model.joint(ids[0]).name or f"joint {ids[0] + 1}",
            bodies=bodies.pair(pair),
            points=bodies.drawn(pair, np.array([at, at])),
            axes=np.array(axes),
            anchors=bodies.drawn([pair[0]] * len(anchors), np.array(anchors)),
            slides=slide and len(ids) == 1,
            loose=point is None or int(kinds.mjJNT_FREE) in types or (slide and len(ids) > 1),
            ids=tuple(ids),
        )


def _frame(position: Array, rotation: Array) -> Array:
    """Return a homogeneous matrix, (4, 4)."""
    frame = np.eye(4)
    frame[:3, 3], frame[:3, :3] = position, rotation.reshape(3, 3)
    return frame


def _moved(frames: Iterable[Array], points: Array) -> Array:
    """Return each point moved by its frame."""
    return np.array([T[:3, :3] @ p + T[:3, 3] for T, p in zip(frames, points, strict=True)])


def meeting(points: Array, axes: Array) -> Array | None:
    """Return the common point of lines, shape (3,); None if there is none or all are parallel."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    A, b = across.reshape(-1, 3), (across @ points[..., None]).reshape(-1)
    if np.linalg.matrix_rank(A, tol=1e-6) < 3:  # all are parallel
        return None
    point, *_ = np.linalg.lstsq(A, b, rcond=None)
    size = MEET * (1 + np.abs(points).max())
    return point if np.abs(A @ point - b).max() < size else None
