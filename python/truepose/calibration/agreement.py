"""Chi-square tests of readings at known poses, each pose against all the rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.show.units import printed


class Row(NamedTuple):
    """Readings less those expected at a known pose, e = B δξ + H δx + noise of covariance I.

    What is not known of the pose is projected out, δx is what is: its own σ is in the noise.
    """

    e: Array  #: (m,)
    B: Array  #: (m, p) by the calibration's parameters
    H: Array  #: (m, k) by the coordinates that are known
    known: Array  #: (n,) which they are

    def left_out(self, covariance: Array, step: Array) -> tuple[float, Array]:
        """χ² of m freedoms, and the coordinates' error, as all other rows predict this one.

        With û and Σ of all rows, r = e - B û and P = I - B Σ Bᵀ, the others miss it by P⁻¹ r,
        whose covariance is P⁻¹.

        Parameters
        ----------
        covariance, step : ndarray, shape (p, p) and (p,)
            Σ of all rows, and û from where the rows are linearised.
        """
        r = self.e - self.B @ step
        missed = np.linalg.solve(np.eye(len(r)) - self.B @ covariance @ self.B.T, r)
        return float(missed @ r), np.linalg.lstsq(self.H, missed)[0]


def rows_of(
    robot: Robot, names: tuple[str, ...], readings: Array, x: Array, known: Array, sigma: Array
) -> list[Row]:
    """Linearise K readings at poses `x`, where the robot stood by `known` and its σ.

    Parameters
    ----------
    robot : Robot
        Calibrated; at its own level.
    names : tuple of str
        Of its p parameters.
    readings : ndarray, shape (K, n + r)
    x, known, sigma : ndarray, shape (K, n)
        Poses close to those known, NaN in `known` where a coordinate is not.
    """
    H_x, H_xi = robot.linearize(x, level=robot.level)
    every = list(robot.parameters)
    H_xi = H_xi[..., [every.index(name) for name in names]]
    noise = knowledge.stated_sigma(robot, robot.level) ** 2
    expected = np.ascontiguousarray(robot.extended_positions(x, level=robot.level))
    off = np.asarray(_core.innovation(robot.core, np.ascontiguousarray(readings), expected))
    rows = []
    for k in range(len(x)):
        read, told = np.isfinite(readings[k]), np.isfinite(known[k])
        Q = np.linalg.qr(H_x[k][np.ix_(read, ~told)], mode="complete")[0][:, (~told).sum() :]
        H = Q.T @ H_x[k][np.ix_(read, told)]
        e = Q.T @ off[k][read] + H @ (x[k] - known[k])[told]
        C = H * sigma[k][told] ** 2 @ H.T + Q.T * noise[read] @ Q
        half = np.linalg.inv(np.linalg.cholesky(C))
        rows.append(Row(half @ e, half @ Q.T @ H_xi[k][read], half @ H, told))
    return rows


def sizes(robot: Robot, known: Array, values: Array, form: str) -> str:
    """Name lengths and angles of some coordinates: "x +1.2 mm, theta 0.1°"."""
    named = (of for of, own in zip(robot.coordinates, known, strict=True) if own)
    return ", ".join(
        f"{name} {printed(value, unit, form)}"
        for (name, unit), value in zip(named, values.tolist(), strict=True)
    )
