"""Rigid bodies of a model, and the links and loops between them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.linalg import inv
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.exceptions import InputError, choose

#: m, plus this share of the model's size; axes that pass each other nearer than that meet.
MEET = 1e-6
FREE, BALL, SLIDE, HINGE = range(4)  #: MuJoCo's kinds of joints


@dataclass(eq=False)
class Link:
    """Connection of two rigid bodies: a joint, joints about one point, or a loop's closing point.

    All vectors are in the world frame, with every joint at zero.
    """

    name: str  #: of its first joint, or of the closure
    bodies: tuple[int, int]  #: the one towards the world first; for a closure in its own order
    points: Array  #: (2, 3) position of the link on each body
    axes: Array  #: (k, 3) axes of rotation, or direction of a slide
    ids: tuple[int, ...] = ()  #: of its joints
    kind: int = BALL  #: MuJoCo's; of joints about one point BALL

    @property
    def slides(self) -> bool:
        """Whether it is a slide."""
        return self.kind == SLIDE

    @property
    def turns(self) -> int:
        """Number of rotations about its point."""
        return len(self.axes) if self.kind in (BALL, HINGE) else 0

    def other(self, body: int) -> int:
        """Return the other body."""
        return self.bodies[1 - self.bodies.index(body)]

    def point_on(self, body: int) -> Array:
        """Return the link's position on a body."""
        return self.points[self.bodies.index(body)]


class Mechanism:
    """Rigid bodies and links between them; a body has the number of its first part.

    Between two joints of one body is a body without parts, of a number beyond those of the model.
    """

    def __init__(self, model: mujoco.MjModel, path: Path):
        kinds, whole = mujoco.mjtEq, np.eye(4)
        self.model, self.source = model, path.name
        self.name = model.names[: model.names.index(b"\0")].decode() or path.stem
        self.data = data = mujoco.MjData(model)  #: every joint at zero
        data.qpos[model.jnt_qposadr[np.isin(model.jnt_type, (SLIDE, HINGE))]] = 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        self.actuators = dict[int, list[int]]()  #: of each driven joint
        # MuJoCo's transmissions 0 and 1 are those of a joint.
        for k in np.flatnonzero(model.actuator_trntype <= 1).tolist():
            self.actuators.setdefault(int(model.actuator_trnid[k, 0]), []).append(k)
        #: Joints that an equality couples, and its name.
        coupling = _equalities(model, kinds.mjEQ_JOINT)
        self.coupled = {joint: name for _, name, ids in coupling for joint in ids}
        #: Rigid body of each of MuJoCo's bodies: the number of its first part.
        self.body_of = np.arange(model.nbody)
        # Displacement of each at zero: parts of a loop may be apart there.
        self._put = np.tile(whole, (model.nbody, 1, 1))
        frames = self._put.copy()
        frames[:, :3, :3], frames[:, :3, 3] = data.xmat.reshape(-1, 3, 3), data.xpos
        jointed = [body for body in range(model.nbody) if model.body_jntnum[body]]
        for body in {*range(1, model.nbody)} - {*jointed}:
            self._join(int(model.body_parentid[body]), body, whole)
        for _, (a, b), (first, second) in _closures(model, kinds.mjEQ_WELD):
            self._join(a, b, frames[a] @ first @ inv(second) @ inv(frames[b]))
        self.links = [link for body in jointed for link in self._joints(body)]
        for name, bodies, places in _closures(model, kinds.mjEQ_CONNECT):
            at = [(frames[b] @ place)[:3, 3] for b, place in zip(bodies, places, strict=True)]
            ends = self._drawn(bodies, at)
            self.links.append(Link(name, self._pair(bodies), ends, np.eye(3)))
        moved = (np.abs(self._put - whole) > MEET).any(axis=(1, 2))
        #: Rigid bodies joined by a loop of parts apart at zero.
        self.moved = {*self.body_of[moved].tolist()}

    def _pair(self, bodies: tuple[int, int]) -> tuple[int, int]:
        """Return the rigid bodies of two bodies."""
        first, second = self.body_of[[*bodies]].tolist()
        return first, second

    def _drawn(self, bodies: Iterable[int], points: Sequence[Array]) -> Array:
        """Return a point of each body after the body's displacement."""
        moved = zip(self._put[[*bodies]], points, strict=True)
        return np.array([T[:3, :3] @ point + T[:3, 3] for T, point in moved])

    def _join(self, a: int, b: int, step: Array) -> None:
        """Join two bodies; `step`, (4, 4), moves b from its pose at zero to where a holds it."""
        low, high = sorted(self._pair((a, b)))
        if low == high:
            return
        motion = self._put[a] @ step @ inv(self._put[b])
        moved = self.body_of == high
        self._put[moved] = (inv(motion) if self.body_of[b] == low else motion) @ self._put[moved]
        self.body_of[moved] = low

    def body(self, name: str) -> int:
        """Return the number of the named body in MuJoCo's model."""
        names = [self.name_of(k) for k in range(self.model.nbody)]
        if name not in names:
            raise InputError(choose("body", name, names[1:]))
        return names.index(name)

    def name_of(self, body: int) -> str:
        """Return a body's name."""
        return (body < self.model.nbody and self.model.body(body).name) or f"body {body}"

    def at(self, body: int, but: Link | None = None) -> list[Link]:
        """Return a body's links, without `but`."""
        return [link for link in self.links if body in link.bodies and link is not but]

    def _joints(self, body: int) -> Iterator[Link]:
        """Yield the links of the joints of one of MuJoCo's bodies."""
        model, data, parent = self.model, self.data, int(self.model.body_parentid[body])
        first, (low, high) = int(model.body_jntadr[body]), self._pair((parent, body))
        last = first + model.body_jntnum[body] - 1
        for k in range(first, last + 1):
            upper = high if k == last else model.nbody + k
            kind, name = int(model.jnt_type[k]), model.joint(k).name or f"joint {k + 1}"
            points = self._drawn((parent if k == first else body, body), [data.xanchor[k]] * 2)
            axes = np.eye(3) if kind == BALL else data.xaxis[k : k + 1]
            yield Link(name, (low, upper), points, axes, (k,), kind)
            low = upper


