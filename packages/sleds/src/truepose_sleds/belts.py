"""Calibration of a sled on four belts (Maslow) from its belts' lengths.

The sled has two degrees of freedom. The upper belts are modelled as the motors, the lower belts as
redundant readings. The choice of the two motors does not affect the result. Lengths lie in the
sled's plane, as the firmware logs them.
"""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.calibration.causes import rows
from truepose.calibration.causes.hypothesis import Case, Hypothesis, evidence
from truepose.calibration.causes.search import search
from truepose.calibration.fit import Calibration
from truepose.calibration.fitting import fit_to
from truepose.calibration.influences import NuisanceParameter, stretch, tension
from truepose.calibration.learnt import Learnt, calibrated
from truepose.exceptions import PoseError, TrueposeError
from truepose.logs import Log
from truepose.robot import Robot, knowledge
from truepose_sleds import frame

#: Order of the readings: upper left and right, lower left and right.
BELTS = ("tl", "tr", "bl", "br")
#: Prior σ, all assumed: an anchor's coordinates, a belt's zero, and the extension common to all
#: belts, m; the strain by tightening of the lower belts, and by the sled's weight.
ANCHOR, OFFSET, EXTENSION, STRAIN = 0.3, 0.005, 0.2, 0.003
#: σ of a belt's zero in models without offsets, m.
NO_OFFSET = 1e-5
#: Initial σ of a belt's reading, m; re-estimated from the log.
READING = 1e-3
#: Ratio of effective degrees of freedom of the median of N χ² of two degrees of freedom each to
#: those of their mean: relative variances 1/(N log² 2) and 1/N.
MEDIAN = np.log(2) ** 2
#: Share of the width. Poses up to this far left of the middle count as right, since the machine
#: tightens by its own x = 0.
MIDDLE = 0.02
#: Most slips that are searched one after the other; smallest one, m: model errors make smaller
#: ones, as where a pose is repeated.
SLIPS, LEAST = 3, 0.0035
#: Belts across the frame, exchanged: the order of their columns.
ACROSS = {"bl and tr": [0, 2, 1, 3], "br and tl": [3, 1, 2, 0]}
#: Tightening of the lower belts for a reading: the belt of the sled's side first and the other
#: against it (Maslow's firmware, frame upright); both alike; or no stretch.
Tightened = Literal["sides", "alike", "off"]

_SLED = """name = "sled"
title = "Sled on four belts"
mobility = "planar_translation"
source = "The belts' own lengths. Gravity's direction and the tolerances are assumed."
home = {home}
gravity = [0.0, -9.81, 0.0]
sensors = ["bl", "br"]

[workspace] # of the poses that were read
minimum = {low}
maximum = {high}

[chain_defaults]
actuator = "telescopic"
anchor = [0.0, 0.0, 0.0]
encoder_noise = {sigma!r}

[[chain]] # upper left
base = {tl}

[[chain]] # upper right
base = {tr}

[platform]
mass = 10.0 # assumed
{sensors}
# The base's frame: from the lower left anchor, x towards the lower right one.
[tolerances]
"chain*.base.[xy]" = {{ sigma = {anchor!r} }}
"br.origin.x" = {{ sigma = {anchor!r} }}
"chain*.encoder_offset" = {{ sigma = {offset!r} }}
"b[lr].offset" = {{ sigma = {offset!r} }}
"""
_SENSOR = """
[[sensor]]
name = "{belt}"
kind = "distance"
origin = {at}
target = [0.0, 0.0, 0.0]
noise = {sigma!r}
"""
#: Names of the unknowns: in the robot file, and in this command.
NAMES = {
    "chain1.base.x": "tl.x",
    "chain1.base.y": "tl.y",
    "chain2.base.x": "tr.x",
    "chain2.base.y": "tr.y",
    "br.origin.x": "br.x",
    "chain1.encoder_offset": "tl.offset",
    "chain2.encoder_offset": "tr.offset",
}


class Model(NamedTuple):
    """Unknowns in addition to the anchors."""

    offsets: bool = True
    tightened: Tightened = "sides"

    def __str__(self) -> str:
        """Return the unknowns as text."""
        others = ["extension", *["offsets"] * self.offsets]
        others += [f"stretch ({self.tightened})"] if self.tightened != "off" else []
        return ", ".join(["anchors", *others])


