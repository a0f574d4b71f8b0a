"""Calibration of a sled on four belts (Maslow) from its belts' lengths.

The sled has two degrees of freedom. The upper belts are modelled as the motors, the lower belts as
redundant readings. The choice of the two motors does not affect the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from truepose import robotfile
from truepose.arguments import Array
from truepose.calibration.calibrate import calibrate as fit_to
from truepose.calibration.fit import Calibration
from truepose.calibration.influences import NuisanceParameter, stretch, tension
from truepose.calibration.learnt import Learnt
from truepose.exceptions import PoseError
from truepose.robot.robot import Robot

#: Order of the readings: upper left and right, lower left and right.
BELTS = ("tl", "tr", "bl", "br")
#: Prior σ, all assumed: an anchor's coordinates and a belt's zero, m; the strain by tightening of
#: the lower belts, and by the sled's weight.
ANCHOR, OFFSET, STRAIN = 0.3, 0.005, 0.003
#: Initial σ of a belt's reading, m; re-estimated from the log.
READING = 1e-3
#: Ratio of effective degrees of freedom of the median of N χ² of two degrees of freedom each to
#: those of their mean: relative variances 1/(N log² 2) and 1/N.
MEDIAN = np.log(2) ** 2
#: Widths and heights of the frames tried as starting values, m.
FRAMES = (np.arange(1.0, 5.01, 0.1), np.arange(1.0, 4.01, 0.1))
#: Share of the width. Poses up to this far left of the middle count as right, since the machine
#: tightens by its own x = 0.
MIDDLE = 0.02
#: Assumed upper limit of a non-rectangular frame's misfit to the best rectangle, m.
FITS = 0.1
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
"""
_SENSOR = """
[[sensor]]
name = "{belt}"
kind = "distance"
origin = {at}
target = [0.0, 0.0, 0.0]
noise = {sigma!r}
"""
_OFFSETS = """"chain*.encoder_offset" = {{ sigma = {offset!r} }}
"b[lr].offset" = {{ sigma = {offset!r} }}
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
        others = ["offsets"] * self.offsets
        others += [f"stretch ({self.tightened})"] if self.tightened != "off" else []
        return ", ".join(["anchors", *others])


@dataclass(frozen=True)
class Sled:
    """A calibrated sled."""

    fit: Calibration
    lengths: Array  #: (N, 4) m, readings
    model: Model
    sigma: float  #: of a belt's reading, m, estimated from the log

    @property
    def unknowns(self) -> dict[str, Learnt]:
        """Anchors, offsets (m) and strains by the names of this command."""
        every = self.fit.parameters | self.fit.influences
        return {NAMES.get(name, name): of for name, of in every.items()}

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
        robot, result = self.fit.robot, lengths
        for _ in range(3 if self.fit.influences else 0):
            x = robot.fkm(result[:, :2])
            result = lengths - sum(
                self.fit.influences[of.name].value * np.asarray(of.pattern)
                for of in influences(robot, x, self.model.tightened)
            )
        return result

    def predicted(self, lengths: Array) -> Array:
        """Return lower belts predicted by the upper ones minus their readings, (N, 2) in m."""
        right, robot = self.corrected(lengths), self.fit.robot
        return (robot.extended_positions(robot.fkm(right[:, :2])) - right)[:, 2:]

    def suspects(self) -> list[tuple[int, str, float]]:
        """Return poses with low weight in the robust loss, the most suspect belt, and its error."""
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


def calibrate(lengths: Array, heights: Sequence[float], model: Model | None = None) -> Sled:
    """Estimate anchors, offsets and strains from the lengths of four belts.

    `lengths`, shape (N, 4), m, are in the order of `BELTS`. `heights` are those of the anchors
    above the sled's plane, m.
    """
    model = model or Model()
    width, height, _ = frame_of(lengths, heights)
    corners = np.array([[0, height], [width, height], [0, 0], [width, 0]])
    sigma, sled, x = READING, None, None
    for _ in range(4):  # patterns and σ depend weakly on the fit
        robot = robot_of(corners, heights, sigma, model)
        x = robot.fkm(lengths[:, :2], errors="nan") if x is None else x
        if not np.isfinite(x).all():
            raise PoseError(
                f"{np.isnan(x[:, 0]).sum()} poses cannot be reached in a frame like that"
            )
        acting = influences(robot if sled is None else sled.fit.robot, x, model.tightened)
        fit = fit_to(robot, lengths, loss="student", influences=acting, cause="ignore")
        x = np.where(np.isfinite(fit.x), fit.x, x)
        sled = Sled(fit, lengths, model, sigma)
        sigma = float(np.clip(sigma * _disagreement(sled), 1e-6, 0.1))
    assert sled is not None
    return sled


def _disagreement(sled: Sled) -> float:
    """Return the ratio of the residuals' σ to the assumed one, from the median of χ².

    The unknowns use trace(I - Π⁻¹ Σ) degrees of freedom, which are subtracted. A residual over a σ
    of f degrees of freedom is Student's t with variance f/(f - 2), so σ is enlarged accordingly.
    """
    rows = np.flatnonzero(sled.fit.redundancy > 0)  # two degrees of freedom each
    ratio2 = [of.ratio**2 for of in sled.unknowns.values()]
    left = max(1 - (len(ratio2) - sum(ratio2)) / (2 * len(rows)), 0.1)
    f = max(2 * len(rows) * left * MEDIAN, 4.0)
    return float(sled.fit.disagreement(rows) * np.sqrt(1 / left * f / (f - 2)))


def frame_of(lengths: Array, heights: Sequence[float]) -> tuple[float, float, float]:
    """Return width and height, m, of the rectangle whose upper belts predict the lower ones best.

    The third number is its misfit: the median error of the prediction, m.
    """
    tl, tr, bl, br = (lengths**2 - np.square(heights)).T
    W, H = (side[..., None] for side in np.meshgrid(*FRAMES, indexing="ij"))
    x = (tl - tr + W**2) / (2 * W)
    below2 = tl - x**2
    y = H - np.sqrt(np.where(below2 > 0, below2, np.nan))
    wrong = np.hypot(np.hypot(x, y) - np.sqrt(bl), np.hypot(x - W, y) - np.sqrt(br))
    misfit = np.median(np.where(np.isnan(wrong), 9.0, wrong), axis=2)
    i, j = np.unravel_index(np.argmin(misfit), misfit.shape)
    return float(FRAMES[0][i]), float(FRAMES[1][j]), float(misfit[i, j])


def robot_of(corners: Array, heights: Sequence[float], sigma: float, model: Model) -> Robot:
    """Return the nominal sled: anchors tl, tr, bl, br at these corners, (4, 2), m."""
    at = {
        belt: [*map(float, corner), float(z)]
        for belt, corner, z in zip(BELTS, corners, heights, strict=True)
    }
    sensors = [_SENSOR.format(belt=belt, at=at[belt], sigma=sigma) for belt in BELTS[2:]]
    home, low, high = (np.multiply(share, corners[1]).tolist() for share in (0.5, 0.2, 0.8))
    values = {"home": home, "low": low, "high": high, "sensors": "".join(sensors)}
    sigmas = {"sigma": sigma, "anchor": ANCHOR, "offset": OFFSET}
    text = (_SLED + _OFFSETS * model.offsets).format(**at, **values, **sigmas)
    return Robot(robotfile.parse(text, "sled"))


def held_out(lengths: Array, heights: Sequence[float], model: Model, parts: int = 9) -> Array:
    """Predict every ninth row from the others; σ is re-estimated without it each time.

    Returns the errors of the lower belts predicted by the upper ones, (N, 2) m.
    """
    part = np.arange(len(lengths)) % parts
    wrong = np.zeros((len(lengths), 2))
    for k in range(parts):
        sled = calibrate(lengths[part != k], heights, model)
        wrong[part == k] = sled.predicted(lengths[part == k])
    return wrong


class Spread(NamedTuple):
    """Scatter of the anchors over disjoint parts of the poses, in units of σ (rms)."""

    of_stated: float  #: of the mean stated σ
    of_readings: float  #: of its share by the readings, without the prior


def spread(lengths: Array, heights: Sequence[float], model: Model, parts: int = 4) -> Spread:
    """Calibrate on each quarter of the rows and compare the anchors' scatter with σ.

    All parts share the prior, so of a covariance Σ with prior Π only Σ - Σ Π⁻¹ Σ scatters.
    """
    found = [calibrate(lengths[k::parts], heights, model) for k in range(parts)]
    value = np.array([[of.value for of in sled.anchors.values()] for sled in found])
    stated, scatters = [], []
    for sled in found:
        names = list(sled.unknowns)
        at = [names.index(name) for name in sled.anchors]
        after = sled.fit.joint_covariance
        by_prior = after / [of.prior_sigma**2 for of in sled.unknowns.values()] @ after
        stated.append(np.sqrt(np.diag(after))[at])
        scatters.append(np.sqrt(np.diag(after - by_prior))[at])
    apart = value.std(axis=0, ddof=1)
    ratios = (apart / np.mean(sigma, axis=0) for sigma in (stated, scatters))
    return Spread(*(float(np.sqrt(np.mean(ratio**2))) for ratio in ratios))


def mistakes(lengths: Array) -> str | None:
    """Return an error that affects the whole table of lengths, or None."""
    size = float(np.median(lengths))
    if 0.02 < size < 0.13:
        return f"lengths of {1e3 * size:.0f} (median): in inches? must be mm"
    if not 0.3 < size < 10:
        return f"lengths of {1e3 * size:.4g} (median): must be mm"
    return None


def swapped(lengths: Array, heights: Sequence[float]) -> str | None:
    """Return exchanged columns: no frame fits the lengths, but one fits after the exchange.

    Exchanging the two upper or the two lower belts is a mirror image. Exchanging opposite belts
    gives a frame on its side, which only its shape reveals (`Sled.size`).
    """
    *_, as_is = frame_of(lengths, heights)
    if as_is < FITS:
        return None
    for order, names in (
        ([1, 0, 2, 3], "columns tl and tr exchanged, or bl and br?"),
        ([2, 1, 0, 3], "columns tl and bl exchanged, or tr and br?"),
    ):
        if frame_of(lengths[:, order], [heights[k] for k in order])[2] < FITS:
            return names
    return f"no frame explains the lengths: {1e3 * as_is:.0f} mm (median) off in the best"
