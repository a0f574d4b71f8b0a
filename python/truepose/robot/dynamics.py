"""Statics and dynamics in batches: torques, rod forces, masses, accelerations."""

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors, Level
from truepose.robot import compliance
from truepose.robot.batches import at_poses, inverse, together
from truepose.robot.kinematics import Kinematics


class Dynamics(Kinematics):
    """The forces and motions of a :class:`truepose.Robot`; all methods take any leading shape."""

    def joint_torque(
        self, x: ArrayLike, torque: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Compute a rotational platform's joint torques, (..., n): Γ = Kᵀ τ, Γᵀẋ = τᵀq̇.

        For other mobilities: the force and moment of the motors on the platform, along its free
        twist. x, errors and level as for :meth:`ikm`; motor torques (..., m), N·m or N. Leading
        shapes broadcast.

        Examples
        --------
        >>> import truepose as tp
        >>> ankle = tp.load("g1-ankle")
        >>> print(ankle.joint_torque([0.1, 0.05], [10, 10]).round(2))  # pitch, roll
        [ 0.81 19.17]
        """
        x, torque = together(self, errors, motors="torque", x=x, torque=torque)
        J = self.jacobian(x, errors, level)
        return (inverse(J).swapaxes(-1, -2) @ torque[..., None])[..., 0]

    def motor_torque(
        self, x: ArrayLike, torque: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Compute motor torques from joint torques of a rotational platform: τ = Jᵀ Γ.

        The inverse of :meth:`joint_torque`.

        Examples
        --------
        >>> import truepose as tp
        >>> ankle = tp.load("g1-ankle")
        >>> print(ankle.motor_torque([0.1, 0.05], [30.0, 0.0]).round(2))  # toes down
        [-11.36  10.07]
        """
        x, torque = together(self, errors, x=x, torque=torque)
        return (self.jacobian(x, errors, level).swapaxes(-1, -2) @ torque[..., None])[..., 0]

    def rod_forces(
        self, x: ArrayLike, errors: Errors = "raise", level: Level | None = None
    ) -> Array:
        """Compute the static tension of every chain at x, all its rods together, N, shape (..., n).

        It carries the platform's weight, half of every rod's, and the file's load; negative is
        compression. Parameters as for :meth:`ikm`.

        Examples
        --------
        >>> import truepose as tp
        >>> delta = tp.load("delta")
        >>> print(delta.with_payload((0, 0, -30)).rod_forces(delta.home).round(2))
        [18.13 18.13 18.13]
        """
        full = self.is_full(level)
        return at_poses(self, x, errors, lambda _, rows: compliance.under_load(self, rows, full))[2]

    def mass_matrix(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Compute the mass matrix M(x) of the free twist, (..., n, n); kg, kg·m and kg·m².

        It is symmetric; the kinetic energy is ẋᵀM ẋ/2 and the motors' joint inertia JᵀM J, see
        :meth:`jacobian`. Parameters as for :meth:`ikm`.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> J, M = h4.jacobian(h4.home), h4.mass_matrix(h4.home)
        >>> print((J.T @ M @ J).round(3)[0])  # of motor 1: its own inertia, and its pull at others
        [ 0.108  0.04  -0.023 -0.023]
        """
        return at_poses(self, x, errors, _core.mass_matrix)[0]

    def inverse_dynamics(
        self, x: ArrayLike, rate: ArrayLike, acceleration: ArrayLike, errors: Errors = "raise"
    ) -> Array:
        """Compute the motor torques, N·m (slides: N), of a motion, friction included; (..., n).

        x, rate and acceleration, (..., n), are poses, free twists and their derivatives; leading
        shapes broadcast. Torque limits are not checked. Errors as for :meth:`ikm`.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> print(h4.inverse_dynamics(h4.home, [0] * 4, [0] * 4).round(3))  # what holds its weight
        [-2.655 -2.655 -0.467 -0.467]
        """
        motion = {"x": x, "rate": rate, "acceleration": acceleration}
        return self._dynamics(_core.inverse_dynamics, errors, **motion)

    def acceleration(
        self, x: ArrayLike, rate: ArrayLike, torque: ArrayLike, errors: Errors = "raise"
    ) -> Array:
        """Compute the acceleration under motor torques, m/s² and rad/s², shape (..., n).

        The inverse of :meth:`inverse_dynamics`. Torques (..., m) are in N·m (slides: N).

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> falling = h4.acceleration(h4.home, [0] * 4, [0] * 4)
        >>> print((falling / 9.81).round(3)[2])  # no motor holds it; rotors and arms brake
        -0.972
        """
        return self._dynamics(_core.acceleration, errors, x=x, rate=rate, torque=torque)

    def _dynamics(self, function: Callable[..., Any], errors: Errors, **motion: ArrayLike) -> Array:
        x, *others = together(self, errors, motors="torque", **motion)
        rows = [values.reshape(-1, values.shape[-1]) for values in others]
        self.require_chains("dynamics")
        return at_poses(self, x, errors, function, *rows)[0]
