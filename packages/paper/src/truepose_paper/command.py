"""`truepose reproduce`."""

import time
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.options import Output
from truepose.exceptions import InputError
from truepose.show.terminal import progress


def command(
    robots: Annotated[
        int, typer.Option(min=1, max=10_000, help="True robots sampled from the paper's errors.")
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampled robots and errors.")] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for report.html, figures (SVG, PNG) and numbers (CSV).")
    ] = Path("truepose-report"),
    full: Annotated[
        bool,
        typer.Option("--full", help="Calibrate 200 robots or more per sensor set, machined too."),
    ] = False,
    experiment: Annotated[bool, typer.Option("--experiment", hidden=True)] = False,
    life: Annotated[bool, typer.Option("--life", hidden=True)] = False,
    output: Output = Output(),
) -> None:
    """Run the paper end to end: Table 3, a verdict on each claim, and a report.

    The H4 makes the 0.2 s move of Figures 11 to 13 under joint, TEJ and Cartesian control, and
    after its own calibration. Many robots, sampled from the paper's errors, settle at the 625 poses
    of Table 2; so does a twin of the paper's robot, measured as the paper did. Robots with an error
    in every rod settle with each sensor set, as built and calibrated. --all adds the errata and
    more tables. --full takes minutes; an interrupted run resumes.

    Example: **truepose reproduce --robots 100 --seed 0 --out my-report**
    """
    if life:
        raise InputError("--life: is the command truepose life, of the package truepose-life")
    if experiment:
        raise InputError("--experiment: every report has the twin's experiment; omit the option")
    from truepose_paper import claims, report, screen, tables
    from truepose_paper.parts import Parts
    from truepose_paper.reproduce import reproduce

    start = time.perf_counter()
    with report.folder(out, output.force) as work, progress("robots") as bar:
        beside = out / "parts.jsonl" if out.exists() else out.with_name(f"{out.name}.parts.jsonl")
        parts = Parts(beside, robots=robots, seed=seed, full=full)

        def step(what: str, done: int, total: int) -> None:
            bar(description=what, completed=done, total=total)

        result = reproduce(robots, seed, step, full, parts)
        report.write(result, work, step)
        parts.clear()
    elapsed = time.perf_counter() - start
    done = f"{robots} robots, seed {seed}, {elapsed:.0f} s; report: {out / report.PAGE}"
    first, more = tables.results(result)
    if output.data:
        output.show([*first, *more], [done])
        return
    if output.everything:
        output.show(more, notes=claims.REASONS)
    print("\n".join([*screen.lines(result), f"{done}; errata: --all"]))  # last: Table 3, verdicts
