"""`truepose monte-carlo`: a function evaluated on many sampled robots."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.options import How, Seed, SensorsOption, load_with
from truepose.exceptions import InputError
from truepose.show.terminal import Format, say, show
from truepose.studies.functions import ASKED, LEARNT
from truepose.studies.study import monte_carlo
from truepose.studies.workers import On

#: What the numbers of ready questions are.
MEANING = {
    "calibration": f"Each robot's rms over {ASKED} poses, calibrated on other poses ({LEARNT} where"
    " the grid names no number); bound: 1σ rms of the same poses. Compare the column rms: a robot's"
    " errors scatter about its bound, so medians differ.",
    "rest": f"Each robot's rms over {ASKED} poses of its workspace, at rest: true less desired.",
}


def command(
    function: Annotated[
        str,
        typer.Argument(
            help="calibration: what robots are off by after they calibrated themselves; rest: where"
            " they come to rest under each law; or your own, file.py:function."
        ),
    ],
    robots: Annotated[list[str], typer.Argument(help="Shipped robots' names, or robot files.")],
    count: Annotated[int, typer.Option(min=1, help="True robots to draw of each.")] = 100,
    sensors: SensorsOption = None,
    grid: Annotated[
        list[str] | None,
        typer.Option(
            help="name=value,value,…: every combination is asked of every robot. Names are those "
            "that the function reads from case.values; calibration: poses; rest: none."
        ),
    ] = None,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder that keeps what is done; a study goes on from it."
        ),
    ] = None,
    chunk: Annotated[int, typer.Option(min=1, help="Cases that a worker does at a time.")] = 16,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Processes; 0: none but this one.", show_default="all cores"),
    ] = None,
    on: Annotated[On, typer.Option(help="What works side by side here.")] = "processes",
    cluster: Annotated[
        str | None, typer.Option(help="Address of a dask scheduler: tcp://host:8786.")
    ] = None,
    how: How = Format.table,
) -> None:
    """Ask one question of many robots drawn from their tolerances; rms, medians and 95 %.

    Numbers do not depend on how many workers there are. A study that was ended goes on from there.

    Example: **truepose monte-carlo calibration h4 par4 --count 200 -o my-study**
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    errors = Console(stderr=True)
    columns = (TextColumn("chunks"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=errors, disable=not errors.is_terminal) as bar:
        task = bar.add_task("chunks", total=None)
        found = monte_carlo(
            function,
            [load_with(robot, sensors) for robot in robots],
            count,
            grid=dict(map(_values, grid or ())),
            seed=seed,
            out=out,
            chunk=chunk,
            workers=workers,
            on=on,
            cluster=cluster,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    show([found.table()], how)
    if missing := int(found.unanswered.sum()):
        said = [*found.columns["error"][found.failed], "a result is not finite (NaN)"]
        say(f"{missing} of {len(found)} cases had no answer; the first: {said[0]}", err=True)
    if function in MEANING:
        say(MEANING[function], how)
    if out:
        say(f"Kept in {out}", how)


def _values(text: str) -> tuple[str, list[float | int | str]]:
    """Read name=value,value,….

    Examples
    --------
    >>> _values("law=joint,tej"), _values("poses=10,20")
    (('law', ['joint', 'tej']), ('poses', [10, 20]))
    """
    name, equals, values = text.partition("=")
    if not (name and equals and values):
        raise InputError(f"--grid {text}: must be name=value,value,…")

    def value(word: str) -> float | int | str:
        for kind in (int, float):
            with contextlib.suppress(ValueError):
                return kind(word)
        return word

    return name, [value(word.strip()) for word in values.split(",")]