def _equalities(model: mujoco.MjModel, kind: Any) -> Iterator[tuple[int, str, tuple[int, int]]]:
    """Yield number, name and both objects of the active equalities of a kind."""
    for k in np.flatnonzero((model.eq_type == int(kind)) & model.eq_active0).tolist():
        name = model.equality(k).name or f"equality {k + 1}"
        yield k, name, (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))


def _closures(model: mujoco.MjModel, kind: Any) -> Iterator[tuple[str, tuple[int, int], list]]:
    """Yield name and bodies of closures, and the places on both, (4, 4), that coincide."""
    for k, name, bodies in _equalities(model, kind):
        if model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
            places = [_frame(model.site_pos[i], model.site_quat[i]) for i in bodies]
            a, b = model.site_bodyid[[*bodies]].tolist()
            yield name, (a, b), places
        elif kind == mujoco.mjtEq.mjEQ_WELD:
            yield name, bodies, [_frame(*np.split(model.eq_data[k, 3:10], [3])), np.eye(4)]
        else:
            yield name, bodies, [_frame(at) for at in model.eq_data[k, :6].reshape(2, 3)]


def _frame(position: Array, turn: ArrayLike = (1, 0, 0, 0)) -> Array:
    """Return a homogeneous matrix, (4, 4), of a position and a quaternion."""
    frame, R = np.eye(4), np.empty(9)
    mujoco.mju_quat2Mat(R, np.asarray(turn, dtype=float))
    frame[:3, 3], frame[:3, :3] = position, R.reshape(3, 3)
    return frame


def meeting(points: Array, axes: Array) -> Array | None:
    """Return the common point of lines, shape (3,); None if there is none or all are parallel."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    A, b = across.reshape(-1, 3), (across @ points[..., None]).reshape(-1)
    if np.linalg.matrix_rank(A, tol=1e-6) < 3:  # all are parallel
        return None
    point, *_ = np.linalg.lstsq(A, b, rcond=None)
    size = MEET * (1 + np.abs(points).max())
    return point if np.abs(A @ point - b).max() < size else None
