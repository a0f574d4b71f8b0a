"""Rigid bodies of a model, and the links and loops between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose

#: m, plus this share of the model's size; axes that pass each other nearer than that meet.
MEET = 1e-6


@dataclass
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


@dataclass
class Mechanism:
    """Rigid bodies and links between them; a body has the number of its first part."""

    name: str
    source: str  #: the file's name
    model: Any  #: MuJoCo's model
    data: Any  #: MuJoCo's data, with every joint at zero
    body_of: list[int]  #: rigid body of each of MuJoCo's bodies
    links: list[Link]
    hinges: set[int]  #: joints that are hinges
    motors: set[int]  #: driven joints
    moved: set[int]  #: rigid bodies joined by a loop from parts that are apart at zero
    coupled: dict[int, str] = field(default_factory=dict)  #: joints that an equality couples
    actuators: dict[int, list[int]] = field(default_factory=dict)  #: by joint

    def body(self, name: str) -> int:
        """Return the rigid body that contains the named body."""
        names = [self.model.body(k).name for k in range(self.model.nbody)]
        if name not in names:
            raise InputError(choose("body", name, names[1:]))
        return self.body_of[names.index(name)]

    def name_of(self, body: int) -> str:
        """Return a body's name."""
        return self.model.body(body).name or f"body {body}"

    def at(self, body: int, but: Link | None = None) -> list[Link]:
        """Return a body's links, without `but`."""
        return [link for link in self.links if body in link.bodies and link is not but]


@dataclass(frozen=True)
class Closure:
    """Closure of a loop: by a point, or by a whole frame if `held` is given."""

    name: str
    bodies: tuple[int, ...]
    points: Array  #: (2, 3) at zero
    held: tuple[Array, Array] | None  #: position and orientation of the second body in the first


class _Bodies:
    """Rigid bodies formed of MuJoCo's bodies; parts that are apart at zero are moved together."""

    def __init__(self, count: int):
        self._part = list(range(count))
        self._put = [(np.zeros(3), np.eye(3))] * count  #: displacements from the poses at zero

    def of(self, body: int) -> int:
        """Return the number of the rigid body that contains a body."""
        while self._part[body] != body:
            body = self._part[body]
        return body

    def pair(self, bodies: Sequence[int]) -> tuple[int, int]:
        """Return the rigid bodies of two bodies."""
        return self.of(bodies[0]), self.of(bodies[1])

    def drawn(self, bodies: Sequence[int], points: Array) -> Array:
        """Return a point of each body after the body's displacement."""
        put = [self._put[body] for body in bodies]
        return np.array([t + R @ p for (t, R), p in zip(put, points, strict=True)])

    def moved(self) -> set[int]:
        """Return the rigid bodies with a displaced part."""
        return {
            self.of(k)
            for k, (t, R) in enumerate(self._put)
            if np.abs(t).max() > MEET or np.abs(R - np.eye(3)).max() > MEET
        }

    def join(
        self,
        a: int,
        b: int,
        wanted: tuple[Array, Array] | None = None,
        is_: tuple[Array, Array] | None = None,
    ) -> None:
        """Join two bodies; if given, move b so that its frame `is_` coincides with a's `wanted`."""
        low, high = sorted((self.of(a), self.of(b)))
        if low == high:
            return
        if wanted is not None and is_ is not None:
            (tw, Rw), (ta, Ra) = self._place(a, wanted), self._place(b, is_)
            R = Rw @ Ra.T  # moves b to its wanted pose
            t = tw - R @ ta
            if self.of(b) == low:  # a moves instead
                R, t = R.T, -R.T @ t
            for k in range(len(self._part)):
                if self.of(k) == high:
                    p, Q = self._put[k]
                    self._put[k] = t + R @ p, R @ Q
        self._part[high] = low

    def _place(self, body: int, frame: tuple[Array, Array]) -> tuple[Array, Array]:
        t, R = self._put[body]
        return t + R @ frame[0], R @ frame[1]


