"""`truepose simulate-log` and `truepose monte-carlo`: robots sampled from a file's tolerances."""

import re
import shlex
from math import isnan
from pathlib import Path

import numpy as np
from typer import Argument, Option

from truepose import logs
from truepose.arguments import finite_rows
from truepose.commands import options
from truepose.exceptions import InputError
from truepose.files import mark
from truepose.robot import Robot, in_print, knowledge, list_robots, load, summed
from truepose.show import Table, fixed, named, tabled
from truepose.show.terminal import Printing, progress, say
from truepose.simulation.simulated_log import Missed, SimulatedLog, missed, simulate_log
from truepose.studies.functions import ASKED, LEARNT
from truepose.studies.study import monte_carlo

#: Effects in the readings of a cold robot at rest.
AT_REST = ("backlash", "eccentricity", "quantization")


def simulate_log_command(
    robot: options.RobotName,
    out: Path = Option(
        Path("simulated.csv"), "-o", "--out", help="Log to write: .csv, .parquet or .mcap."
    ),
    truth: Path | None = Option(
        None, help="File of the true robot.", show_default="beside the log, as OUT.truth.toml"
    ),
    found: Path | None = Option(
        None, help="Calibrated robot file: print its errors against the true robot; write nothing."
    ),
    count: int = Option(
        100, min=1, max=100_000, help="Number of poses, sampled from the workspace."
    ),
    seed: options.Seed = 0,
    sensors: options.SensorsOption = None,
    tracker: bool | None = Option(
        None,
        "--tracker/--no-tracker",
        help="Simulate an external tracker in a frame of its own.",
        show_default="where no sensor is in use",
    ),
    effects: str = options.effects_option(
        "quantization", f"Effects on a robot at rest: {', '.join(AT_REST)}, all or none.", AT_REST
    ),
    output: options.Output = options.Output(),
) -> None:
    """Simulate a calibration log of a robot sampled from the file's tolerances.

    The true robot has an error in every rod; it moves through its workspace and is read at rest.
    Its file is written beside the log; **--found** compares a calibrated file with it.

    Example: **truepose simulate-log h4 -o log.csv**, then **truepose calibrate h4 log.csv -o
    calibrated.toml**, then **truepose simulate-log h4 -o log.csv --found calibrated.toml**
    """
    kept = truth or out.with_suffix(".truth.toml")
    if found is not None:
        drawn = load(robot)
        result = missed(drawn, load(kept), load(found), seed)
        low, high = result.nees_range
        said = (
            f"This is one robot. In {100 * result.worse:.0f} % of such robots the pose error by "
            "the motors is larger after such a calibration than before.",
            f"Squared error of all {len(result.names)} parameters by the stated covariance: "
            f"{result.nees:.1f}; if that is correct, {low:.0f} to {high:.0f} in 95 % of "
            "calibrations.",
        )
        output.show([_poses(drawn, result), _parameters(drawn, result)], said)
        return
    drawn = options.load_with(robot, sensors)
    output.check([robot], log=out, truth=kept)
    ran = simulate_log(
        drawn,
        options.true_robot(drawn, "sampled", seed),
        count,
        seed,
        options.effects_of(effects, AT_REST),
        tracker=not drawn.sensors if tracker is None else tracker,
    )
    text = f"# {mark('true robot')}, sampled with seed {seed}\n{options.file_text(ran.truth)}"
    output.write(log=lambda: _columns(ran), truth=lambda: text)
    calibrated, names = out.with_suffix(".calibrated.toml"), drawn.sensors
    chosen = ["--sensors", ",".join(names) or "none"] if names != load(robot).sensors else []
    where = ["--truth", kept] if truth else ["-o", out] if out.name != "simulated.csv" else []
    output.show([])  # what it writes is in files
    for when, *words in (
        ("Next", "calibrate", robot, out, *chosen, "-o", calibrated),
        ("Then", "simulate-log", robot, *where, "--found", calibrated),
    ):
        say(f"{when}: {shlex.join(['truepose', *map(str, words)])}", output.how)


def _columns(ran: SimulatedLog) -> list[logs.writing.Column]:
    result = logs.writing.readings(ran.truth, ran.q_e)
    if ran.measured is None:
        return result
    what = "{} of a marker on the platform, in the tracker's frame"
    if not ran.truth.spec.framed:
        what = "{}, measured externally"
    return result + [
        logs.writing.Column("measured", f"measured_{name}", unit, what.format(name), values)
        for (name, unit), values in zip(ran.truth.coordinates, ran.measured.T, strict=False)
    ]


