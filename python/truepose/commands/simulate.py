"""`truepose simulate`: a move or a path of a robot that differs from its model."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from typer import Context, Option

from truepose import logs, moved
from truepose.arguments import Array, finite_rows
from truepose.commands import options
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.exceptions import InputError, PoseError
from truepose.faults.monitor import FaultMonitor
from truepose.logs.reading import read_poses, read_samples
from truepose.plugins import plugins
from truepose.robot import Law, Robot, laws
from truepose.show import Cell, Table, figure_of, tabled
from truepose.show.terminal import progress
from truepose.simulation.figures import draw_errors, error_table
from truepose.simulation.paths import MOVE_DURATION, Circle, SampledPath, Waypoints
from truepose.simulation.plants import Visit
from truepose.simulation.plants.dynamic import visit
from truepose.simulation.preparation import controller_of, require_within
from truepose.simulation.run import Run
from truepose.simulation.simulate import Simulation, simulate

#: Poles of a controller that visits poses without effects, rad/s, and the velocity filter's
#: bandwidth over the poles, for visits and with effects.
VISITING, BANDWIDTH = 40.0, 7.5
#: Duration and hold of a move, and of a path's way from pose to pose, s.
MOVE, VISIT = (MOVE_DURATION, 0.2), (0.5, 0.4)
#: A path, or None and the ends of a move.
Motion = tuple[Circle | SampledPath | Waypoints | None, Array | None, Array | None]
_UNITS = ("N", "N·m")


def command(
    context: Context,
    robot: options.RobotName,
    start: str | None = Option(None, "--from", metavar="X,Y,…", help="Start pose, m and rad."),
    end: str | None = Option(
        None, "--to", metavar="X,Y,…", help="End pose.", show_default="inside the workspace"
    ),
    path: Path | None = Option(
        None,
        help="Instead: CSV file of poses to visit in turn, a column for each coordinate, m and "
        "rad; the log has the readings at rest. With a column time, s, the robot passes the "
        "poses at these times, and the log has every cycle.",
    ),
    way_points: Path | None = Option(
        None,
        help="Instead: CSV file of poses to move through, with a stop at each; the log has "
        "every cycle.",
    ),
    circle: str | None = Option(
        None,
        metavar="R,HZ[,TURNS]",
        help="Instead: a horizontal circle about the pose of --from (default: home), m and "
        "turns per second.",
    ),
    law: Law | None = Option(
        None,
        help="Control law; joint is standard control, tej the paper's law.",
        show_default="tej; joint where no sensor is in use",
    ),
    true: options.TrueRobot = "sampled",
    effects: str = options.effects_option(
        "none", "Effects that the model omits: all, none, or some: friction,delay,…"
    ),
    fault: options.Faults = None,
    disturbance: options.Disturbances = None,
    monitor: bool = Option(
        False, "--monitor", help="Fault monitor: continue or stop when a reading is faulty."
    ),
    forces: bool = Option(
        False,
        "--forces",
        help="With --monitor: observe external forces, which names payloads, friction and "
        "contacts (package truepose-safety).",
    ),
    safety: bool = Option(
        False,
        "--safety",
        help="Safety shell: stop after a violation of its limits, which are printed. Moves and "
        "paths only (package truepose-safety).",
    ),
    start_test: bool = Option(False, "--start-test", hidden=True),
    seed: options.Seed = 0,
    sensors: options.SensorsOption = None,
    duration: float | None = Option(
        None, help="Duration of a move, s.", show_default="0.2; visiting 0.5 each"
    ),
    hold: float | None = Option(
        None, help="Hold after it, s.", show_default="0.2; visiting 0.4 each"
    ),
    frequency: float | None = Option(
        None,
        help="Poles of the PD, rad/s.",
        show_default="150, visiting 40; with effects the fastest with margins",
    ),
    since: float = Option(0.0, help="Time since switch-on of the cold robot, s (warm-up)."),
    out: Path | None = Option(None, "-o", "--out", help="Log to write: .csv, .parquet or .mcap."),
    plot: Path | None = options.plot_option("the errors"),
    output: options.Output = options.Output(),
) -> None:
    """Simulate a robot with geometric errors under a controller; print its pose errors.

    The controller uses the nominal robot. The true robot is sampled from the tolerances of the
    file, every rod separately, and its encoders are quantized. Without **--to** it makes a default
    move. The log's columns have the names that **truepose calibrate** reads. A path that the robot
    cannot follow is refused before the start.

    Example: **truepose simulate h4 --law estimated --effects friction,compliance -o move.csv**,
    then **truepose simulate h4 --fault theta:stuck@0.05 --monitor**
    """
    if start_test:
        raise InputError(moved.where("--start-test: truepose start-test ROBOT", "safety"))
    given = options.given(context)
    read = [robot, path, way_points, None if true in ("sampled", "nominal") else true]
    output.check(read, log=out, plot=plot)
    believed = options.load_with(robot, sensors)
    truth = options.true_robot(believed, true, seed)
    faults, disturbances = options.faults_of(fault), options.disturbances_of(disturbance)
    forgotten = None if effects == "none" else options.effects_of(effects)
    motion = _asked(believed, path, way_points, circle, start, end, duration)
    visiting = not isinstance(motion, tuple)
    wrong: Collection[str] = ("--disturbance", "--safety") if visiting else ()
    options.refuse(given, wrong, "only for moves and paths in time, not for --path with poses")
    law = laws.usual(believed) if law is None else law
    controller = _controller(believed, law, forgotten, frequency, visiting)
    usual = VISIT if visiting else MOVE
    run = Run(
        duration=usual[0] if duration is None else duration,
        hold=usual[1] if hold is None else hold,
        seed=seed,
        time=since,
        disturbances=disturbances,
        safety=_plugin("safety", "--safety: the safety shell")(effects=forgotten)
        if safety
        else None,
    )
    if forces and not monitor:
        raise InputError("--forces: only with --monitor")
    observer = _plugin("forces", "--forces: the observer of external forces")() if forces else None
    watching = FaultMonitor(effects=forgotten, forces=observer) if monitor else None
    ran: Simulation | Visit
    with progress("simulating"):
        if isinstance(motion, tuple):
            ran = move = simulate(
                believed,
                truth,
                controller,
                path=motion[0],
                effects=forgotten,
                faults=faults,
                monitor=watching,
                run=replace(run, start=motion[1], end=motion[2]),
            )
            over, error, torque, status = move.time, move.error, move.torque, move.status
            tables = [move.table(), _motors(believed, move)]
            if run.safety is not None:
                limits = run.safety.limits(believed, controller)
                tables += [limits.table(), limits.stops()]
        else:
            require_within(faults, len(motion) * (run.duration + run.hold))
            ran = came = visit(
                believed, truth, motion, controller, forgotten, faults, watching, run
            )
            status = _reached(came.x, came.status)
            if not np.isfinite(came.x).any():
                raise PoseError(f"{believed.name}: {status}")
            over, error = np.arange(len(motion)), came.x - motion
            tables, torque = [error_table(believed, error)], None
    output.write(
        log=lambda: logs.columns(ran, truth),
        plot=lambda: figure_of(lambda figure: draw_errors(figure, believed, over, error, torque)),
    )
    wrong = [f"faults {', '.join(map(str, faults))}"] if faults else []
    who = f"true robot {f'sampled with seed {seed}' if true == 'sampled' else true}"
    who = ", ".join([who, *wrong, *map(str, disturbances)])
    answer = f"{believed.name}, law {law}, poles {controller.frequency:.3g} rad/s, {who}: {status}"
    output.show(tables, [answer])


def _plugin(name: str, what: str) -> Any:
    """Return a class of an installed package that supervises a run."""
    if (found := plugins("supervisors").get(name)) is None:
        raise InputError(moved.where(what, "safety"))
    return found.load()


def _controller(
    robot: Robot, law: Law, effects: Effects | None, frequency: float | None, visiting: bool
) -> Controller:
    """Return the controller of a motion, by its poles or else the usual ones, rad/s."""
    exact = effects in (None, Effects.none())
    if frequency is None and not (visiting and exact):
        return controller_of(law, robot, effects)
    poles = VISITING if frequency is None else frequency
    wide = (BANDWIDTH if visiting or not exact else 10.0) * poles
    return Controller(law=law, frequency=poles, velocity_bandwidth=wide)


def _asked(
    robot: Robot,
    path: Path | None,
    way_points: Path | None,
    circle: str | None,
    start: str | None,
    end: str | None,
    duration: float | None,
) -> Array | Motion:
    """Return the poses to visit, or a path, or the ends of a move."""
    given = {"--path": path, "--way-points": way_points, "--circle": circle}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{named[0]}, {named[1]}: name one of them")
    if named and (end is not None or (start is not None and circle is None)):
        left = "--to" if circle is not None else "--from and --to"
        raise InputError(f"{named[0]}: defines all poses: leave out {left}")
    first = options.parse_pose(robot, start, "--from", False)
    last = options.parse_pose(robot, end, "--to", False)
    made: Circle | SampledPath | Waypoints | None = None
    if path is not None:
        time, x_d = read_samples(robot, path)
        if time is None:
            return x_d
        made = SampledPath(time=time, x=x_d)
    elif way_points is not None:
        each = MOVE_DURATION if duration is None else duration
        return Waypoints(poses=read_poses(robot, way_points), duration=each), None, None
    elif circle is not None:
        numbers = options.numbers_of(circle)
        if np.isnan(numbers).any() or not 2 <= len(numbers) <= 3:
            raise InputError(f"--circle {circle}: must be radius, turns per second, and turns")
        radius, frequency, turns = (*numbers.tolist(), 1.0)[:3]
        centre = robot.home if first is None else first
        made = Circle(centre=centre, radius=radius, frequency=frequency, turns=turns)
    if made is not None and duration is not None:
        raise InputError("--duration: --circle and a --path with times have their own: leave out")
    return made, first if made is None else None, last


def _motors(robot: Robot, run: Simulation) -> Table:
    rows = []
    for k, chain in enumerate(robot.spec.chain):
        unit = _UNITS[chain.actuator == "revolute"]
        row = {
            "motor": Cell(f"{k + 1} ({unit})", {"motor": k + 1, "unit": unit}),
            "largest": float(np.abs(run.torque[:, k]).max()),
            "limit": float(chain.torque_limit or np.inf),
        }
        rows.append(row)
    return tabled("motors", "Torques and forces of the motors", rows)


def _reached(x: Array, status: Array) -> str:
    words = f"{finite_rows(x).sum()} of {len(x)} poses reached"
    for reason in dict.fromkeys(status[status != "ok"].tolist()):
        poses = np.flatnonzero(status == reason)
        words += f"; pose {poses[0]}" + f" and {len(poses) - 1} more" * (len(poses) > 1)
        words += f": {reason}"
    return words
