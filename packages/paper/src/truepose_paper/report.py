"""Report of the reproduction: a folder with one self-contained page, figures and numbers."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import uuid
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from truepose import files, logs
from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.show import page
from truepose.show.table import as_csv
from truepose.simulation.paths import MOVE_TO
from truepose_paper import article, claims, experiment, figures, sensor_sets, tables, twin
from truepose_paper.experiment import CONTROLS
from truepose_paper.plotted import plotted
from truepose_paper.reproduce import Reproduction

PAGE = "report.html"
#: File endings in the folder.
_ENDINGS = (".html", ".svg", ".png", ".csv", ".parquet", ".mcap")


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
    images = {}
    drawn = _figures(result)
    for done, (name, draw) in enumerate(drawn.items(), 1):
        images[name] = _save(draw(), out / name)
        progress("figures", done, len(drawn))
    numbers = [
        claims.claims(result),
        tables.table3(result),
        tables.sensors(result),
        claims.errata(),
        tables.many_robots(result),
        tables.gains(result),
        tables.moves(result),
        tables.sensing(result.sensing),
        *([tables.warm_up(result.warm_up)] if result.warm_up else []),
        *tables.following(result.following),
        tables.faults(result.faults),
        *(tables.twin_tables(result.section) if result.section else ()),
    ]
    for table in numbers:
        data = table.columns(0, 1, 3, 4) if table.name == "claims" else table  # words alone
        _csv(out / f"{table.name}.csv", data.records())
    _raw_numbers(result, out)
    if result.section:
        _logs(result.section, out)
    found, section = result.experiment, result.section
    norms = np.sqrt(found.ratio("norm_xyz", "sum_sq"))
    text = page.render(
        "report.html.j2",
        "truepose_paper",
        images=images,
        tables={table.name: table for table in numbers},
        **vars(result),
        robots=len(found.truths),
        reasons=claims.REASONS,
        scatter={law: tables.theta_scatter(law) for law in ("usual", "redundant")},
        ratio=float(np.median(found.ratio("theta", "sum_sq"))),
        displaced=float(np.median(experiment.moved_by_tej(found, MOVE_TO))),
        squares={
            "printed": article.table3()["usual"]["theta", "sum_sq"],
            "drawn": float(np.median(found.tables["joint"][:, 3, 2])),
        },
        norm=float(np.median(norms)),
        norms=np.percentile(norms, [5, 95]),
        promised=result.sensing[0].bound / result.sensing[0].rms["joint"],
        left=experiment.theta_law(result.robot, found.poses),
        errors=article.simulation_errors(),
        locations=article.locations(),
        machined=sensor_sets.MACHINED,
        real=len(result.sensing[0].each["joint"]),
        own=len(result.sensing[0].each["self-calibrated"]),
        most=sensor_sets.ROBOTS,
        several=len(result.following[0].each),
        moved=len(result.faults[0].alone["joint"]),
        thermal=Effects(),
        judged=len(found.poses[:: sensor_sets.EVERY]),
        learnt=float(np.median(np.sqrt(found.ratio("norm_xyz", "sum_sq", "self-calibrated")))),
        bias=twin.BIAS,
        setup=describe(section.twin) if section else None,
        csv=sorted(file.name for file in out.glob("*.csv")),
        versions=page.versions(),
    )
    (out / PAGE).write_text(text, encoding="utf-8")


def _figures(result: Reproduction) -> dict[str, Callable[[], Figure]]:
    """Return the function that draws each figure, by its name."""
    moves, found, section = result.moves, result.experiment, result.section
    drawn: dict[str, Callable[[], Figure]] = {"robot": result.robot.plot}
    drawn["figures-11-13"] = partial(figures.moves, [moves[f"figure-{k}"] for k in (11, 12, 13)])
    drawn["poses"] = partial(figures.poses, found)
    drawn["following"] = partial(figures.following, result.following)
    drawn["faults"] = partial(figures.faults, result.faults)
    for plant, runs in section.runs.items() if section else ():
        drawn[f"experiment-{plant.lower()}"] = partial(figures.twin_poses, runs)
    return drawn


def describe(of: twin.Twin) -> dict[str, float]:
    """Return the properties of a twin's vision system and gear, mm and degrees."""
    setup = of.setup
    return {
        "noise": setup.noise,
        "at_led": 1e3 * setup.noise * setup.pixel / setup.focal_length * setup.distance,
        "radius": 1e3 * float(np.hypot(*setup.leds[0][:2])),
        "backlash": float(np.degrees(of.effects.tool_backlash)),
        "shift": 1e3 * float(np.linalg.norm(setup.registration[3:])),
        "turn": float(np.degrees(np.linalg.norm(setup.registration[:3]))),
    }


def _save(figure: Figure, path: Path) -> str:
    """Save a figure as SVG, PNG and CSV; return the SVG as a data URI."""
    drawn = files.picture(figure, ".svg")
    path.with_suffix(".svg").write_bytes(drawn)
    path.with_suffix(".png").write_bytes(files.picture(figure, ".png"))
    if points := plotted(figure):
        _csv(path.with_suffix(".csv"), points)
    return page.as_uri(drawn)


def _csv(path: Path, records: Iterable[dict[str, object]]) -> None:
    path.write_text(as_csv(records), encoding="utf-8")


def _logs(section: twin.Section, out: Path) -> None:
    """Write every run as CSV, and as Parquet and MCAP where their packages are installed."""
    packages = {"csv": "csv", "parquet": "pyarrow", "mcap": "mcap"}
    endings = [ending for ending, name in packages.items() if importlib.util.find_spec(name)]
    for plant, runs in section.runs.items():
        for control, run in runs.items():
            for ending in endings:
                logs.write(run, out / f"experiment-{plant.lower()}-{control}.{ending}")


def _raw_numbers(result: Reproduction, out: Path) -> None:
    """Write statistics of every robot, poses of the first robot and samples of the moves."""
    _csv(
        out / "statistics.csv",
        (
            {"robot": robot, "control": control, "quantity": quantity, "statistic": statistic}
            | {"unit": tables.unit(quantity, statistic), "value": float(v)}
            for control in CONTROLS
            for robot, table in enumerate(result.experiment.tables[control])
            for quantity, row in zip(article.QUANTITIES, table, strict=True)
            for statistic, v in zip(article.STATISTICS, row, strict=True)
        ),
    )
    poses = _columns("{}_{}", experiment.in_print_units(result.experiment.poses))
    for control in CONTROLS:
        poses |= _columns(f"error_{control}_{{}}_{{}}", result.experiment.errors[control][0])
    _csv(out / "poses.csv", _rows(poses))
    for name, run in result.moves.items():
        columns = {"time_s": run.time}
        columns |= _columns("{}_desired_{}", experiment.in_print_units(run.x_d))
        columns |= _columns("{}_{}", experiment.in_print_units(run.x))
        columns |= {f"torque{i}_Nm": torque for i, torque in enumerate(run.torque.T, 1)}
        _csv(out / f"{name}.csv", _rows(columns))


def _columns(name: str, values: Array) -> dict[str, Array]:
    """Return coordinates, (N, 4), mm and degrees, by `name` filled with their names and units."""
    axes = {"x": "mm", "y": "mm", "z": "mm", "theta": "deg"}
    return {name.format(*axis): v for axis, v in zip(axes.items(), values.T, strict=True)}


def _rows(columns: dict[str, Array]) -> list[dict[str, object]]:
    rows = np.column_stack([*columns.values()]).tolist()
    return [dict(zip(columns, row, strict=True)) for row in rows]
