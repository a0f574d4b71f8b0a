"""Report of the reproduction: a folder with one self-contained page, figures and numbers."""

import contextlib
import os
import uuid
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from truepose import files, logs
from truepose.arguments import Array
from truepose.exceptions import InputError
from truepose.show import as_csv, page
from truepose.simulation.paths import MOVE_TO
from truepose_paper import article, claims, experiment, figures, sensor_sets, tables, twin
from truepose_paper.article import QUANTITIES, STATISTICS
from truepose_paper.reproduce import Reproduction

PAGE = "report.html"
#: File endings in the folder.
_ENDINGS = (".html", ".svg", ".png", ".csv")


@contextlib.contextmanager
def folder(out: Path, force: bool = False) -> Iterator[Path]:
    """Yield a folder to write into; its files move to `out` only if no error occurs.

    `out` does not exist, or has no files with the report's endings, unless `force` replaces them.
    InputError: `out` cannot be written or has such files; raised on entry, before the work.
    """
    there = os.path.lexists(out)
    base = out if there else next(parent for parent in out.absolute().parents if parent.exists())
    try:
        others = [p for p in sorted(out.iterdir()) if p.suffix in _ENDINGS] if there else []
        if others and not force:
            raise InputError(
                f"--out {out}: contains {others[0].name}; choose another folder, or --force"
            )
        files.check([files.Output(p, "result", "--out") for p in others], force=True)
        with files.unfinished(base / f".truepose-{uuid.uuid4().hex}") as work:
            work.mkdir()
            yield work
            out.mkdir(parents=True, exist_ok=True)
            places = {file: out / file.name for file in sorted(work.iterdir())}
            files.check([files.Output(p, "report") for p in places.values()], force=True)
            for file, place in places.items():
                os.replace(file, place)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written: {error.strerror}") from None


def write(
    result: Reproduction,
    out: Path,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> None:
    """Write report.html, the figures (SVG, PNG) and the numbers (CSV) into the folder `out`."""
    found, sensing = result.experiment, result.sensing
    first = {control: errors[0] for control, errors in found.errors.items()}
    seen = {control: run.errors("desired") for control, run in result.twin_runs.items()}
    drawn = {
        "robot": result.robot.plot(),
        "figures-11-13": figures.moves([result.moves[f"figure-{k}"] for k in (11, 12, 13)]),
        "poses": figures.poses(first, "error of "),
        "experiment": figures.poses(seen, "desired − measured, "),
    }
    images = {}
    for done, (name, figure) in enumerate(drawn.items(), 1):
        images[name] = _save(figure, out / name)
        progress("figures", done, len(drawn))
    shown, more = tables.results(result)
    for table in (*shown, *more):
        data = table.columns(0, 1, 3, 4) if table.name == "claims" else table  # words alone
        _csv(out / f"{table.name}.csv", data.records())
    _raw_numbers(result, out)
    text = page.render(
        "report.html.j2",
        "truepose_paper",
        images=images,
        tables={table.name: table for table in (*shown, *more)},
        **vars(result),
        robots=len(found.truths),
        reasons=claims.REASONS,
        scatter={law: tables.theta_scatter(law) for law in ("usual", "redundant")},
        ratio=float(np.median(found.ratio("theta", "sum_sq"))),
        displaced=float(np.median(experiment.moved_by_tej(found, MOVE_TO))),
        drawn=float(np.median(found.tables["joint"][:, 3, 2])),
        left=experiment.theta_law(result.robot, found.poses),
        errors=article.simulation_errors(),
        locations=article.locations(),
        machined=sensor_sets.MACHINED,
        real=len(sensing[0].each["joint"]),
        own=len(sensing[0].each["self-calibrated"]),
        most=sensor_sets.ROBOTS,
        judged=len(found.poses[:: sensor_sets.EVERY]),
        bias=twin.BIAS,
        setup=result.twin.described(),
        csv=sorted(file.name for file in out.glob("*.csv")),
        versions=page.versions(),
    )
    (out / PAGE).write_text(text, encoding="utf-8")


def _save(figure: Figure, path: Path) -> str:
    """Save a figure as SVG and PNG; return the SVG as a data URI."""
    drawn = files.picture(figure, ".svg")
    path.with_suffix(".svg").write_bytes(drawn)
    path.with_suffix(".png").write_bytes(files.picture(figure, ".png"))
    return page.as_uri(drawn)


def _csv(path: Path, records: Iterable[dict[str, object]]) -> None:
    path.write_text(as_csv(records), encoding="utf-8")


def _raw_numbers(result: Reproduction, out: Path) -> None:
    """Write statistics of every robot, poses of the first robot, the moves and the twin's runs."""
    found = result.experiment
    _csv(
        out / "statistics.csv",
        (
            {"robot": robot, "control": control}
            | {"quantity": key[0], "statistic": key[1], "unit": tables.unit(*key)}
            | {"value": float(value)}
            for control, of_robots in found.tables.items()
            for robot, table in enumerate(of_robots)
            for key, value in zip(product(QUANTITIES, STATISTICS), table.flat, strict=True)
        ),
    )
    poses = _columns("{}_{}", experiment.in_print_units(found.poses))
    for control, errors in found.errors.items():
        poses |= _columns(f"error_{control}_{{}}_{{}}", errors[0])
    _csv(out / "poses.csv", _rows(poses))
    for name, run in result.moves.items():
        columns = {"time_s": run.time}
        columns |= _columns("{}_desired_{}", experiment.in_print_units(run.x_d))
        columns |= _columns("{}_{}", experiment.in_print_units(run.x))
        columns |= {f"torque{i}_Nm": torque for i, torque in enumerate(run.torque.T, 1)}
        _csv(out / f"{name}.csv", _rows(columns))
    for control, seen in result.twin_runs.items():
        logs.write(seen, out / f"experiment-{control}.csv")


def _columns(name: str, values: Array) -> dict[str, Array]:
    """Return coordinates, (N, 4), mm and degrees, by `name` filled with their names and units."""
    axes = {"x": "mm", "y": "mm", "z": "mm", "theta": "deg"}
    return {name.format(*axis): v for axis, v in zip(axes.items(), values.T, strict=True)}


def _rows(columns: dict[str, Array]) -> list[dict[str, object]]:
    rows = np.column_stack([*columns.values()]).tolist()
    return [dict(zip(columns, row, strict=True)) for row in rows]
