"""Plane contacts, distances and repeated positions of the tool, by rows of the readings from 0."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from statistics import NormalDist
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, finite, numbers_like
from truepose.calibration.learnt import Learnt
from truepose.exceptions import InputError, choose
from truepose.robot import Robot

AXES = "xyz"
#: Probability that a set of correct differences has one reported as wrong.
FALSE_ALARM = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class _Measured:
    """Fields common to all differences."""

    sigma: ArrayLike  #: of each measurement, m
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: tool point, platform frame, m
    tool_sigma: float = 0.0  #: of each of its coordinates; 0: known
    name: str = ""
    called: Sequence[str] = ()  #: name of each measurement; by default its row numbers


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaneContacts(_Measured):
    """Contacts of the tool with a base plane: ``p_z = h + a p_x + b p_y + above``, or cyclic."""

    lines: ArrayLike  #: rows of the contacts
    above: ArrayLike = 0.0  #: of the tool point over the plane, m: feeler gauge, probed height
    height: tuple[float, float] = (0.0, 0.1)  #: h: prior mean and σ, m; σ = 0: known
    slope_sigma: float = 0.0  #: prior σ of a and b (tangents); 0: level
    axis: Literal["x", "y", "z"] = "z"
    name: str = "plane"


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceMeasurements(_Measured):
    """Distances between two tool positions: ``(1 + scale) |p_i - p_j| + times · width``."""

    pairs: ArrayLike  #: (M, 2) rows i and j
    measured: ArrayLike  #: (M,) m
    scale: tuple[float, float] = (0.0, 0.0)  #: prior mean and σ: a print's shrinkage is negative
    width: tuple[float, float] = (0.0, 0.0)  #: prior mean and σ, m: e.g. of a printed line
    times: ArrayLike = 1.0  #: coefficient of width: 1 outside, -1 inside, 0 center to center
    name: str = "distances"


@dataclass(frozen=True, eq=False, kw_only=True)
class RepeatedPoses(_Measured):
    """Tool positions that are repeated, or left by a known step: ``p_i - p_j = apart``."""

    pairs: ArrayLike  #: (M, 2) rows i and j
    apart: ArrayLike = 0.0  #: of each coordinate, in the base frame, m
    name: str = "revisits"


Difference = PlaneContacts | DistanceMeasurements | RepeatedPoses


class Found(NamedTuple):
    """Calibration result of one set of differences: (M,), of RepeatedPoses (M, 2 or 3); m."""

    residual: Array  #: measured less expected, from all data
    left_out: Array  #: the same with this one left out, to first order
    left_out_sigma: Array  #: of `left_out`
    weight: Array  #: 1; 0 of an outlier


@dataclass(frozen=True, eq=False)
class Differences:
    """Measured differences after a calibration."""

    measured: tuple[Difference, ...]
    found: tuple[Found, ...]  #: one for each of `measured`
    unknowns: dict[str, Learnt]  #: plane.height, distances.scale, distances.width, tool.x, …

    @property
    def doubt(self) -> list[str]:
        """One line of text for each doubtful measurement."""
        return [
            f"{of.name}: {1e3 * of.left_out:+.3f} mm off the value from all other data, "
            f"± {1e3 * of.left_out_sigma:.3f}"
            for of in self.each
            if of.doubtful
        ]

    @property
    def each(self) -> list[Each]:
        """All measurements; doubtful: beyond the limit, and down-weighted or the worst."""
        count = sum(of.residual.size for of in self.found)
        limit = NormalDist().inv_cdf(1 - 0.5 * FALSE_ALARM / max(count, 1))
        size = [np.abs(of.left_out / of.left_out_sigma) for of in self.found]
        worst = max(np.nanmax(s, initial=0.0) for s in size)
        result: list[Each] = []
        for given, of, s in zip(self.measured, self.found, size, strict=True):
            doubtful = (s > limit) & ((of.weight < 0.1) | (s == worst))
            names = [_named(given, at) for at in np.ndindex(s.shape)]
            result += map(Each, names, *np.reshape(of, (4, -1)).tolist(), doubtful.flat)
        return result


class Each(NamedTuple):
    """One measured difference after a calibration."""

    name: str  #: "distances: 70.000 mm, lines 3 and 7"
    residual: float
    left_out: float
    left_out_sigma: float
    weight: float
    doubtful: bool  #: improbable by chance, see `FALSE_ALARM`


def _named(given: Difference, at: tuple[int, ...]) -> str:
    """Name one measurement: "distances: 70.000 mm, lines 3 and 7"."""
    k = at[0]
    axis = "" if len(at) == 1 else f"{AXES[at[1]]}, "
    if len(given.called):
        return f"{given.name}: {axis}{given.called[k]}"
    if isinstance(given, PlaneContacts):
        return f"{given.name}: line {np.ravel(given.lines)[k]}"
    if isinstance(given, DistanceMeasurements):
        axis = f"{1e3 * np.ravel(given.measured)[k]:.3f} mm, "
    i, j = np.asarray(given.pairs)[k]
    return f"{given.name}: {axis}lines {i} and {j}"


@dataclass(eq=False)
class Assembled:
    """Differences in the core's form."""

    given: tuple[Difference, ...]
    core: _core.Links
    mean: Array  #: of all unknowns w
    sigma: Array  #: 0: known
    names: list[str]  #: of all
    shapes: list[tuple[int, ...]]  #: of each set's measurements

    def found(self, w: Array, each: Array, sigma: Array) -> Differences:
        """Split the core's result by set; `sigma`, (w,), is that of the unknowns w."""
        values = np.transpose([self.mean, self.sigma, w, sigma]).tolist()
        every = zip(self.names, starmap(Learnt, values), strict=True)
        unknowns = {name: of for name, of in every if of.prior_sigma}
        parts = np.split(each, np.cumsum([math.prod(shape) for shape in self.shapes])[:-1])
        found = tuple(
            Found(*part.T.reshape(-1, *shape))
            for part, shape in zip(parts, self.shapes, strict=True)
        )
        return Differences(self.given, found, unknowns)