@dataclass(frozen=True)
class Sled:
    """A calibrated sled."""

    fit: Calibration
    lengths: Array  #: (N, 4) m, readings
    x: Array  #: (N, 2) m, poses
    model: Model
    sigma: float  #: of a belt's reading, m, estimated from the log
    slips: tuple[NuisanceParameter, ...] = ()  #: of belts, as influences on these readings

    @property
    def unknowns(self) -> dict[str, Learnt]:
        """Anchors, offsets (m) and strains by the names of this command."""
        every = self.fit.parameters | self.fit.influences
        return {NAMES.get(name, name): of for name, of in every.items()}

    @property
    def by_prior(self) -> Array:
        """Π⁻¹ Σ: its trace is the number of unknowns that the prior determines."""
        prior = np.diag([of.prior_sigma**2 for of in self.unknowns.values()])
        p = len(self.fit.names)
        prior[:p, :p] = self.fit.prior_covariance
        return np.linalg.solve(prior, self.fit.joint_covariance)

    @property
    def extension(self) -> tuple[float, float]:
        """Mean of the offsets and its σ, m: what all belts lack."""
        at = [name.endswith("offset") for name in self.unknowns]
        mean = np.array(at) / np.sum(at)
        value = mean @ [of.value for of in self.unknowns.values()]
        return float(value), float(np.sqrt(mean @ self.fit.joint_covariance @ mean))

    @property
    def anchors(self) -> dict[str, Learnt]:
        """The five unknown coordinates of the anchors."""
        return {n: of for n, of in self.unknowns.items() if n.endswith((".x", ".y"))}

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the frame, m: means of opposite sides."""
        at = {name: of.value for name, of in self.anchors.items()}
        width = (at["tr.x"] - at["tl.x"] + at["br.x"]) / 2
        return width, (at["tl.y"] + at["tr.y"]) / 2

    def corrected(self, lengths: Array) -> Array:
        """Return the readings minus stretch: lengths of belts that do not stretch."""
        result = lengths
        for _ in range(3 if self.model.tightened != "off" else 0):
            result = lengths - self.stretch(self.fit.robot.fkm(result[:, :2]))
        return result

    def stretch(self, x: Array) -> Array:
        """Return what stretch adds to the readings at these poses, (N, 4), m."""
        return self._effect(influences(self.fit.robot, x, self.model.tightened), len(x))

    def _effect(self, acting: Sequence[NuisanceParameter], rows: int) -> Array:
        """Return what influences of estimated amounts add to readings, (rows, 4), m."""
        amounts = (self.fit.influences[of.name].value * np.asarray(of.pattern) for of in acting)
        return sum(amounts, start=np.zeros((rows, 4)))

    @property
    def undone(self) -> Array:
        """The readings without slips, (N, 4) m."""
        return self.lengths - self._effect(self.slips, len(self.lengths))

    def predicted(self, lengths: Array) -> Array:
        """Return lower belts predicted by the upper ones minus their readings, (N, 2) in m."""
        right, robot = self.corrected(lengths), self.fit.robot
        return (robot.extended_positions(robot.fkm(right[:, :2])) - right)[:, 2:]

    def suspects(self) -> list[tuple[int, str, float]]:
        """Return the poses that the fit left out, the most suspect belt, and its error."""
        result = []
        H_x, _ = self.fit.robot.linearize(np.nan_to_num(self.fit.x), errors="nan")
        for k in self.fit.outliers:
            H = H_x[k]
            P = np.eye(4) - H @ np.linalg.solve(H.T @ H, H.T)
            wrong = P @ self.fit.residuals[k]
            size = np.abs(wrong) / np.sqrt(np.diag(P))
            belt = int(np.argmax(size))
            result.append((int(k), BELTS[belt], float(wrong[belt] / P[belt, belt])))
        return sorted(result, key=lambda of: -abs(of[2]))


def influences(robot: Robot, x: Array, tightened: Tightened) -> list[NuisanceParameter]:
    """Return strains of all belts by cause; amounts are the strain of a lower belt.

    The upper belts carry the pull of the lower ones, and the sled's weight, whose unit is the same.
    """
    if tightened == "off":
        return []
    H_x, _ = robot.linearize(x)
    ends = [robot.parameters[f"chain{k}.base.x"].value for k in (1, 2)]
    left = x[:, 0] < np.mean(ends) - MIDDLE * np.ptp(ends)

    def pulled(by: Array) -> Array:
        """Return tensions of all four belts for these tensions of the lower ones, (N, 2)."""
        force = np.zeros((len(x), 3))
        force[:, :2] = -np.einsum("kr,krj->kj", by, H_x[:, 2:])
        return np.hstack([tension(robot, x, force), by])

    weight = np.hstack([tension(robot, x, (0.0, -1.0, 0.0)), np.zeros((len(x), 2))])
    own = np.column_stack([left, ~left]).astype(float)
    pulls = (
        {"strain, belt of the side": own, "strain, other belt": 1 - own}
        if tightened == "sides"
        else {"strain, lower belts": np.ones_like(own)}
    )
    acting = {name: pulled(by) for name, by in pulls.items()} | {"strain, weight": weight}
    return [
        NuisanceParameter(name=name, pattern=stretch(robot, x, held), amount=(0.0, STRAIN))
        for name, held in acting.items()
    ]


def calibrate(
    lengths: Array,
    model: Model | None = None,
    slips: Sequence[NuisanceParameter] = (),
    begun: frame.Frame | None = None,
) -> Sled:
    """Estimate anchors, offsets and strains from the lengths of four belts.

    `lengths`, shape (N, 4), m, are in the order of `BELTS`. `slips` are influences on them, `begun`
    a frame to start from. Raises InputError for lengths that no frame explains.
    """
    model = model or Model()
    begun = begun or frame.start(lengths)
    sigma, sled, x = READING, None, None
    for _ in range(4):  # patterns and σ depend weakly on the fit
        robot = robot_of(begun, sigma, model)
        x = robot.expected().fkm(lengths[:, :2], errors="nan") if x is None else x
        if (lost := np.isnan(x).any(axis=1)).any():
            raise PoseError(f"{lost.sum()} poses cannot be reached in a frame like that")
        acting = influences(robot if sled is None else sled.fit.robot, x, model.tightened)
        fit = fit_to(Case(robot, log_of(lengths), influences=[*acting, *slips]))
        x = np.where(np.isfinite(fit.x), fit.x, x)
        sled = Sled(fit, lengths, x, model, sigma, tuple(slips))
        sigma = float(np.clip(sigma * _disagreement(sled), 1e-6, 0.1))
    assert sled is not None
    return sled


def log_of(lengths: Array, lines: Array | None = None, word: str = "row") -> Log:
    """Return the lengths as a log of a sled; `lines` are the rows' numbers, from 1 by default."""
    lines = np.arange(1, len(lengths) + 1) if lines is None else lines
    return Log(BELTS, lengths, None, lines, word)


