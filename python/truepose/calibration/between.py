"""Differences between rows of a log: plane contacts, repeated points, measured distances."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from truepose import logs
from truepose.arguments import Array, finite_rows
from truepose.calibration.differences import AXES, Difference, DistanceMeasurements, PlaneContacts
from truepose.calibration.expectation import poses_of
from truepose.exceptions import InputError, choose, one_line, shortened
from truepose.logs.reading import PLANES, POINT, Log
from truepose.robot import Robot, frames

#: Default σ of a touch and of a distance, m (assumed).
SIGMA = 2e-5
#: Prior σ of a plane's or point's position about its nominal one, m.
SPREAD = 0.1
#: Distance over the extent of a log's places beyond which it is in mm.
FAR = 100.0


class Distance(NamedTuple):
    """One row of a distance file."""

    lines: tuple[int, int]  #: line numbers in the log's file
    ends: str  #: "A to B", as the file names them
    measured: float  #: m
    sigma: float
    times: float  #: coefficient of a printed line's width


@dataclass(frozen=True, kw_only=True)
class Between:
    """Measurement errors and auxiliary unknowns of a log's touches and distances.

    Parameters
    ----------
    touch_sigma : float
        σ of a contact with a plane or a point (columns plane, point): 0.02mm by default.
    tilt : float
        σ of a plane's inclination: 1deg; level by default.
    tool : tuple of float
        Contact point in the platform's frame, m; by default the platform's point.
    tool_sigma : float
        σ of each coordinate of the tool: 1mm; exactly known by default.
    shrinkage : float
        σ of a print's relative shrinkage: 0.002.
    line_width : float
        σ of a print's line width: 0.05mm; known by default.
    distances : tuple of Distance
        Distances between rows, as of :func:`read`.
    """

    touch_sigma: float = field(default=SIGMA, metadata={"text": "m"})
    tilt: float = field(default=0.0, metadata={"text": "rad"})
    tool: tuple[float, ...] = field(default=(0.0, 0.0, 0.0), metadata={"text": "point"})
    tool_sigma: float = field(default=0.0, metadata={"text": "m"})
    shrinkage: float = 0.0
    line_width: float = field(default=0.0, metadata={"text": "m"})
    distances: tuple[Distance, ...] = field(default=(), metadata={"option": False})

    def __post_init__(self) -> None:
        if not 0 <= self.shrinkage <= 1:
            raise InputError(f"shrinkage (--shrinkage) = {self.shrinkage}: must be 0 to 1")

    def of(self, robot: Robot, log: Log, whole: bool = False) -> list[Difference]:
        """Return the differences between the rows of a log.

        Raises InputError for touched features that give no equation; of single touches, which are
        skipped in part of a log, only in the `whole` one.
        """
        touched = _touched(log)
        tool = self._places(robot, log) if touched else np.zeros((0, 3))
        common: dict[str, Any] = {"tool": self.tool, "tool_sigma": self.tool_sigma}
        result: list[Difference] = []
        linear = [name for name, unit in robot.coordinates if unit == "m"]
        ends = {line for of in self.distances for line in of.lines}
        for column, name, rows in touched:
            normal = PLANES.get(column, "")
            if not linear or (normal and normal not in linear):
                raise InputError(f"{column} {name}: {robot.name} has no {normal or 'x, y or z'}")
            if len(rows) < 2:
                if whole and not (column == POINT and int(log.lines[rows[0]]) in ends):
                    raise InputError(
                        f"{log.at(rows)}: {column} '{name}' is on no other {log.word}: a single "
                        "touch gives no equation"
                    )
                continue
            above = log.above.get(column, np.zeros(len(log.lines)))[rows]
            planes = [(f"{column} {name}", normal)]
            if column == POINT:  # coordinates are the same unknowns at every touch
                planes = [(f"point {name}, {axis}", axis) for axis in linear]
            for called, axis in planes:
                heights = tool[rows, AXES.index(axis)] - above
                mean = np.nan_to_num(np.median(heights[np.isfinite(heights)]))
                result.append(
                    PlaneContacts(
                        lines=rows,
                        sigma=self.touch_sigma,
                        above=above,
                        height=(float(mean), SPREAD),
                        slope_sigma=0.0 if column == POINT else self.tilt,
                        axis=axis,  # type: ignore[arg-type]
                        name=called,
                        called=[f"{log.word} {log.lines[k]}" for k in rows],
                        **common,
                    )
                )
        at = {int(line): k for k, line in enumerate(log.lines)}
        kept = [of for of in self.distances if at.keys() >= set(of.lines)]
        if kept:
            pairs, _, measured, sigma, times = zip(*kept, strict=True)
            result.append(
                DistanceMeasurements(
                    pairs=[[at[line] for line in pair] for pair in pairs],
                    measured=measured,
                    sigma=sigma,
                    times=times,
                    scale=(0.0, self.shrinkage),
                    width=(0.0, self.line_width),
                    name="distance",
                    called=[f"{1e3 * of.measured:.3f} mm, {of.ends}" for of in kept],
                    **common,
                )
            )
        return result

    def in_millimetres(self, robot: Robot, log: Log) -> bool:
        """Return whether distances are mostly far beyond all places of the log."""
        place = self._places(robot, log)
        place = place[finite_rows(place)]
        if not (self.distances and len(place)):
            return False
        reach = np.linalg.norm(np.ptp(place, axis=0))
        return bool(np.median([of.measured for of in self.distances]) > FAR * reach)

    def _places(self, robot: Robot, log: Log) -> Array:
        """Return the tool's nominal position in each row, (N, 3), m; NaN without FKM."""
        drawn = robot.expected()
        at = frames.frames(drawn, poses_of(drawn, log.readings[:, : robot.m]))
        return (at @ np.array([*self.tool, 1.0]))[:, :3]


