"""`truepose simulate`: a move or a path of a robot that differs from its model."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.console import Console

from truepose import files, logs
from truepose.arguments import Array
from truepose.commands.options import (
    Faults,
    Force,
    How,
    RobotName,
    Seed,
    SensorsOption,
    completing,
    effects_of,
    effects_option,
    faults_of,
    load_with,
    parse_pose,
    plot_to,
    true_robot,
    wrote,
)
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError, PoseError
from truepose.faults.monitor import FaultMonitor
from truepose.logs.pose_file import read_poses, read_samples
from truepose.robot import laws
from truepose.robot.frames import frames
from truepose.robot.laws import Law
from truepose.robot.robot import Robot, list_robots
from truepose.robotfile import path_of
from truepose.show.results import figure_of
from truepose.show.table import Cell, Table, number
from truepose.show.terminal import Format, show
from truepose.simulation import paths
from truepose.simulation.drive import controller_of
from truepose.simulation.figures import draw_errors, error_table
from truepose.simulation.moves import MOVE_DURATION, default_move
from truepose.simulation.plants import Visit
from truepose.simulation.simulate import Simulation, simulate
from truepose.simulation.visit import visit

#: Poles of a controller that visits poses without effects, rad/s, and the velocity filter's
#: bandwidth over the poles, for visits and with effects.
VISITING, BANDWIDTH = 40.0, 7.5
#: Duration and hold of a move, and of a path's way from pose to pose, s.
MOVE, VISIT = (MOVE_DURATION, 0.2), (0.5, 0.4)


def command(
    robot: RobotName,
    start: Annotated[
        str | None,
        typer.Option("--from", metavar="X,Y,…", help="Start pose, m and rad."),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option(
            "--to", metavar="X,Y,…", help="End pose.", show_default="inside the workspace"
        ),
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Instead: CSV file of poses to visit in turn, a column for each coordinate, m and "
            "rad; the log has the readings at rest. With a column time, s, the robot passes the "
            "poses at these times, and the log has every cycle."
        ),
    ] = None,
    way_points: Annotated[
        Path | None,
        typer.Option(
            help="Instead: CSV file of poses to move through, with a stop at each; the log has "
            "every cycle."
        ),
    ] = None,
    circle: Annotated[
        str | None,
        typer.Option(
            metavar="R,HZ[,TURNS]",
            help="Instead: a horizontal circle about the pose of --from (default: home), m and "
            "turns per second.",
        ),
    ] = None,
    law: Annotated[
        Law | None,
        typer.Option(
            help="Control law; joint is standard control, tej the paper's law.",
            show_default="tej; joint where no sensor is in use",
        ),
    ] = None,
    true: Annotated[
        str,
        typer.Option(
            help="True robot: drawn = sampled from the file's tolerances, nominal, or a robot's "
            "name or file.",
            autocompletion=completing(lambda: ("drawn", "nominal", *list_robots())),
        ),
    ] = "drawn",
    effects: Annotated[
        str,
        effects_option("Effects that the model omits: all, none, or some: friction,delay,…"),
    ] = "none",
    fault: Faults = None,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Fault monitor: continue or stop when a reading is faulty."),
    ] = False,
    seed: Seed = 0,
    sensors: SensorsOption = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Duration of a move, s.", show_default="0.2; visiting 0.5 each"),
    ] = None,
    hold: Annotated[
        float | None, typer.Option(help="Hold after it, s.", show_default="0.2; visiting 0.4 each")
    ] = None,
    frequency: Annotated[
        float | None,
        typer.Option(
            help="Poles of the PD, rad/s.",
            show_default="150, visiting 40; with effects the fastest with margins",
        ),
    ] = None,
    since: Annotated[
        float, typer.Option(help="Time since switch-on of the cold robot, s (warm-up).")
    ] = 0.0,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Log to write: .csv, .parquet or .mcap."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw the errors (PNG, SVG, PDF).")] = None,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Simulate a robot with geometric errors under a controller; print its pose errors.

    The controller uses the nominal robot. The true robot is sampled from the tolerances of the
    file, every rod separately, and its encoders are quantized. Without **--to** it makes a default
    move. The log's columns have the names that **truepose calibrate** reads. A path that the robot
    cannot follow is refused before the start.

    Example: **truepose simulate h4 --law estimated --effects friction,compliance -o move.csv**,
    then **truepose simulate h4 --fault theta:stuck@0.05 --watch**
    """
    inputs: list[str | Path] = [robot, *(file for file in (path, way_points) if file)]
    inputs += [] if true in ("drawn", "nominal") else [true]
    save = plot_to(plot, inputs, force)
    read = [path_of(str(name)) for name in inputs]
    log = None if out is None else logs.check(out, read, force)
    believed = load_with(robot, sensors)
    truth = true_robot(believed, true, seed)
    forgotten = None if effects == "none" else effects_of(effects)
    motion, x_d = _asked(believed, path, way_points, circle, start, end, duration)
    law = laws.usual(believed) if law is None else law
    controller = _controller(believed, law, forgotten, frequency, visiting=x_d is not None)
    usual = MOVE if x_d is None else VISIT
    duration, hold = (u if g is None else g for u, g in zip(usual, (duration, hold), strict=True))
    settings: dict[str, Any] = {"duration": duration, "hold": hold, "seed": seed, "time": since}
    settings["faults"] = faults = faults_of(fault)
    settings["watch"] = FaultMonitor(effects=forgotten) if watch else None
    errors = Console(stderr=True)
    with errors.status("simulating") if errors.is_terminal else nullcontext():
        if x_d is not None:
            run = _path(believed, truth, controller, x_d, effects=forgotten, **settings)
        elif motion is not None:
            run = _follow(believed, truth, controller, motion, effects=forgotten, **settings)
        else:
            ends = [
                None if text is None else parse_pose(believed, text, option, False)
                for option, text in (("--from", start), ("--to", end))
            ]
            run = _move(believed, truth, controller, *ends, effects=forgotten, **settings)
    torque = run.log.torque if isinstance(run.log, Simulation) else None
    asked = (believed, run.over, run.error, torque)
    save(lambda: figure_of(lambda figure: draw_errors(figure, *asked)))
    if log is not None:
        columns = logs.columns(run.log, truth)
        files.write({log: logs.encoded(log.path, columns)}, read, force)
    who = f"true robot {f'sampled with seed {seed}' if true == 'drawn' else true}"
    if faults:
        who += f", faults {', '.join(map(str, faults))}"
    poles = f"{controller.frequency:.3g} rad/s"
    answer = f"{believed.name}, law {law}, poles {poles}, {who}: {run.status}"
    show(run.tables, how, [answer], more=sum(p is not None for p in (out, plot)))
    wrote(how, out, plot)