def _poses(robot: Robot, result: Missed) -> Table:
    """Return a table of the pose errors beside the predicted ones, columns of zeros left out."""
    rows, total = [], summed(robot)
    other = (
        ("predicted rms (°)",)
        if total.unit == "m"
        else ("predicted relative (mm)", "predicted rms (mm)")
    )
    for who, apart in result.pose.items():
        shown = apart[finite_rows(apart)] * [1e3, 1e3, 180 / np.pi]
        position, zeroed, turn = np.sqrt((shown**2).mean(axis=0))
        sigma, relative = (total.factor * value for value in result.predicted[who])
        row = {
            "relative to home (mm)": zeroed,
            "predicted relative (mm)": relative,
            "position rms (mm)": position,
            "predicted rms (mm)": sigma,
            "largest (mm)": shown[:, 0].max(),
            "rotation rms (°)": turn,
            "predicted rms (°)": sigma,
        }
        rows.append({"robot": who} | row)
    some = [name for name in rows[0] if name not in other and any(row[name] for row in rows)]
    title = "Pose error of the true robot (reached − commanded)"
    return tabled("pose", title, [{name: row[name] for name in some} for row in rows])


def _parameters(robot: Robot, result: Missed) -> Table:
    """Return a table of each parameter's error."""
    rows, columns = [], (result.before, result.after, result.sigma)
    for name, *values in zip(result.names, *columns, strict=True):
        factor, unit = in_print(robot, name)
        cells = [fixed(factor * v, 4) for v in values]
        rows.append([named("parameter", name, unit), *cells, fixed(values[1] / values[2])])
    header = ["parameter", "nominal", "calibrated", "σ", "calibrated / σ"]
    return Table("parameters", "Parameter errors (value − true value)", header, rows)


#: Notes on the results of the built-in functions.
MEANING = {
    "calibration": f"Each robot's rms over {ASKED} poses, calibrated on other poses (by default"
    f" {LEARNT}); bound: 1σ rms of the same poses. Compare the column rms: the"
    " errors scatter about the bound, so medians differ.",
    "rest": f"Each robot's rms over {ASKED} poses of its workspace, at rest: true − desired.",
}


def study_command(
    function: str = Argument(
        help="calibration: errors after self-calibration; rest: errors of the static"
        " equilibrium under each law; or your own function, file.py:function."
    ),
    robots: list[str] = Argument(help="Shipped robots' names, or robot files."),
    count: int = Option(
        100, "--robots", "--count", min=1, help="True robots to sample of each (before: --count)."
    ),
    sensors: options.SensorsOption = None,
    grid: list[str] | None = Option(
        None,
        help="name=value,value,…: evaluates every combination for every robot. Names: those "
        "that the function reads from case.values; calibration: poses; rest: law.",
    ),
    seed: options.Seed = 0,
    out: Path | None = Option(
        None, "--out", "-o", help="Folder of the results; an interrupted study resumes from it."
    ),
    chunk: int | None = Option(
        None, min=1, help="Cases per task of a worker.", show_default="about a second of work"
    ),
    workers: int | None = Option(
        None, min=0, help="Processes; 0: only this one.", show_default="all cores"
    ),
    cluster: str | None = Option(None, help="Address of a dask scheduler: tcp://host:8786."),
    output: Printing = Printing(),
) -> None:
    """Evaluate a function over many robots sampled from their tolerances.

    Prints rms, medians and 95th percentiles, which do not depend on the number of workers. A study
    that was interrupted resumes.

    Example: **truepose monte-carlo calibration h4 par4 --robots 200 -o my-study**
    """
    if function in list_robots():
        raise InputError(f"{function}: is a robot; the function is first: monte-carlo rest h4")
    sampled = [options.load_with(robot, sensors) for robot in robots]
    for robot in sampled if function in MEANING else ():
        knowledge.require_uncertain(robot)  # else every result is 0
    with progress("cases") as bar:
        found = monte_carlo(
            function,
            sampled,
            count,
            grid=dict(map(_values, grid or ())),
            seed=seed,
            out=out,
            chunk=chunk,
            workers=workers,
            cluster=cluster,
            progress=lambda done, total: bar(completed=done, total=total),
        )
    output.show([found.table()], [MEANING[function]] if function in MEANING else [])
    if missing := int(found.unanswered.sum()):
        said = [*found.columns["error"][found.failed], "a result is not finite (NaN)"]
        say(f"{missing} of {len(found)} cases had no answer; the first: {said[0]}", err=True)
    if out:
        say(f"Kept in {out}", output.how)


def _values(text: str) -> tuple[str, list[float | int | str]]:
    """Parse name=value,value,…."""
    name, equals, values = text.partition("=")
    if not (name and equals and values):
        raise InputError(f"--grid {text}: must be name=value,value,…")
    return name, [_value(word.strip()) for word in values.split(",")]


def _value(word: str) -> float | int | str:
    value = options.number_of(word)
    return word if isnan(value) else int(word) if re.fullmatch(r"[+-]?\d+", word) else value