def assemble(
    robot: Robot, differences: Sequence[Difference], lines: int, first: int
) -> Assembled | None:
    """Check differences between `lines` poses and convert them for the core; None without any.

    `first` is the index of their unknowns: after the parameters and a tracker's frames.
    """
    if not differences:
        return None
    if not robot.spec.framed:
        raise InputError(
            f"{robot.name}: measured differences need lengths among the coordinates, and a frame: "
            f"a {robot.spec.mobility} platform has none"
        )
    unknowns: list[tuple[str, float, float]] = []  #: name, mean, σ

    def add(of: str, *new: tuple[str, float, float]) -> int:
        for name, value, spread in new:
            finite(f"{of}: {name}", value)
            finite(f"{of}: {name}: σ", spread, 0)
            unknowns.append((f"{of}.{name}", float(value), float(spread)))
        return len(unknowns) - len(new)

    tools: dict[tuple[float, ...], int] = {}
    rows: list[Array] = []
    shapes: list[tuple[int, ...]] = []
    renamed: dict[str, Difference] = {}
    for given in differences:
        if not isinstance(given, Difference):
            raise InputError(
                f"differences: {type(given).__name__}: must be a PlaneContacts, "
                "DistanceMeasurements or RepeatedPoses"
            )
        numbered = (f"{given.name}{number}" for number in ("", *range(2, len(differences) + 2)))
        name = next(of for of in numbered if of not in renamed)
        tool = numbers_like(f"{name}: tool", given.tool, (3,)).tolist()
        if (key := (*tool, given.tool_sigma)) not in tools:
            of = "tool" if not tools else f"tool{len(tools) + 1}"
            tools[key] = add(of, *zip(AXES, tool, [given.tool_sigma] * 3, strict=True))
        links, shape = _links(robot, given, name, lines, tools[key], add)
        rows.append(links)
        shapes.append(shape)
        renamed[name] = replace(given, name=name)
    names, mean, sigma = map(list, zip(*unknowns, strict=True))
    core = _core.links(np.concatenate(rows), np.array(mean), first)
    given_as = tuple(renamed.values())
    return Assembled(given_as, core, np.array(mean), np.array(sigma), names, shapes)


def measurements(differences: Sequence[Difference]) -> int:
    """Return the total number of measurements."""
    return sum(
        len(np.atleast_1d(d.lines if isinstance(d, PlaneContacts) else d.pairs))
        for d in differences
    )


def _links(
    robot: Robot,
    given: Difference,
    name: str,
    lines: int,
    tool: int,
    add: Callable[..., int],
) -> tuple[Array, tuple[int, ...]]:
    """Return the core's rows of one set, and the shape of its measurements."""
    kind, unknown, axis, times = _core.LinkKind.point, 0, np.zeros(1, dtype=int), np.zeros((1, 1))
    if isinstance(given, PlaneContacts):
        if given.axis not in AXES:
            raise InputError(f"{name}: {choose('axis', given.axis, AXES)}")
        pairs = np.repeat(_at(name, given.lines, lines, 1), 2, axis=1)
        axis += AXES.index(given.axis)
        slopes = [(f"slope.{AXES[(axis[0] + k) % 3]}", 0.0, given.slope_sigma) for k in (1, 2)]
        kind, unknown = _core.LinkKind.plane, add(name, ("height", *given.height), *slopes)
        what, measured = "above", given.above
    else:
        pairs = _at(name, given.pairs, lines, 2)
        if (same := np.flatnonzero(pairs[:, 0] == pairs[:, 1])).size:
            raise InputError(f"{name}: pairs: line {pairs[same[0], 0]} twice: must be two lines")
        if isinstance(given, DistanceMeasurements):
            times = numbers_like(f"{name}: times", given.times, (len(pairs),))[:, None]
            kind = _core.LinkKind.distance
            unknown = add(name, ("scale", *given.scale), ("width", *given.width))
            what, measured = "measured", given.measured
        else:
            axis = np.arange(sum(unit == "m" for _, unit in robot.coordinates))
            what, measured = "apart", given.apart
    shape = (len(pairs), len(axis)) if isinstance(given, RepeatedPoses) else (len(pairs),)
    sigma = numbers_like(f"{name}: sigma", given.sigma, shape, "greater than 0")
    must = "greater than 0" if what == "measured" else "a finite number"
    values = numbers_like(f"{name}: {what}", measured, shape, must)
    values, sigma = (of.reshape(len(pairs), -1) for of in (values, sigma))
    row = (kind, pairs[:, :1], pairs[:, 1:], tool, unknown, axis, times, values, sigma)
    return np.stack(np.broadcast_arrays(*row), axis=-1).reshape(-1, len(row)), shape


def _at(name: str, lines: ArrayLike, count: int, width: int) -> Array:
    at = np.asarray(lines)
    at = at.reshape(-1, 1) if width == 1 and at.ndim <= 1 else at
    what = "lines" if width == 1 else "pairs"
    if at.ndim != 2 or at.shape[1] != width or len(at) == 0 or at.dtype.kind not in "iu":
        raise InputError(
            f"{name}: {what}: must be numbers of lines from 0, shape (M{', 2' * (width - 1)})"
        )
    if (wrong := (at < 0) | (at >= count)).any():
        raise InputError(f"{name}: {what}: line {at[wrong][0]}: must be 0 to {count - 1}")
    return at
