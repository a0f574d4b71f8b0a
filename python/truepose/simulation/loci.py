"""How far is a sampled loop from instability? Margins from its frequency response.

A multiplier z in all channels brings the closed loop to the edge of stability where det(I + zL)
vanishes: where -1/z is an eigenvalue of L(e^{jωT}). So the characteristic loci of L have the
margins of n channels at once as a Nyquist plot has those of one; a single channel, the others
closed, is a scalar loop l = 1/(I + L)⁻¹_ii - 1. They say nothing of a loop that is unstable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.simulation.linear import Gains, Plant

_POINTS = 300
_ANY = 1e6  # a multiplier beyond this is rounding's


class Margin(NamedTuple):
    """How much a loop bears. Infinite where it bears any."""

    more: float  #: times its gain
    less: float  #: so many times less
    phase: float  #: rad, late or early
    delay: float  #: cycles, beside those it has


def frequencies(period: float) -> Array:
    """Points at which loops are looked at, rad/s: from 1 rad/s to half the sampling rate."""
    highest = np.pi / period
    return np.geomspace(min(1.0, 1e-3 * highest), 0.9999 * highest, _POINTS)


class Responses:
    """Frequency responses of P plants whose controller is one transfer function c(z) times E.

    Parameters
    ----------
    plants : list of Plant
        At poses; of one robot, law and period.
    """

    def __init__(self, plants: list[Plant]):
        self.plants, self.period = plants, plants[0].period
        self.frequency = frequencies(self.period)
        self.z = np.exp(1j * self.frequency * self.period)
        #: From accelerations asked for to readings, (P, F, n + r, n).
        self.readings = np.stack([p.response(self.z) @ p.inertia for p in plants])
        self.E = np.stack([p.E for p in plants])[:, None]
        # The same spectrum as broken at the motors' torques.
        self.loci = _tracked(np.linalg.eigvals(self.E @ self.readings))

    def stable(self, gains: Gains) -> bool:
        """Whether every closed loop is."""
        return all(abs(np.linalg.eigvals(p.closed(gains))).max() < 1 for p in self.plants)

    def common(self, gains: Gains) -> list[Margin]:
        """Return the margins of all motors' torques at once, at each pose."""
        c = gains.transfer(self.z, self.period)
        return [self._margin(loci) for loci in self.loci * c[:, None]]

    def torques(self, gains: Gains) -> list[list[Margin]]:
        """Return those of each motor's torque alone, at each pose."""
        inertia = np.stack([p.inertia for p in self.plants])[:, None]
        return self._alone(gains, inertia @ self.E @ self.readings @ np.linalg.inv(inertia))

    def alone(self, gains: Gains) -> list[list[Margin]]:
        """Return those of each reading alone, at each pose: of a sensor, its own loop."""
        return self._alone(gains, self.readings @ self.E)

    def dither(self, gains: Gains, sigma: Array) -> Array:
        """Return the torques' rms where readings have white noise of these σ: (P, n)."""
        c = gains.transfer(self.z, self.period)[:, None, None]
        inertia = np.stack([p.inertia for p in self.plants])[:, None]
        loop = np.eye(self.E.shape[-2]) + c * (self.E @ self.readings)
        answer = inertia @ np.linalg.solve(loop, c * (self.E * sigma))
        power = (np.abs(answer) ** 2).sum(axis=-1)
        return np.sqrt(np.trapezoid(power, self.frequency * self.period / np.pi, axis=1))

    def _alone(self, gains: Gains, loop: Array) -> list[list[Margin]]:
        c = gains.transfer(self.z, self.period)[:, None, None]
        open_ = np.linalg.inv(np.eye(loop.shape[-1]) + c * loop)
        own = 1 / np.diagonal(open_, axis1=-2, axis2=-1) - 1
        return [[self._margin(l[:, [i]]) for i in range(l.shape[-1])] for l in own]

    def _margin(self, loci: Array) -> Margin:
        more, less = _gains(loci)
        phase, at = _phases(loci, self.frequency)
        early = np.abs((phase + np.pi) % (2 * np.pi) - np.pi)  # to the nearer side
        late = phase % (2 * np.pi) / (at * self.period)
        return Margin(more, less, early.min(initial=np.inf), late.min(initial=np.inf))


def worst(margins: list[Margin]) -> Margin:
    """Return the least of each."""
    return Margin(*np.min(np.array(margins), axis=0).tolist())


def _gains(loci: Array) -> tuple[float, float]:
    """Multipliers that take a locus through -1: the least above 1, and 1 over the largest below."""
    a, b = loci[:-1], loci[1:]
    passes = (a.imag < 0) != (b.imag < 0)
    a, b = a[passes], b[passes]
    real = a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)
    least = np.append(-real[real < 0], -loci[-1].real[loci[-1].real < 0])  # half the rate: real
    least = least[(least < _ANY) & (least > 1 / _ANY)]
    inner, outer = least[least < 1], least[least >= 1]
    return (1 / inner.max() if inner.size else np.inf), outer.min(initial=np.inf)


def _phases(loci: Array, frequency: Array) -> tuple[Array, Array]:
    """How far a locus is from -1 where its modulus is 1, rad, and at which frequencies."""
    size = np.log(np.abs(loci) + 1e-300)
    passes = (size[:-1] < 0) != (size[1:] < 0)
    share = (size[:-1] / (size[:-1] - size[1:] + ~passes))[passes]
    a, b = loci[:-1][passes], loci[1:][passes]
    turned = np.angle(a) + share * np.angle(b / a)
    w = np.broadcast_to(frequency[:, None], loci.shape)
    return turned + np.pi, w[:-1][passes] * (1 - share) + w[1:][passes] * share


def _tracked(values: Array) -> Array:
    """Order eigenvalues, (P, F, n), so that each goes on from frequency to frequency."""
    poses, count, n = values.shape
    result, rows = values.copy(), np.arange(poses)
    for k in range(1, count):
        far = np.abs(result[:, k - 1, :, None] - values[:, k, None, :])
        far /= np.abs(values[:, k, None, :]) + 1e-300
        for _ in range(n):  # the nearest pair first
            i, j = np.divmod(far.reshape(poses, -1).argmin(axis=1), n)
            result[rows, k, i] = values[rows, k, j]
            far[rows, i, :] = far[rows, :, j] = np.inf
    return result