class Model:
    """A compiled model with all joints at zero."""

    def __init__(self, mujoco: Any, model: Any):
        self.mujoco, self.model = mujoco, model
        self.data = mujoco.MjData(model)
        scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        for k in range(model.njnt):
            if int(model.jnt_type[k]) in scalar:
                self.data.qpos[model.jnt_qposadr[k]] = 0.0  # at qpos0 it may have any value
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)

    def actuators(self) -> dict[int, list[int]]:
        """Return the actuators of each driven joint."""
        kinds, found = self.mujoco.mjtTrn, dict[int, list[int]]()
        for k, kind in enumerate(self.model.actuator_trntype):
            if int(kind) in (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)):
                found.setdefault(int(self.model.actuator_trnid[k, 0]), []).append(k)
        return found

    def closures(self) -> Iterator[Closure]:
        """Yield the closure of every loop equality."""
        model, data, eq = self.model, self.data, self.mujoco.mjtEq
        for k in range(model.neq):
            weld = model.eq_type[k] == eq.mjEQ_WELD
            if not (weld or model.eq_type[k] == eq.mjEQ_CONNECT) or not model.eq_active0[k]:
                continue
            ids = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            sited = model.eq_objtype[k] == self.mujoco.mjtObj.mjOBJ_SITE
            bodies = tuple(int(model.site_bodyid[i]) for i in ids) if sited else ids
            held = None
            if sited:
                points = data.site_xpos[list(ids)]
                frames = [data.site_xmat[i].reshape(3, 3) for i in ids]
                if weld:  # the sites' frames coincide; of the second body in that of the first
                    body = [self.frame(b) for b in bodies]
                    R = body[0][1].T @ frames[0] @ frames[1].T @ body[1][1]
                    at = points[0] + frames[0] @ frames[1].T @ (body[1][0] - points[1])
                    held = body[0][1].T @ (at - body[0][0]), R
            else:
                on = (model.eq_data[k, 0:3], model.eq_data[k, 3:6])
                frames_of = [self.frame(b) for b in bodies]
                points = np.array([p + R @ a for (p, R), a in zip(frames_of, on, strict=True)])
                if weld:
                    R = np.zeros(9)
                    self.mujoco.mju_quat2Mat(R, model.eq_data[k, 6:10])
                    held = model.eq_data[k, 3:6], R.reshape(3, 3)
            name = model.equality(k).name or f"equality {k + 1}"
            yield Closure(name, bodies, np.array(points), held)

    def frame(self, body: int) -> tuple[Array, Array]:
        """Return a body's position and orientation, every joint at zero."""
        return self.data.xpos[body], self.data.xmat[body].reshape(3, 3)

    def mechanism(
        self, path: Path, closures: list[Closure], motors: set[int], retyped: dict[int, str]
    ) -> Mechanism:
        """Join bodies that move as one; the remaining links connect rigid bodies."""
        model = self.model
        bodies = _Bodies(model.nbody)
        fixed = {k for k, axes in retyped.items() if not axes}
        joints = [
            [k for k in range(first, first + count) if k not in fixed]
            for first, count in zip(model.body_jntadr, model.body_jntnum, strict=True)
        ]
        for body in range(1, model.nbody):
            if not joints[body]:
                bodies.join(body, int(model.body_parentid[body]))
        for closure in closures:
            if closure.held is not None:
                a, b = closure.bodies
                (p, R), (t, Q) = self.frame(a), closure.held
                bodies.join(a, b, (p + R @ t, R @ Q), self.frame(b))
        links = [
            self._link(ids, (int(model.body_parentid[body]), body), bodies, retyped)
            for body, ids in enumerate(joints)
            if ids
        ]
        links += [
            Link(c.name, bodies.pair(c.bodies), points, np.eye(3), np.tile(points[0], (3, 1)))
            for c in closures
            if c.held is None and len(points := bodies.drawn(c.bodies, c.points))
        ]
        eq = self.mujoco.mjtEq
        coupled: dict[int, str] = {}
        for k in range(model.neq):
            if model.eq_type[k] == eq.mjEQ_JOINT and model.eq_active0[k]:
                name = model.equality(k).name or f"equality {k + 1}"
                coupled |= {int(i): name for i in (model.eq_obj1id[k], model.eq_obj2id[k])}
        name = model.names[: model.names.index(b"\0")].decode() or path.stem
        body_of = [bodies.of(body) for body in range(model.nbody)]
        hinge = int(self.mujoco.mjtJoint.mjJNT_HINGE)
        hinges = {k for k in range(model.njnt) if model.jnt_type[k] == hinge and k not in retyped}
        return Mechanism(
            name=name,
            source=path.name,
            model=model,
            data=self.data,
            body_of=body_of,
            links=links,
            hinges=hinges,
            motors=motors,
            moved=bodies.moved(),
            coupled=coupled,
            actuators=self.actuators(),
        )

    def _link(
        self, ids: Sequence[int], pair: tuple[int, int], bodies: _Bodies, retyped: dict[int, str]
    ) -> Link:
        """Return one link of all joints of one of MuJoCo's bodies."""
        model, data, kinds = self.model, self.data, self.mujoco.mjtJoint
        first = ids[0]
        axes, anchors, types = [], [], set()
        for k in ids:
            frame = data.xmat[model.jnt_bodyid[k]].reshape(3, 3)
            types.add(int(model.jnt_type[k]))
            if k in retyped:
                turned = [frame[:, "XYZ".index(c)] for c in retyped[k]]
            elif model.jnt_type[k] == kinds.mjJNT_BALL:
                turned = list(frame.T)
            else:
                turned = [data.xaxis[k]]
            axes += turned
            anchors += [data.xanchor[k]] * len(turned)
        point = meeting(np.array(anchors), np.array(axes)) if len(axes) > 1 else anchors[0]
        at = anchors[0] if point is None else point
        put = bodies.drawn([pair[0]] * len(anchors), np.array(anchors))
        return Link(
            name=model.joint(first).name or f"joint {first + 1}",
            bodies=bodies.pair(pair),
            points=bodies.drawn(pair, np.array([at, at])),
            axes=np.array(axes),
            anchors=put,
            slides=types == {int(kinds.mjJNT_SLIDE)} and len(ids) == 1,
            loose=point is None
            or int(kinds.mjJNT_FREE) in types
            or (int(kinds.mjJNT_SLIDE) in types and len(ids) > 1),
            ids=tuple(ids),
        )


def meeting(points: Array, axes: Array) -> Array | None:
    """Return the common point of lines, shape (3,); None if there is none or all are parallel."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    A, b = across.reshape(-1, 3), (across @ points[..., None]).reshape(-1)
    if np.linalg.matrix_rank(A, tol=1e-6) < 3:  # all are parallel
        return None
    point, *_ = np.linalg.lstsq(A, b, rcond=None)
    size = MEET * (1 + np.abs(points).max())
    return point if np.abs(A @ point - b).max() < size else None
