"""Where do motors, nacelle and sensors stand? The facade's kinematics: batches into the core."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, check_seed, numbers_of
from truepose.exceptions import InputError, PoseError, choose
from truepose.robot import explain as mechanism

if TYPE_CHECKING:
    from truepose.robotfile.schema import RobotFile
    from truepose.robotfile.sensors import Sensor

Errors = Literal["raise", "nan"]
Level = Literal["ideal", "full"]


class Conditioning(NamedTuple):
    """How far from singular a pose is: 0 singular, 1 as good as it gets."""

    parallel: Array  #: (...) inverse condition number of the rods' lines; 0: type 2, J infinite
    serial: Array  #: (..., n) share of B's motion along the rod; 0: type 1, arm and rod in line


class Kinematics:
    """The kinematic models of a :class:`truepose.Robot`, which holds what they need.

    All methods take any leading shape and run in C++.
    """

    _core: _core.Robot
    _spec: RobotFile
    _sensors: tuple[Sensor, ...]
    _values: dict[str, float]
    level: Level

    def ikm(
        self,
        x: ArrayLike,
        errors: Errors = "raise",
        level: Level | None = None,
        own_mode: bool = False,
    ) -> Array:
        """Inverse kinematic model: motor positions q that hold the pose x.

        Each chain closes in its own working mode; the pose may be of any assembly mode, unless
        `own_mode` asks. Ask before a machine is sent there: from another mode's side the motors do
        not hold the nacelle on the way. (Controllers always ask.)

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors : {"raise", "nan"}
            What to do with a pose that cannot be reached.
        level : {"ideal", "full"}, optional
            One rod per chain, or every rod by itself (see :attr:`full`); by default :attr:`level`.
        own_mode : bool
            Refuse a pose where det J_x has another sign than at home: branch lost.

        Returns
        -------
        ndarray, shape (..., n)
            q as the motor encoders read them, rad or m.

        Raises
        ------
        PoseError
            Names the pose, the chain and the reason: unreachable, or beyond a joint limit; with
            `own_mode` also branch lost, or singular.
        InputError
            Wrong shape, or values that are not finite.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> q = tp.load("h4").ikm([0, 0, -0.5, 0])
        >>> print(np.degrees(q).round(4))
        [38.9429 38.9429 38.9429 38.9429]
        """
        return self._motors(self._core, x, errors, level, own_mode)

    def _motors(
        self,
        core: _core.Robot,
        x: ArrayLike,
        errors: Errors,
        level: Level | None,
        own_mode: bool = False,
    ) -> Array:
        rows, lead = self._rows(x, self.n, "x", errors)
        q, status, chain = _core.ikm(core, rows, self._is_full(level), own_mode)
        self._check("pose", rows, lead, status, chain, errors, level=level)
        return q.reshape(*lead, self.n)

    def rkm(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Redundant kinematic model: what the sensors in use read at the pose x.

        At the full level a sensor at a bar's pivot reads the bar's own turn too, one of a rod its
        own rod of the pair.

        Returns
        -------
        ndarray, shape (..., r)
        """
        rows, lead = self._rows(x, self.n, "x", errors)
        r, status, chain = _core.rkm(self._core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors)
        return r.reshape(*lead, self.r)

    def extended(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Extended positions q_e = [q; r] at the pose x, shape (..., n + r).

        Where the robot stands, be it beyond its joint limits: it may have been pushed there.
        """
        q = self._motors(self._core.without_limits(), x, errors, level)
        return np.concatenate([q, self.rkm(x, errors, level)], axis=-1)

    def read(
        self, x: ArrayLike, seed: int = 0, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Readings as this robot's encoders and sensors give them: with noise, in counts.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses where it stands, m and rad.
        seed : int
            Of the noise; the same seed gives the same readings.
        errors, level
            As for :meth:`ikm`.

        Returns
        -------
        ndarray, shape (..., n + r)
            [q; r], in the order of :attr:`reading_sigma`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4")
        >>> print((h4.read(h4.home) / h4.resolution).round(9))
        [946. 946. 946. 946.   0.]
        """
        exact = self.extended(x, errors, level)
        rows = np.ascontiguousarray(exact.reshape(-1, self.n + self.r))
        return _core.spoil(self._core, rows, check_seed(seed)).reshape(exact.shape)

    def parasitic(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """What x leaves out: turns of the nacelle and its bars that the ideal level forbids, rad.

        Returns
        -------
        ndarray, shape (..., 6 - n + bars)
            The nacelle's tilt about x and y (of a translation robot, its turn about x, y, z), then
            each bar's turn about its pivot, against the base.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4").replace({"chain1.tilt": 0.002})
        >>> print(np.degrees(h4.parasitic(h4.home)).round(2))
        [ 0.06  0.06 -0.04 -0.04]
        """
        self._is_full("full")
        rows, lead = self._rows(x, self.n, "x", errors)
        rest, status, chain = _core.parasitic(self._core, rows)
        self._check("pose", rows, lead, status, chain, errors)
        return rest.reshape(*lead, rest.shape[-1])

    def fkm(
        self,
        q: ArrayLike,
        guess: ArrayLike | None = None,
        errors: Errors = "raise",
        level: Level | None = None,
    ) -> Array:
        """Forward kinematic model: the pose, from the motor encoders alone.

        Newton's method in the tangent space of the pose, with bounded iterations. Where it finds no
        pose of the robot's own from the guess, it goes again from home, the motors in four stages
        (at the ideal level).

        Parameters
        ----------
        q : array_like, shape (..., n)
            Motor positions, rad or m.
        guess : array_like, shape (n,) or (..., n), optional
            Where to start; the file's home pose by default.
        errors : {"raise", "nan"}
            What to do where no pose is found.
        level : {"ideal", "full"}, optional
            One rod per chain, or every rod by itself (see :attr:`full`); by default :attr:`level`.

        Returns
        -------
        ndarray, shape (..., n)

        Raises
        ------
        PoseError
            unreachable: no pose closes the loops, which is known (two rods cannot be joined, the
            spheres of a translation robot do not meet, a leg has no length); not converged: none
            was found, and whether there is one is open; singular: the motors do not determine it;
            branch lost: it closes in another working or assembly mode than the robot's.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> x = robot.fkm(robot.ikm([0.05, -0.02, -0.42, 0.3]))
        >>> print(x.round(9))
        [ 0.05 -0.02 -0.42  0.3 ]
        """
        rows, lead = self._rows(q, self.n, "q", errors)
        start = self._guesses(guess, lead, errors)
        full = self._is_full(level)
        x, status, chain, _, _ = _core.fkm(self._core, rows, start, full)
        self._check("motor position", rows, lead, status, chain, errors, name="q")
        return x.reshape(*lead, self.n)

    def jacobian(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Jacobian J, dx = J dq (spatial: dx a twist in the base frame), shape (..., n, n)."""
        rows, lead = self._rows(x, self.n, "x", errors)
        J, status, chain = _core.jacobian(self._core, rows, self._is_full(level))
        self._check("pose", rows, lead, status, chain, errors)
        return J.reshape(*lead, self.n, self.n)

    def conditioning(self, x: ArrayLike, errors: Errors = "raise") -> Conditioning:
        """How far from singular the robot is at x, free of its size and of its units, 0 to 1.

        Examples
        --------
        >>> import truepose as tp
        >>> parallel, serial = tp.load("h4").conditioning([0.05, 0, -0.4, 0.2])
        >>> round(float(parallel), 3), serial.round(3).tolist()
        (0.813, [0.854, 0.914, 0.873, 0.887])
        """
        rows, lead = self._rows(x, self.n, "x", errors)
        values, status, chain = _core.conditioning(self._core, rows)
        self._check("pose", rows, lead, status, chain, errors)
        return Conditioning(values[:, 0].reshape(lead), values[:, 1:].reshape(*lead, self.n))

    def skeleton(self, x: ArrayLike) -> Array:
        """Points of every chain at one pose, shape (n, 4, 3), m, base frame.

        P on the motor's axis, B at the arm's end, A at the rod's other end, C the pivot on the
        nacelle that carries A (A itself where there is no bar).
        """
        rows, lead = self._rows(x, self.n, "x", "raise")
        if lead:
            raise InputError(f"x: shape {(*lead, self.n)}, must be ({self.n},)")
        points, status, chain = _core.skeleton(self._core, [*rows[0], *[0.0] * (6 - self.n)])
        self._check("pose", rows, (), np.array([status]), np.array([chain]), "raise")
        return points

    def _guesses(self, guess: ArrayLike | None, lead: tuple[int, ...], errors: Errors) -> Array:
        start = self.home if guess is None else numbers_of(guess, "guess")
        try:
            start = np.broadcast_to(start, (*lead, self.n))
        except ValueError:
            shapes = f"({self.n},) or {(*lead, self.n)}, one for each reading"
            raise InputError(f"guess: wrong shape, must be {shapes}") from None
        return self._rows(start, self.n, "guess", errors)[0]

    def _is_full(self, level: Level | None) -> bool:
        """Whether `level` asks for every rod by itself; it must exist. None: the robot's own."""
        if level is None:
            return self.level == "full"
        if level not in ("ideal", "full"):
            raise InputError(choose("level", level, ("ideal", "full")))
        if level == "full" and not self.full:
            raise InputError(f"{self.name}: level='full': {self.full.reason}")
        return level == "full"

    def _rows(self, values: ArrayLike, width: int, name: str, errors: Errors):
        """Check the shape and flatten the leading axes: (N, width) in C order."""
        if errors not in ("raise", "nan"):
            raise InputError(choose("errors", errors, ("raise", "nan")))
        array = numbers_of(values, name)
        if array.ndim == 0 or array.shape[-1] != width:
            raise InputError(f"{name}: shape {array.shape}, must be (..., {width}) for {self.name}")
        if errors == "raise" and not np.isfinite(array).all():
            bad = array.reshape(-1, width)[~np.isfinite(array.reshape(-1, width)).all(axis=-1)][0]
            raise InputError(f"{name} = {_list(bad)}: must be finite numbers")
        return np.ascontiguousarray(array.reshape(-1, width)), array.shape[:-1]

    def _check(
        self, what, rows, lead, status, chain, errors, name="x", level: Level | None = None
    ) -> None:
        if errors == "nan" or not (status > 0).any():  # below 0: an answer, with a warning
            return
        k = int(np.flatnonzero(status > 0)[0])
        index = f" {tuple(int(i) for i in np.unravel_index(k, lead))}" if lead else ""
        guilty = f"chain {chain[k] + 1}: " if chain[k] >= 0 else ""
        beyond = ""
        if status[k] == _core.joint_limit:
            full = self._is_full(level)
            beyond = ", " + mechanism.beyond(self._core, self._spec, rows[k], int(chain[k]), full)
        raise PoseError(
            f"{self.name}: {what}{index} {name} = {_list(rows[k])}: "
            f"{guilty}{_core.describe(int(status[k]))}{beyond}"
        )


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values) + "]"
