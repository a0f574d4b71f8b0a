"""Monte Carlo studies: a function of many robots, evaluated in parallel and stored."""

import contextlib
import functools
import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arguments import Array, whole
from truepose.robot import Robot, load
from truepose.show import Shown, Table, number, ranges
from truepose.studies.cases import OWN, Asked, Cases
from truepose.studies.functions import function_of, require_keys
from truepose.studies.storage import Storage
from truepose.threads import cores


@dataclass(frozen=True, repr=False)
class Study(Shown):
    """Results of all cases, in their order; independent of the number of workers."""

    columns: dict[str, Array]  #: robot, number, grid keys, function results; error or ""
    grid: tuple[str, ...]  #: names of the grid

    def __len__(self) -> int:
        return len(self.columns["robot"])

    @property
    def failed(self) -> Array:
        """Cases that raised an error of truepose, (N,) bool."""
        return self.columns["error"] != ""

    @property
    def unanswered(self) -> Array:
        """Cases without an answer, (N,) bool: failed, or with a number that is not finite."""
        return self.failed | ~np.all([self._finite(name) for name in self._numbers], axis=0)

    @property
    def _numbers(self) -> list[str]:
        own = {*OWN, *self.grid}
        return [k for k, v in self.columns.items() if k not in own and v.dtype.kind in "fiub"]

    def _finite(self, name: str) -> Array:
        return ~self.failed & np.isfinite(self.columns[name].astype(float))

    def _points(self) -> Iterator[tuple[tuple[str, ...], Array]]:
        """Yield robot and values of the grid, and the rows that have them, (N,) bool."""
        keys = ("robot", *self.grid)
        words = list(zip(*(map(str, self.columns[key]) for key in keys), strict=True))
        for point in dict.fromkeys(words):
            yield point, np.array([word == point for word in words])

    def _answers(self, name: str, rows: Array) -> Array:
        """Return the finite numbers of some rows."""
        if name not in self.columns:
            return np.zeros(0)
        return self.columns[name][rows & self._finite(name)].astype(float)

    def table(self) -> Table:
        """Return rms, median and 95 % of every number, for each robot and point of the grid.

        Cases without an answer are counted, but not part of these.
        """
        rows = []
        for point, these in self._points():
            count = int(these.sum())
            for name in self._numbers if (these & ~self.failed).any() else ["–"]:
                values, parts = self._answers(name, these), [None] * 3
                if len(values):
                    parts = [np.sqrt(np.mean(values**2)), *np.percentile(values, (50, 95))]
                spread = map(number, parts)
                rows.append([*point, name, str(count), str(count - len(values)), *spread])
        head = ["robot", *self.grid, "asked", "robots", "no answer", "rms", "median", "95 %"]
        title = f"Results over {len(self)} {'cases' if self.grid else 'robots'} "
        title += f"({self.unanswered.sum()} without an answer)"
        return Table("study", title, head, rows)

    def _draw(self, figure: Any) -> None:
        panels: dict[str, dict[str, dict[str, Array]]] = {}
        for name in self._numbers:
            unit = name.rpartition("_")[2] if "_" in name else "–"
            series = panels.setdefault(f"result ({unit})", {}).setdefault("5, 50, 95 %", {})
            for point, these in self._points():
                values = self._answers(name, these)
                values = values if len(values) else np.array([np.nan])
                series[" ".join((*point, name))] = np.percentile(values, (5, 50, 95))
        for axes in ranges(figure, panels or {"result (–)": {"none": {}}}, "case"):
            axes.set_xlim(left=0)


def monte_carlo(
    function: Asked | str,
    robots: Robot | str | Sequence[Robot | str],
    count: int = 100,
    *,
    grid: Mapping[str, Sequence[Any]] | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    chunk: int | None = None,
    workers: int | None = None,
    cluster: Any = None,
    progress: Callable[[int, int], None] | None = None,
) -> Study:
    """Evaluate a function over many robots sampled from their tolerances, in parallel.

    Each answer depends on its case alone: the same seed gives the same numbers on any number of
    workers, here or on a cluster. With `out` an interrupted study continues where it stopped, and
    a larger `count` extends it.

    Parameters
    ----------
    function : callable or str
        function(case) -> {name: number}, of a :class:`truepose.studies.cases.Case` with nominal
        ``robot``, ``true`` robot, ``rng`` and ``values``, the point of the grid, of which it must
        read every key. Or a built-in, "rest" or "calibration", or "file.py:name". Processes must
        be able to import a callable; a file's text is sent along.
    robots : Robot, str, or sequence of them
        Nominal robots; `count` true ones are sampled from each.
    count : int
        True robots of each.
    grid : mapping of sequences, optional
        Values whose every combination is evaluated for every true robot. "calibration" uses
        ``poses``, the number of poses it calibrates on (40 without a grid); "rest" uses ``law``.
    seed : int
        Seed of everything random.
    out : path, optional
        Folder for the results (Parquet, with pyarrow); None stores nothing.
    chunk : int, optional
        Cases per task of a worker; by default as many as take about a second.
    workers : int, optional
        Processes; all cores by default, 0: here, one case after another.
    cluster : str, dask cluster or client, optional
        Address of a dask scheduler, as ``tcp://host:8786``; its workers do the work.
    progress : callable, optional
        Function of the number of cases done and of their total.

    Raises
    ------
    InputError
        A function, robots or a grid that cannot be used, a folder of another study, no scheduler,
        workers of other versions, or a function that fails: the case is named.

    Examples
    --------
    >>> import truepose as tp
    >>> found = tp.monte_carlo("rest", "3rrr", count=4, workers=0)
    >>> len(found), bool(found.failed.any())
    (4, False)
    """
    asked = function_of(function) if isinstance(function, str) else function
    kinds = (robots,) if isinstance(robots, Robot | str) else robots
    loaded = tuple(load(r) if isinstance(r, str) else r for r in kinds)
    cases = Cases(loaded, dict(grid or {}), seed)
    require_keys(asked, cases.grid, cases.robots)
    whole("study: count", count, 1)
    if chunk is not None:
        whole("study: chunk", chunk, 1)
    total = count * cases.each
    kept = None if out is None else Storage(Path(out), cases, asked)
    from truepose.studies.workers import Workers  # of processes

    done = {number: row for number, row in kept.rows.items() if number < total} if kept else {}
    progress = progress or (lambda done, total: None)
    progress(len(done), total)
    team = Workers(cores() if workers is None else workers, cluster)
    ask = functools.partial(cases.ask, asked)
    try:
        with contextlib.closing(team.each(ask, _missing(done, total), chunk)) as answers:
            for start, rows in answers:
                if kept:
                    kept.add(start, rows)
                done |= dict(enumerate(rows, start))
                progress(len(done), total)
    finally:
        if kept:
            kept.flush()
    every = [done[number] for number in range(total)]
    missing: dict[str, Any] = dict.fromkeys(
        (name for row in every for name in row if name != "error"), np.nan
    )
    missing |= {"error": ""}
    columns = {k: np.array([row.get(k, none) for row in every]) for k, none in missing.items()}
    return Study(columns, tuple(cases.grid))


def _missing(done: Collection[int], total: int) -> Iterator[tuple[int, int]]:
    """Yield start and stop of each run of cases that are not done."""
    ends = [-1, *sorted(done), total]
    for last, following in itertools.pairwise(ends):
        if following > last + 1:
            yield last + 1, following