def without_slips(sled: Sled, lines: Array, word: str = "row") -> tuple[Sled, list[str]]:
    """Search belts that slipped; return the sled without their slips, and a line on each.

    The search (:func:`causes.search.search`) needs σ of a reading as it is without the slip: the
    least σ that a slip of one belt leaves. Rows that are wrong by themselves are left to the fit.
    What is not decisive, but for the belt, changes nothing; a line names slip and rival.
    """
    said = list[str]()
    for _ in range(SLIPS):
        lengths = sled.undone
        read = np.where(_alone(sled)[:, None] & (np.arange(4) > 1), np.nan, lengths)
        acting = influences(sled.fit.robot, sled.x, sled.model.tightened)
        case = Case(sled.fit.prior, log_of(read, lines, word), influences=acting)
        fits = filter(None, (of.fit() for of in rows.slipped(case)))
        tried = [replace(sled, fit=fit, slips=()) for fit in fits]
        sigma = min([sled.sigma, *(sled.sigma * _disagreement(of) for of in tried)])
        nominal = robot_of(frame.start(lengths), sigma, sled.model)
        causes, found, _ = search(replace(case, robot=nominal))
        near = [(each, _slips(each.of.each)) for each in found[: causes.near]]
        large = [
            min(abs(each.fit.influences[of.influence].value) for of in slips) >= LEAST
            for each, slips in near
            if slips
        ]
        if not any(large[:1]):
            break
        if len(large) < len(near):
            first = [next(each for each, of in near if bool(of) is slip) for slip in (True, False)]
            told = ", or ".join(each.cause.text for each in first)
            said.append(f"{told}: the log fits both alike, so nothing is undone")
            break
        if causes.verdict == "unexplained":
            break
        slips = near[0][1]
        others = {of.text.split(":")[0] for _, mistakes in near[1:] for of in mistakes}
        told = f", or {' or '.join(sorted(others))} did instead" * bool(others)
        named = [
            replace(of.given.influences[-1], name=f"slip {k}")
            for k, of in enumerate(slips, len(sled.slips) + 1)
        ]
        sled = calibrate(sled.lengths, sled.model, (*sled.slips, *named))
        for slip, of in zip(slips, named, strict=True):
            by = sled.fit.influences[of.name]
            said.append(f"{slip.text} {1e3 * by.value:.1f} ± {1e3 * by.sigma:.1f} mm: undone{told}")
    return sled, said


def exchanged(sled: Sled) -> dict[str, float]:
    """Return log marginal likelihoods with belts across the frame exchanged, less that as read.

    The anchors fit either way: exchanged, the frame is on its side. Gravity and the order of
    tightening, which stretch the belts, tell the two apart.
    """
    known = dict[str, float]()
    for names, order in {"": [0, 1, 2, 3], **ACROSS}.items():
        with contextlib.suppress(TrueposeError):
            other = calibrate(sled.lengths[:, order], sled.model) if names else sled
            known[names] = _evidence(other, sled.sigma)
    own = known.pop("", math.inf)
    return {names: of - own for names, of in known.items()}


