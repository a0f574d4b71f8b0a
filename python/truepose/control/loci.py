"""Gain, phase and delay margins of a sampled loop from its frequency response.

A multiplier z in all channels brings the closed loop to the edge of stability where det(I + zL) is
zero: where -1/z is an eigenvalue of L(e^{jωT}). The characteristic loci of L thus give the margins
of n channels at once as a Nyquist plot gives those of one; a single channel with the others closed
is the scalar loop l = 1/(I + L)⁻¹_ii - 1. They are meaningless for an unstable loop.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.control.linear import plant
from truepose.control.settings import ControllerSettings
from truepose.robot import Law, Robot

_POINTS = 300
_ANY = 1e6  # multipliers beyond this are rounding errors


class Margin(NamedTuple):
    """Stability margins of a loop; infinite where any value is stable."""

    more: float  #: factor on the gain
    less: float  #: divisor of the gain
    phase: float  #: rad, lag or lead
    delay: float  #: cycles, additional


class Responses:
    """Frequency responses of a robot at P poses, under a law; the controller is c(z) E."""

    def __init__(
        self,
        robot: Robot,
        poses: Array,
        law: Law,
        effects: Effects,
        settings: ControllerSettings,
    ):
        self.plants = [plant(robot, x, law, effects, settings) for x in poses]
        self.period = settings.period
        self.read = robot if effects.quantization else robot.without_quantization()
        highest = np.pi / self.period
        self.frequency = np.geomspace(min(1.0, 1e-3 * highest), 0.9999 * highest, _POINTS)
        self.z = np.exp(1j * self.frequency * self.period)
        answers = [(*p.response(self.z), p.E[None], p.inertia[None]) for p in self.plants]
        #: From commanded accelerations to readings, (P, F, n + r, n), and to the platform's twist.
        self.readings, self.nacelle, self.E, self.inertia = map(
            np.array, zip(*answers, strict=True)
        )
        # The same spectrum as of the loop opened at the motor torques.
        self.loci = _tracked(np.linalg.eigvals(self.E @ self.readings))

    def stable(self, gains: ControllerSettings) -> Array:
        """Return whether the closed loop is stable, at each pose."""
        radii = [np.abs(np.linalg.eigvals(each.closed(gains))).max() for each in self.plants]
        return np.array(radii) < 1

    def margins(self, loci: Array) -> list[Margin]:
        """Return the least margins of some loci, (P, F, k), at each pose."""
        found = []
        for each in loci:
            _, a, b = _crossings(each, each.imag < 0)
            real = a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)
            times = -np.append(real, each[-1].real)  # at half the rate: real
            times = times[(times < _ANY) & (times > 1 / _ANY)]
            k, a, b = _crossings(each, np.abs(each) < 1)
            share = np.log(np.abs(a)) / np.log(np.abs(a / b))
            at = self.frequency[k] * (1 - share) + self.frequency[k + 1] * share
            phase = np.angle(a) + share * np.angle(b / a) + np.pi
            early = np.abs((phase + np.pi) % (2 * np.pi) - np.pi)  # to the nearer side
            late = phase % (2 * np.pi) / (at * self.period)
            ways = 1 / times[times < 1], times[times >= 1], early, late
            found.append(Margin(*(values.min(initial=np.inf) for values in ways)))
        return found

    def together(self, gains: ControllerSettings) -> Array:
        """Return the characteristic loci of the loop of all motors, (P, F, n)."""
        return self.loci * gains.transfer(self.z)[:, None]

    def dither(self, gains: ControllerSettings) -> Array:
        """Return the torques' rms by counts and noise as white noise, over the limits: (P, n)."""
        c = gains.transfer(self.z)[:, None, None]
        loop = np.eye(self.E.shape[-2]) + c * (self.E @ self.readings)
        answer = self.inertia @ np.linalg.solve(loop, c * (self.E * self.read.reading_sigma))
        power = (np.abs(answer) ** 2).sum(axis=-1)
        rms = np.sqrt(np.trapezoid(power, self.frequency * self.period / np.pi, axis=1))
        return rms / self.read.torque_limit

    def limit_cycle(self, gains: ControllerSettings) -> Array:
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
        swing = 4 / np.pi * self.read.resolution * np.abs(self.nacelle @ error)
        turned = (loop[:, 1:].imag < 0) != (loop[:, :-1].imag < 0)
        # Below the poles' frequency a motor without the others' control only falls.
        turned &= (loop[:, 1:].real < 0) & (self.frequency[1:, None] > gains.frequency)
        each = np.where(turned[:, :, None], swing[:, 1:], 0).max(axis=1)
        return np.sqrt((each**2).sum(axis=-1))

    def alone(self, gains: ControllerSettings) -> Array:
        """Return the loops of each motor's torque, then each reading alone, (P, F, n + n + r).

        The others are closed.
        """
        c = gains.transfer(self.z)[:, None, None]
        torques = self.inertia @ self.E @ self.readings @ np.linalg.pinv(self.inertia)
        closed = [
            np.linalg.inv(np.eye(loop.shape[-1]) + c * loop)
            for loop in (torques, self.readings @ self.E)
        ]
        shares = [np.diagonal(each, axis1=-2, axis2=-1) for each in closed]
        return 1 / np.concatenate(shares, axis=-1) - 1


def worst(margins: list[Margin]) -> Margin:
    """Return the least of each margin."""
    return Margin(*np.min(np.array(margins), axis=0).tolist())


def _crossings(loci: Array, inside: Array) -> tuple[Array, Array, Array]:
    """Return where loci, (F, k), come in or go out: the frequency's number, values about it."""
    k, axis = np.nonzero(inside[1:] != inside[:-1])
    return k, loci[k, axis], loci[k + 1, axis]


def _tracked(values: Array) -> Array:
    """Order eigenvalues, (P, F, n), continuously from frequency to frequency."""
    result = values.copy()
    for before, after in (pair for pose in result for pair in pairwise(pose)):
        far, other = np.abs(before[:, None] - after) / (np.abs(after) + 1e-300), after.copy()
        for _ in after:  # the nearest pair first
            i, j = np.unravel_index(far.argmin(), far.shape)
            after[i], far[i], far[:, j] = other[j], np.inf, np.inf
    return result
