"""Kinematics: IKM, FKM, RKM and their Jacobians, in batches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, check_seed, numbers_of
from truepose.exceptions import InputError
from truepose.robot import compliance
from truepose.robot.batches import at_poses, flattened, require_answers
from truepose.robot.compliance import Loaded
from truepose.robotfile.schema import is_compliance
from truepose.robotfile.to_core import columns, padded


class Conditioning(NamedTuple):
    """How far from singular a pose is: 0 singular, 1 as good as it gets."""

    parallel: Array  #: (...) inverse condition number of the rods' lines; 0: type 2, J infinite
    serial: Array  #: (..., n) share of B's motion along the rod; 0: type 1, arm and rod in line


class Kinematics(Loaded):
    """The kinematic models of a :class:`truepose.Robot`.

    All methods take any leading shape and run in C++. Where a robot's rods deflect under what they
    carry (:attr:`compliance`), poses and readings are those under load; Jacobians along the pose
    leave out that tension changes with it: a share of the strain.
    """

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
        return self._motors(self.core, x, errors, level, own_mode)

    def _motors(
        self,
        core: _core.Robot,
        x: ArrayLike,
        errors: Errors,
        level: Level | None,
        own_mode: bool = False,
    ) -> Array:
        full = self.is_full(level)
        (q,) = at_poses(self, x, errors, _core.ikm, full, own_mode, core=core, level=level)
        return q + self._given_way(x, errors, full)[..., : self.n] if self.is_compliant else q

    def _given_way(self, x: ArrayLike, errors: Errors, full: bool) -> Array:
        """Differences of the readings under load, (..., n + r)."""
        rows, lead = flattened(self, x, self.n, "x", errors)
        by = compliance.given_way(self, rows, full)
        require_answers(self, "pose", rows, lead, by.status, by.chain, errors)
        return by.readings.reshape(*lead, self.n + self.r)

    def rkm(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Redundant kinematic model: readings of the sensors in use at the pose x.

        At the full level a sensor at a bar's pivot reads the bar's own turn too, one of a rod its
        own rod of the pair.

        Returns
        -------
        ndarray, shape (..., r)
        """
        full = self.is_full(level)
        (r,) = at_poses(self, x, errors, _core.rkm, full)
        return r + self._given_way(x, errors, full)[..., self.n :] if self.is_compliant else r

    def extended_positions(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Extended positions q_e = [q; r] at the pose x, shape (..., n + r).

        Where the robot stands, be it beyond its joint limits: it may have been pushed there.
        """
        q = self._motors(self.core.without_limits(), x, errors, level)
        return np.concatenate([q, self.rkm(x, errors, level)], axis=-1)

    def read(
        self, x: ArrayLike, seed: int = 0, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Simulate readings of this robot's encoders and sensors: with noise, in counts.

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
        exact = self.extended_positions(x, errors, level)
        rows = np.ascontiguousarray(exact.reshape(-1, self.n + self.r))
        spoilt = np.asarray(_core.spoil(self.core, rows, check_seed(seed)))
        return spoilt.reshape(exact.shape)

    def residual_motion(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Residual motion: turns of the nacelle and its bars that the ideal level excludes, rad.

        Returns
        -------
        ndarray, shape (..., 6 - n + bars)
            The nacelle's tilt about x and y (of a translation robot, its turn about x, y, z), then
            each bar's turn about its pivot, against the base.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4").replace({"chain1.tilt": 0.002})
        >>> print(np.degrees(h4.residual_motion(h4.home)).round(2))
        [ 0.06  0.06 -0.04 -0.04]
        """
        self.is_full("full")
        return at_poses(self, x, errors, _core.parasitic)[0]

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
        rows, lead = flattened(self, q, self.n, "q", errors)
        start = self._guesses(guess, lead, errors)
        full = self.is_full(level)

        def answer(q: Array, near: Array | None) -> compliance.Answer:
            begin = start if near is None else np.ascontiguousarray(near)
            return _core.fkm(self.core, np.ascontiguousarray(q), begin, full)[:3]

        x, status, chain = compliance.at_rest(self, rows, full, answer)
        require_answers(self, "motor position", rows, lead, status, chain, errors, name="q")
        return x.reshape(*lead, self.n)

    def jacobian(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Jacobian J, dx = J dq (spatial: dx a twist in the base frame), shape (..., n, n)."""
        return at_poses(self, x, errors, _core.jacobian, self.is_full(level))[0]

    def gyro(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Map W of a gyroscope on the nacelle: ω = W ẋ, in the nacelle's frame.

        Of a pivot ẋ are the axes' rates, so that those follow from ω: ẋ = W⁺ω, and the motors'
        from them, q̇ = J⁻¹ẋ. Of others ẋ is the free twist. A base that turns itself, as a shank
        does, adds its own angular velocity, seen from the nacelle: subtract it first.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors
            As for :meth:`ikm`.

        Returns
        -------
        ndarray, shape (..., 3, n)

        Examples
        --------
        >>> import numpy as np
        >>> import truepose as tp
        >>> ankle = tp.load("g1-ankle")
        >>> W = ankle.gyro([0.2, 0.1])
        >>> omega = W @ [0.5, -0.3]  # pitch and roll at 0.5 and -0.3 rad/s
        >>> (np.linalg.pinv(W) @ omega).round(6).tolist()
        [0.5, -0.3]
        """
        return at_poses(self, x, errors, _core.gyro)[0]

    def joint_torque(
        self, x: ArrayLike, torque: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Joint torques of a pivot under motor torques: Γ = J⁻ᵀ τ, Γᵀẋ = τᵀq̇.

        Of another mobility the force and moment that they exert on the nacelle, along its free
        twist.

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        torque : array_like, shape (..., n)
            Of the motors, N·m or N; leading shapes broadcast.
        errors, level
            As for :meth:`ikm`.

        Returns
        -------
        ndarray, shape (..., n)

        Examples
        --------
        >>> import truepose as tp
        >>> ankle = tp.load("g1-ankle")
        >>> print(ankle.joint_torque([0.1, 0.05], [10, 10]).round(2))  # pitch, roll
        [ 0.81 19.17]
        """
        J, given = self._mapping(x, torque, errors, level)
        return np.linalg.solve(J.swapaxes(-1, -2), given)[..., 0]

    def motor_torque(
        self, x: ArrayLike, torque: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Motor torques for joint torques of a pivot: τ = Jᵀ Γ.

        The inverse of :meth:`joint_torque`.

        Examples
        --------
        >>> import truepose as tp
        >>> ankle = tp.load("g1-ankle")
        >>> print(ankle.motor_torque([0.1, 0.05], [30.0, 0.0]).round(2))  # toes down
        [-11.36  10.07]
        """
        J, given = self._mapping(x, torque, errors, level)
        return (J.swapaxes(-1, -2) @ given)[..., 0]

    def _mapping(
        self, x: ArrayLike, torque: ArrayLike, errors: Errors, level: Level | None
    ) -> tuple[Array, Array]:
        """J and the torques that it is to map, (..., n, 1), of one leading shape."""
        J = self.jacobian(x, errors, level)
        values, other = flattened(self, torque, self.n, "torque", errors)
        try:
            lead = np.broadcast_shapes(J.shape[:-2], other)
        except ValueError:
            shapes = f"x {J.shape[:-1]}, torque {(*other, self.n)}"
            raise InputError(f"{shapes}: leading shapes must broadcast") from None
        values = np.broadcast_to(values.reshape(*other, self.n), (*lead, self.n))
        return np.broadcast_to(J, (*lead, self.n, self.n)), values[..., None]

    def conditioning(self, x: ArrayLike, errors: Errors = "raise") -> Conditioning:
        """Distance from singularities at x, independent of size and units, 0 to 1.

        Examples
        --------
        >>> import truepose as tp
        >>> parallel, serial = tp.load("h4").conditioning([0.05, 0, -0.4, 0.2])
        >>> round(float(parallel), 3), serial.round(3).tolist()
        (0.813, [0.854, 0.914, 0.873, 0.887])
        """
        (values,) = at_poses(self, x, errors, _core.conditioning)
        return Conditioning(values[..., 0], values[..., 1:])

    def skeleton(self, x: ArrayLike) -> Array:
        """Points of every chain at one pose, shape (n, 4, 3), m, base frame.

        P on the motor's axis, B at the arm's end, A at the rod's other end, C the pivot on the
        nacelle that carries A (A itself where there is no bar).
        """
        rows, lead = flattened(self, x, self.n, "x", "raise")
        if lead:
            raise InputError(f"x: shape {(*lead, self.n)}, must be ({self.n},)")
        points, status, chain = _core.skeleton(self.core, padded(rows[0]))
        require_answers(self, "pose", rows, (), np.array([status]), np.array([chain]), "raise")
        return points

    def _guesses(self, guess: ArrayLike | None, lead: tuple[int, ...], errors: Errors) -> Array:
        start = self.home if guess is None else numbers_of(guess, "guess")
        try:
            start = np.broadcast_to(start, (*lead, self.n))
        except ValueError:
            shapes = f"({self.n},) or {(*lead, self.n)}, one for each reading"
            raise InputError(f"guess: wrong shape, must be {shapes}") from None
        return flattened(self, start, self.n, "guess", errors)[0]

    def linearize(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> tuple[Array, Array]:
        """Jacobians of all readings q_e = [q; r] at the pose x, the motors holding it.

        At the full level what x leaves out follows too: the nacelle's tilt, its bars' turns.

        Returns
        -------
        H_x : ndarray, shape (..., n + r, n)
            ∂q_e/∂x along the free twist; its first n rows are J⁻¹, the others J_r.
        H_xi : ndarray, shape (..., n + r, p)
            ∂q_e/∂ξ at fixed x, one column for each of the p names of :attr:`parameters`, in
            their order; columns of sensors not in use are zero.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> H_x, H_xi = robot.linearize([0.05, 0, -0.4, 0.2])
        >>> names = list(robot.parameters)
        >>> bool((H_xi[:4, names.index("chain2.encoder_offset")] == [0, -1, 0, 0]).all())
        True
        """
        rows, lead = flattened(self, x, self.n, "x", errors)
        H_x, core, status, chain = _core.linearise(self.core, rows, self.is_full(level))
        require_answers(self, "pose", rows, lead, status, chain, errors)
        names = list(self._values)
        H = np.zeros((*core.shape[:2], len(names)))
        for name, column in columns(self._spec):
            if name in self._values:
                H[..., names.index(name)] = core[..., column]
        if self._spec.stretches:
            by = compliance.under_load(self, rows, self.is_full(level))
            require_answers(self, "pose", rows, lead, by.status, by.chain, errors)
            of_load = [name for name in names if is_compliance(name)]
            at = [names.index(name) for name in of_load]
            H[..., at] = compliance.columns(self, of_load, by.by_compliance)
        size = self.n + self.r
        return H_x.reshape(*lead, size, self.n), H.reshape(*lead, size, len(names))