def _touched(log: Log) -> list[tuple[str, str, Array]]:
    return [
        (column, name, np.flatnonzero(names == name))
        for column, names in log.labels.items()
        if column == POINT or column in PLANES  # a posture is a measured pose
        for name in dict.fromkeys(names[names != ""].tolist())
    ]


def read(path: Path, log: Log, sigma: float = SIGMA) -> tuple[Distance, ...]:
    """Read a file of distances: columns from, to, distance (m), and optionally sigma and times.

    Ends are names in the log's column `point`, at their first row; without it, line numbers.
    """
    cells = logs.reading.texts(path, ("from", "to", "distance"))
    lines, texts = cells.lines, cells.columns
    table = []
    for name, default in (("distance", np.nan), ("sigma", sigma), ("times", 1.0)):
        values = cells.numbers(name) if name in texts else np.full(len(lines), default)
        table.append(np.where(np.isnan(values), default, values))
        if name != "times" and (wrong := np.flatnonzero(~(table[-1] > 0))).size:
            shown = one_line(shortened(texts[name][wrong[0]]) or "empty", 60)
            raise InputError(
                f"{path}: line {lines[wrong[0]]}: {name} = {shown}: must be greater than 0 (m)"
            )
    result = []
    for line, *ends, measured, spread, times in zip(
        lines, texts["from"], texts["to"], *table, strict=True
    ):
        where = f"{path}: line {line}"
        i, j = (
            _line(log, end, f"{where}: {name}")
            for name, end in zip(("from", "to"), ends, strict=True)
        )
        if i == j:
            raise InputError(f"{where}: from {ends[0]} to {ends[1]}: must be two {log.word}s")
        named = " to ".join(ends) if POINT in log.labels else f"{log.word}s {i} and {j}"
        result.append(Distance((i, j), named, measured, spread, times))
    return tuple(result)


def _line(log: Log, end: str, where: str) -> int:
    if POINT in log.labels:
        names = log.labels[POINT]
        at = np.flatnonzero((names == end) & (names != ""))
        if not len(at):
            known = dict.fromkeys(names[names != ""].tolist())
            raise InputError(f"{where}: {choose('point', end, known)}")
        return int(log.lines[at[0]])
    if end.isdecimal() and len(end) < 10 and int(end) in log.lines:
        return int(end)
    raise InputError(
        f"{where} '{one_line(shortened(end), 60)}': must be a {log.word} of the log, "
        f"{log.lines[0]} to {log.lines[-1]}, or name its places in a column {POINT}"
    )