def _controller(
    robot: Robot, law: Law, effects: Effects | None, frequency: float | None, *, visiting: bool
) -> Controller:
    soft = visiting or effects not in (None, Effects.none())
    if frequency is not None:
        ratio = BANDWIDTH if soft else 10.0
        return Controller(law=law, frequency=frequency, velocity_bandwidth=ratio * frequency)
    if visiting and effects in (None, Effects.none()):
        return Controller(law=law, frequency=VISITING, velocity_bandwidth=BANDWIDTH * VISITING)
    return controller_of(law, robot, effects)


class Run(NamedTuple):
    """Result of a simulation: a move's N cycles, or a path's N poses."""

    log: Simulation | Visit
    over: Array  #: (N,) time, s, or number of the pose
    error: Array  #: (N, n) true − desired; NaN where a pose was not reached
    robot: Robot
    tables: list[Table]
    status: str


def _asked(
    robot: Robot,
    path: Path | None,
    way_points: Path | None,
    circle: str | None,
    start: str | None,
    end: str | None,
    duration: float | None,
) -> tuple[paths.Path | None, Array | None]:
    """Return the path to follow, or the poses to visit; neither for a plain move."""
    given = {"--path": path, "--way-points": way_points, "--circle": circle}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{named[0]}, {named[1]}: name one of them")
    if named and (end is not None or (start is not None and circle is None)):
        left = "--to" if circle is not None else "--from and --to"
        raise InputError(f"{named[0]}: defines all poses: leave out {left}")
    if path is not None:
        time, x_d = read_samples(robot, path)
        return (None, x_d) if time is None else (paths.SampledPath(time=time, x=x_d), None)
    each = MOVE_DURATION if duration is None else duration
    if way_points is not None:
        return paths.Waypoints(poses=read_poses(robot, way_points), duration=each), None
    if circle is not None:
        centre = robot.home if start is None else parse_pose(robot, start, "--from", False)
        return _circle(circle, centre), None
    return None, None


def _circle(text: str, centre: Array) -> paths.Circle:
    try:
        radius, frequency, *turns = (float(part) for part in text.split(","))
        (turns_,) = turns or (1.0,)
    except ValueError:
        raise InputError(f"--circle {text}: must be radius, turns per second, and turns") from None
    return paths.Circle(centre=centre, radius=radius, frequency=frequency, turns=turns_)


def _follow(
    robot: Robot, truth: Robot, controller: Controller, path: paths.Path, **settings: Any
) -> Run:
    run = simulate(robot, truth, controller, path=path, **settings)
    return Run(run, run.time, run.error, robot, [run.table(), _motors(robot, run)], run.status)


def _move(
    robot: Robot,
    truth: Robot,
    controller: Controller,
    start: Array | None,
    end: Array | None,
    **settings: Any,
) -> Run:
    if start is None or end is None:
        usual = default_move(robot)
        start, end = usual[0] if start is None else start, usual[1] if end is None else end
    run = simulate(robot, truth, controller, start=start, end=end, **settings)
    return Run(run, run.time, run.error, robot, [run.table(), _motors(robot, run)], run.status)


def _motors(robot: Robot, run: Simulation) -> Table:
    rows = []
    for k, chain in enumerate(robot.spec.chain):
        turns, most = chain.actuator == "revolute", float(np.abs(run.torque[:, k]).max())
        unit = "N·m" if turns else "N"
        rows.append([Cell(f"{k + 1} ({unit})", {"motor": k + 1, "unit": unit}), number(most)])
        rows[-1].append(number(chain.torque_limit or np.inf))
    title = "Torques and forces of the motors"
    return Table("motors", title, ["motor", "largest", "limit"], rows)


def _path(robot: Robot, truth: Robot, controller: Controller, x_d: Array, **settings: Any) -> Run:
    x, q_e, status = visit(robot, truth, x_d, controller, **settings)
    reached = np.isfinite(x).all(axis=1)
    words = f"{reached.sum()} of {len(x)} poses reached"
    for reason in dict.fromkeys(status[status != "ok"].tolist()):
        poses = np.flatnonzero(status == reason)
        words += f"; pose {poses[0]}" + f" and {len(poses) - 1} more" * (len(poses) > 1)
        words += f": {reason}"
    if not reached.any():
        raise PoseError(f"{robot.name}: {words}")
    errors = error_table(robot, x - x_d)
    log = Visit(q_e, frames(truth, x), x, status)
    return Run(log, np.arange(len(x)), x - x_d, robot, [errors], words)
