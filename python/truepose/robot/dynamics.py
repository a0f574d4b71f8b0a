"""Inverse and forward dynamics: the reduced dynamic model.

    M(x) ẍ + c(x, ẋ) = J⁻ᵀ (τ - friction(q̇))

ẋ is the free twist of the platform's reference point: a spatial robot rotates by its angular
velocity in the base frame, not by derivatives of a rotation vector. Loops close exactly at the
ideal level; rotors and arms rotate, rods are slender, platform bodies rigid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Errors
from truepose.exceptions import InputError
from truepose.robot.batches import at_poses, flattened, require_answers
from truepose.robot.description import Description


class Dynamics(Description):
    """The reduced dynamic model of a :class:`truepose.Robot`, with the masses of its file."""

    @property
    def has_inertia(self) -> bool:
        """Whether the file's masses give every motion at home an inertia, as torques require."""
        return bool(np.linalg.eigvalsh(self.mass_matrix(self.home)).min() > 0)

    def mass_matrix(self, x: ArrayLike, errors: Errors = "raise") -> Array:
        """Compute the mass matrix M(x) of the free twist, (..., n, n); kg, kg·m and kg·m².

        It is symmetric; the kinetic energy is ẋᵀM ẋ/2 and the motors' joint inertia JᵀM J, see
        :meth:`jacobian`. x, (..., n), are poses, m and rad; `errors` ("raise" or "nan") is the
        action at an unreachable or singular pose. PoseError names the pose, the chain and the
        reason.

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

        Torque limits are not checked.

        Parameters
        ----------
        x, rate, acceleration : array_like, shape (..., n)
            Poses, free twists and their derivatives; leading shapes broadcast.
        errors : {"raise", "nan"}
            As for :meth:`mass_matrix`.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> print(h4.inverse_dynamics(h4.home, [0] * 4, [0] * 4).round(3))  # what holds its weight
        [-2.655 -2.655 -0.467 -0.467]
        """
        return self._dynamics(x, rate, acceleration, "acceleration", errors)

    def acceleration(
        self, x: ArrayLike, rate: ArrayLike, torque: ArrayLike, errors: Errors = "raise"
    ) -> Array:
        """Compute the acceleration under motor torques, m/s² and rad/s², shape (..., n).

        The inverse of :meth:`inverse_dynamics`: the derivative of the free twist.

        Parameters
        ----------
        x, rate, torque : array_like, shape (..., n)
            Poses, free twists and torques, N·m (N); leading shapes broadcast.
        errors : {"raise", "nan"}
            As for :meth:`mass_matrix`.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> falling = h4.acceleration(h4.home, [0] * 4, [0] * 4)
        >>> print((falling / 9.81).round(3)[2])  # no motor holds it; rotors and arms brake
        -0.972
        """
        return self._dynamics(x, rate, torque, "torque", errors)

    def _dynamics(
        self, x: ArrayLike, rate: ArrayLike, given: ArrayLike, name: str, errors: Errors
    ) -> Array:
        named = {"x": x, "rate": rate, name: given}
        checked = {key: flattened(self, value, self.n, key, errors) for key, value in named.items()}
        try:
            lead = np.broadcast_shapes(*(shape for _, shape in checked.values()))
        except ValueError:
            shapes = ", ".join(f"{key} {(*s, self.n)}" for key, (_, s) in checked.items())
            raise InputError(f"{shapes}: leading shapes must broadcast") from None
        at, v, asked = (
            np.ascontiguousarray(
                np.broadcast_to(flat.reshape(*shape, self.n), (*lead, self.n)).reshape(-1, self.n)
            )
            for flat, shape in checked.values()
        )
        of = _core.inverse_dynamics if name == "acceleration" else _core.acceleration
        values, status, chain = of(self.core, at, v, asked)
        require_answers(self, "pose", at, lead, status, chain, errors)
        return values.reshape(*lead, self.n)
