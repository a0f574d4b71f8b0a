"""Kinematics in batches: IKM, FKM, RKM, their Jacobians, readings."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level, check_seed, numbers_of
from truepose.exceptions import InputError
from truepose.robot import compliance
from truepose.robot.batches import as_row, at_poses, flattened, require_answers
from truepose.robot.description import Description
from truepose.robotfile.base import is_compliance
from truepose.robotfile.to_core import columns


class Conditioning(NamedTuple):
    """Distance of a pose from singularities: 0 singular, 1 best."""

    parallel: Array  #: (...) inverse condition number of the rods' lines; 0: type 2, J infinite
    serial: Array  #: (..., m) share of B's motion along the rod; 0: type 1, arm and rod in line


class Kinematics(Description):
    """The models of a :class:`truepose.Robot` that need no redundant reading.

    All methods take any leading shape and run in C++. For compliant rods (:attr:`compliance`) poses
    and readings are those under load; Jacobians neglect the tension's change with the pose, a
    fraction of the strain.
    """

    def ikm(
        self,
        x: ArrayLike,
        errors: Errors = "raise",
        level: Level | None = None,
        own_mode: bool = False,
    ) -> Array:
        """Inverse kinematic model: compute motor positions q, (..., m), rad or m, of the pose x.

        Each chain closes in its own working mode; the pose may be in any assembly mode. Set
        `own_mode` before commanding a machine: the motors do not hold the platform on the way to a
        pose of another sign of det J_x. (Controllers always check.)

        Parameters
        ----------
        x : array_like, shape (..., n)
            Poses, m and rad.
        errors : {"raise", "nan"}
            Action at a pose that cannot be reached.
        level : {"ideal", "full"}, optional
            One rod per chain, or every rod (see :attr:`full`); by default :attr:`level`.
        own_mode : bool
            Refuse a pose where det J_x has another sign than at home: branch lost.

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
        full = self.is_full(level)
        (q,) = at_poses(self, x, errors, _core.ikm, full, own_mode, level=level)
        return self._under_load(q, x, errors, full, slice(self.m))

    def _under_load(
        self, readings: Array, x: ArrayLike, errors: Errors, full: bool, part: slice
    ) -> Array:
        """Add the deflection to stiff rods' readings, `part` of q_e."""
        if not self.is_compliant:
            return readings
        by, *_ = at_poses(self, x, errors, lambda _, rows: compliance.given_way(self, rows, full))
        return readings + by[..., part]

    def rkm(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Redundant kinematic model: compute the readings of the sensors in use, (..., r), at x.

        At the full level a sensor at a bar's hinge also reads the bar's rotation, and a rod's
        sensor its own rod of the pair.
        """
        return self.extended_positions(x, errors, level)[..., self.m :]

    def extended_positions(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Compute the extended positions q_e = [q; r] at the pose x, shape (..., m + r).

        Joint limits are not checked: the robot may have been pushed beyond them.
        """
        full = self.is_full(level)
        (q_e,) = at_poses(self, x, errors, _core.extended, full)
        return self._under_load(q_e, x, errors, full, slice(None))

    def read(
        self, x: ArrayLike, seed: int = 0, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Simulate readings [q; r], (..., m + r), with noise, backlash and quantization.

        The same `seed` gives the same noise; true poses x, errors and level as for :meth:`ikm`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> h4 = tp.load("h4")
        >>> print((h4.read(h4.home) / h4.resolution).round(9))
        [946. 946. 946. 946.   0.]
        """
        exact = self.extended_positions(x, errors, level)
        rows = exact.reshape(-1, self.m + self.r)
        if self.backlash.any():  # approached from either side
            sides = np.random.default_rng([seed, 1]).choice((-0.5, 0.5), rows.shape)
            rows = rows + sides * self.backlash
        return np.asarray(_core.spoil(self.core, rows, check_seed(seed))).reshape(exact.shape)

    def residual_motion(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Compute the rotations of platform and bars that the ideal level excludes, rad.

        Shape (..., 6 - n + bars): the platform's tilt about x and y (translation robots: about x,
        y, z), then each bar's rotation about its hinge, relative to the base.

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
        """Forward kinematic model: compute the poses, (..., n), from the motor encoders alone.

        Newton's method with bounded iterations. If it finds no pose of the robot's own mode from
        the guess, it restarts from home and moves the motors in four stages (ideal level).

        Parameters
        ----------
        q : array_like, shape (..., m)
            Motor positions, rad or m.
        guess : array_like, shape (n,) or (..., n), optional
            Start of the iteration; the file's home pose by default.
        errors, level
            As for :meth:`ikm`.

        Raises
        ------
        PoseError
            unreachable: certainly no pose closes the loops; not converged: none found, but one may
            exist; singular: the motors do not determine the pose; branch lost: it closes in another
            working or assembly mode than the robot's.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> x = robot.fkm(robot.ikm([0.05, -0.02, -0.42, 0.3]))
        >>> print(x.round(9))
        [ 0.05 -0.02 -0.42  0.3 ]
        """
        rows, lead = flattened(self, q, self.m, "q", errors)
        start, full = self._guesses(guess, lead, errors), self.is_full(level)

        def answer(q: Array, near: Array | None) -> compliance.Answer:
            return _core.fkm(self.core, q, start if near is None else near, full)[:3]

        x, status, chain = compliance.at_rest(self, rows, full, answer)
        require_answers(self, "motor position", rows, lead, status, chain, errors, name="q")
        return x.reshape(*lead, self.n)

    def _guesses(self, guess: ArrayLike | None, lead: tuple[int, ...], errors: Errors) -> Array:
        start = self.home if guess is None else numbers_of(guess, "guess")
        try:
            start = np.broadcast_to(start, (*lead, self.n))
        except ValueError:
            shapes = f"({self.n},) or {(*lead, self.n)}, one for each reading"
            raise InputError(f"guess: wrong shape, must be {shapes}") from None
        return flattened(self, start, self.n, "guess", errors)[0]

    def jacobian(self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None) -> Array:
        """Compute J, dx = J dq (spatial: dx a twist in the base frame), shape (..., n, m)."""
        return at_poses(self, x, errors, _core.jacobian, self.is_full(level))[0]

    def gyro(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Compute W, (..., 3, n), of a gyroscope on the platform: ω = W ẋ, in its frame.

        For a rotational platform ẋ are the axis rates: ẋ = W⁺ω, and the motor rates are q̇ = J⁻¹ẋ.
        For others ẋ is the free twist. If the base rotates too, as a shank does, first subtract its
        angular velocity, expressed in the platform's frame. Parameters as for :meth:`ikm`.

        Examples
        --------
        >>> import numpy as np, truepose as tp
        >>> W = tp.load("g1-ankle").gyro([0.2, 0.1])
        >>> omega = W @ [0.5, -0.3]  # pitch and roll at 0.5 and -0.3 rad/s
        >>> (np.linalg.pinv(W) @ omega).round(6).tolist()
        [0.5, -0.3]
        """
        return at_poses(self, x, errors, _core.gyro)[0]

    def conditioning(self, x: ArrayLike, errors: Errors = "raise") -> Conditioning:
        """Compute the distance from singularities at x, independent of size and units, 0 to 1.

        Examples
        --------
        >>> import truepose as tp
        >>> parallel, serial = tp.load("h4").conditioning([0.05, 0, -0.4, 0.2])
        >>> round(float(parallel), 3), serial.round(3).tolist()
        (0.813, [0.854, 0.914, 0.873, 0.887])
        """
        return Conditioning(*at_poses(self, x, errors, _core.conditioning))

    def skeleton(self, x: ArrayLike) -> Array:
        """Compute points of every chain at one pose, shape (m, 4, 3), m, base frame.

        P on the motor's axis, B at the arm's end, A at the rod's other end, C the platform anchor
        that carries A (A itself where there is no bar).
        """
        self.require_chains("skeleton")
        x = as_row(self, x, "x")
        return at_poses(self, x, "raise", _core.skeleton)[0]

    def linearize(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> tuple[Array, Array]:
        """Compute the Jacobians of all readings q_e = [q; r] at the pose x.

        The motors hold the pose; at the full level the platform's tilt and its bars' rotations
        follow.

        Returns
        -------
        H_x : ndarray, shape (..., m + r, n)
            ∂q_e/∂x along the free twist; its first n rows are J⁻¹, the others J_r.
        H_xi : ndarray, shape (..., m + r, p)
            ∂q_e/∂ξ at fixed x, one column per name of :attr:`parameters`, in their order; columns
            of sensors not in use are zero.

        Examples
        --------
        >>> import truepose as tp
        >>> robot = tp.load("h4")
        >>> H_x, H_xi = robot.linearize([0.05, 0, -0.4, 0.2])
        >>> names = list(robot.parameters)
        >>> bool((H_xi[:4, names.index("chain2.encoder_offset")] == [0, -1, 0, 0]).all())
        True
        """
        full = self.is_full(level)
        core, H_x = at_poses(self, x, errors, _core.linearise, full)
        at = {name: k for k, name in enumerate(self._values)}
        H = np.zeros((*core.shape[:-1], len(at)))
        for name, column in columns(self.spec):
            if name in at:
                H[..., at[name]] = core[..., column]
        if self.spec.stretches:
            loaded = at_poses(
                self, x, errors, lambda _, rows: compliance.under_load(self, rows, full)
            )
            names = [name for name in at if is_compliance(name)]
            H[..., [at[name] for name in names]] = compliance.columns(self, names, loaded[1])
        return H_x, H