def _evidence(sled: Sled, sigma: float) -> float:
    """Return the log of a sled's marginal likelihood for this σ of a reading."""
    acting = influences(sled.fit.robot, sled.x, sled.model.tightened)
    robot = robot_of(frame.start(sled.lengths), sigma, sled.model)
    case = Case(robot, log_of(sled.lengths), influences=acting)
    return evidence(fit_to(case), case.nothing(), 2 * len(sled.lengths))


def _slips(mistakes: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return the slips among some mistakes."""
    return [of for of in mistakes if of.kind == "slip"]


def _alone(sled: Sled) -> Array:
    """Return which rows are outliers between two rows that are not, (N,)."""
    out = np.ones(len(sled.lengths) + 2, dtype=bool)
    out[1:-1] = sled.fit.weights < 0.1
    return np.asarray(out[1:-1] & ~out[:-2] & ~out[2:])


def _disagreement(sled: Sled) -> float:
    """Return the ratio of the residuals' σ to the assumed one, from the median of χ².

    The unknowns use trace(I - Π⁻¹ Σ) degrees of freedom, which are subtracted. A residual over a σ
    of f degrees of freedom is Student's t with variance f/(f - 2), so σ is enlarged accordingly.
    """
    rows = np.flatnonzero(sled.fit.redundancy > 0)  # two degrees of freedom each
    used = len(sled.unknowns) - np.trace(sled.by_prior)
    left = max(1 - used / (2 * len(rows)), 0.1)
    f = max(2 * len(rows) * left * MEDIAN, 4.0)
    return float(sled.fit.disagreement(rows) * np.sqrt(1 / left * f / (f - 2)))


def robot_of(begun: frame.Frame, sigma: float, model: Model) -> Robot:
    """Return the nominal sled: anchors tl, tr, bl, br at the corners of a frame.

    All offsets have the frame's extension as mean, and σ of the common extension beside their own.
    """
    corners, extension = begun
    at = {belt: [*map(float, at), 0.0] for belt, at in zip(BELTS, corners, strict=True)}
    sensors = [_SENSOR.format(belt=belt, at=at[belt], sigma=sigma) for belt in BELTS[2:]]
    middle = np.mean(corners, axis=0)
    home, low, high = ((middle + s * (corners[1] - middle)).tolist() for s in (0.0, -0.6, 0.6))
    values = {"home": home, "low": low, "high": high, "sensors": "".join(sensors)}
    sigmas = {"sigma": sigma, "anchor": ANCHOR, "offset": OFFSET if model.offsets else NO_OFFSET}
    robot = Robot(robotfile.parse(_SLED.format(**at, **values, **sigmas), "sled"))
    names = knowledge.learnable(robot)
    common = np.array([name.endswith("offset") for name in names], dtype=float)
    root = np.hstack([knowledge.root(robot, names), EXTENSION * common[:, None]])
    means = [robot.parameters[name].mean for name in names] + extension * common
    values = dict(zip(names, means.tolist(), strict=True))
    return calibrated(robot, values, knowledge.triangular(root), "a common extension, assumed")


def held_out(lengths: Array, model: Model) -> Array:
    """Predict every ninth row from the others; σ is re-estimated without it each time.

    Returns the errors of the lower belts predicted by the upper ones, (N, 2) m.
    """
    part, begun = np.arange(len(lengths)) % 9, frame.start(lengths)
    wrong = np.zeros((len(lengths), 2))
    for k in range(9):
        sled = calibrate(lengths[part != k], model, begun=begun)
        wrong[part == k] = sled.predicted(lengths[part == k])
    return wrong


def spread(lengths: Array, model: Model, parts: int = 4) -> float:
    """Calibrate on each quarter of the rows; return the anchors' scatter over its σ, rms.

    All parts share the prior, so of a covariance Σ with prior Π only Σ - Σ Π⁻¹ Σ scatters.
    """
    begun = frame.start(lengths)
    found = [calibrate(lengths[k::parts], model, begun=begun) for k in range(parts)]
    value = np.array([[of.value for of in sled.anchors.values()] for sled in found])
    scatters = []
    for sled in found:
        names = list(sled.unknowns)
        at = [names.index(name) for name in sled.anchors]
        after = sled.fit.joint_covariance
        scatters.append(np.sqrt(np.diag(after - after @ sled.by_prior))[at])
    ratio = value.std(axis=0, ddof=1) / np.mean(scatters, axis=0)
    return float(np.sqrt(np.mean(ratio**2)))
