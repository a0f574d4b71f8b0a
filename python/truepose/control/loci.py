"""Gain, phase and delay margins of a sampled loop from its frequency response.

A multiplier z in all channels brings the closed loop to the edge of stability where det(I + zL) is
zero: where -1/z is an eigenvalue of L(e^{jωT}). The characteristic loci of L thus give the margins
of n channels at once as a Nyquist plot gives those of one; a single channel with the others closed
is the scalar loop l = 1/(I + L)⁻¹_ii - 1. They are meaningless for an unstable loop.
"""

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.control.linear import Plant
from truepose.control.settings import ControllerSettings

_POINTS = 300
_ANY = 1e6  # multipliers beyond this are rounding errors


class Margin(NamedTuple):
    """Stability margins of a loop; infinite where any value is stable."""

    more: float  #: factor on the gain
    less: float  #: divisor of the gain
    phase: float  #: rad, lag or lead
    delay: float  #: cycles, additional


class Responses:
    """Frequency responses of P plants of one robot, law and period; the controller is c(z) E."""

    def __init__(self, plants: list[Plant]):
        self.plants, self.period = plants, plants[0].period
        highest = np.pi / self.period
        self.frequency = np.geomspace(min(1.0, 1e-3 * highest), 0.9999 * highest, _POINTS)
        self.z = np.exp(1j * self.frequency * self.period)
        answers = [[part @ p.inertia for part in p.response(self.z)] for p in plants]
        #: From commanded accelerations to readings, (P, F, n + r, n), and to the platform's twist.
        self.readings, self.nacelle = (np.stack(part) for part in zip(*answers, strict=True))
        self.E, self.inertia = (
            np.stack([getattr(p, name) for p in plants])[:, None] for name in ("E", "inertia")
        )
        # The same spectrum as of the loop opened at the motor torques.
        self.loci = _tracked(np.linalg.eigvals(self.E @ self.readings))

    def stable(self, gains: ControllerSettings) -> Array:
        """Return whether the closed loop is stable, at each pose."""
        radii = [abs(np.linalg.eigvals(plant.closed(gains))).max() for plant in self.plants]
        return np.array(radii) < 1

    def margins(self, loci: Array) -> list[Margin]:
        """Return the least margins of some loci, (P, F, k), at each pose."""
        return [self._margin(each) for each in loci]

    def together(self, gains: ControllerSettings) -> Array:
        """Return the characteristic loci of the loop of all motors, (P, F, n)."""
        return self.loci * gains.transfer(self.z)[:, None]

    def dither(self, gains: ControllerSettings, sigma: Array) -> Array:
        """Return the torques' rms under white noise of the readings with these σ: (P, n)."""
        c = gains.transfer(self.z)[:, None, None]
        loop = np.eye(self.E.shape[-2]) + c * (self.E @ self.readings)
        answer = self.inertia @ np.linalg.solve(loop, c * (self.E * sigma))
        power = (np.abs(answer) ** 2).sum(axis=-1)
        return np.sqrt(np.trapezoid(power, self.frequency * self.period / np.pi, axis=1))

    def limit_cycle(self, gains: ControllerSettings, counts: Array) -> Array:
        """Return the platform's limit cycle by one count of the readings, peak to peak: (P, n).

        A reading rests in the middle of a count or oscillates about its edge, where a quantizer is
        a relay whose describing function takes any value. Each oscillates by itself at the
        frequency at which its loop has a phase of -180°; the platform responds to its square wave's
        fundamental, 4/π counts peak to peak (A. Gelb and W. E. Vander Velde, Multiple-Input
        Describing Functions, 1968, chapter 2). A sampled relay may be one cycle late. Phases are
        arbitrary: readings add by their squares.
        """
        c = gains.transfer(self.z)[:, None, None]
        error = c * self.E
        loop = np.einsum("pfij,pfji->pfi", self.readings, error) / self.z[:, None]
        swing = 4 / np.pi * counts * np.abs(self.nacelle @ error)
        turned = (loop[:, 1:].imag < 0) != (loop[:, :-1].imag < 0)
        # Below the poles' frequency a motor without the others' control only falls.
        turned &= (loop[:, 1:].real < 0) & (self.frequency[1:, None] > gains.frequency)
        each = np.where(turned[:, :, None], swing[:, 1:], 0).max(axis=1)
        return np.sqrt((each**2).sum(axis=-1))

    def alone(self, gains: ControllerSettings) -> Array:
        """Return the loops of each motor's torque, then each reading alone, (P, F, n + n + r)."""
        torques = self.inertia @ self.E @ self.readings @ np.linalg.pinv(self.inertia)
        loops = self._own(gains, torques), self._own(gains, self.readings @ self.E)
        return np.concatenate(loops, axis=-1)

    def _own(self, gains: ControllerSettings, loop: Array) -> Array:
        """Return scalar loops of channels with the others closed, (P, F, channels)."""
        c = gains.transfer(self.z)[:, None, None]
        open_ = np.linalg.inv(np.eye(loop.shape[-1]) + c * loop)
        return 1 / np.diagonal(open_, axis1=-2, axis2=-1) - 1

    def _margin(self, loci: Array) -> Margin:
        more, less = _gains(loci)
        phase, at = _phases(loci, self.frequency)
        early = np.abs((phase + np.pi) % (2 * np.pi) - np.pi)  # to the nearer side
        late = phase % (2 * np.pi) / (at * self.period)
        return Margin(more, less, early.min(initial=np.inf), late.min(initial=np.inf))


def worst(margins: list[Margin]) -> Margin:
    """Return the least of each margin."""
    return Margin(*np.min(np.array(margins), axis=0).tolist())


def _gains(loci: Array) -> tuple[float, float]:
    """Return the multipliers that take a locus through -1: least above 1, 1 / largest below."""
    a, b = loci[:-1], loci[1:]
    passes = (a.imag < 0) != (b.imag < 0)
    a, b = a[passes], b[passes]
    real = a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)
    least = np.append(-real[real < 0], -loci[-1].real[loci[-1].real < 0])  # at half the rate: real
    least = least[(least < _ANY) & (least > 1 / _ANY)]
    inner, outer = least[least < 1], least[least >= 1]
    return (1 / inner.max() if inner.size else np.inf), outer.min(initial=np.inf)


def _phases(loci: Array, frequency: Array) -> tuple[Array, Array]:
    """Return a locus' phase from -1 where its modulus is 1, rad, and the frequencies."""
    size = np.log(np.abs(loci) + 1e-300)
    passes = (size[:-1] < 0) != (size[1:] < 0)
    share = (size[:-1] / (size[:-1] - size[1:] + ~passes))[passes]
    a, b = loci[:-1][passes], loci[1:][passes]
    turned = np.angle(a) + share * np.angle(b / a)
    w = np.broadcast_to(frequency[:, None], loci.shape)
    return turned + np.pi, w[:-1][passes] * (1 - share) + w[1:][passes] * share


def _tracked(values: Array) -> Array:
    """Order eigenvalues, (P, F, n), continuously from frequency to frequency."""
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
