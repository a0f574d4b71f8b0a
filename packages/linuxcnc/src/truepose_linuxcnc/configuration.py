"""LinuxCNC configurations: robot table, ini, HAL, and predicted limits."""

import math
import struct
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np

from truepose import _core, files
from truepose.arguments import Array
from truepose.calibration.learnt import chi2_quantile
from truepose.control import delays
from truepose.control.controller import Controller, require_same_readings
from truepose.control.gains import poses
from truepose.exceptions import InputError
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Robot, angles, reading_units, require_sensors, samples_or_home
from truepose.robot.knowledge import in_control
from truepose.simulation.equilibrium import steady_state

#: Largest number of uncertain parameters in the components (hal/table.h).
_PARAMETERS = 256
#: Sampled robots, sampled poses, and accepted quantile, for the prediction of corrections.
_DRAWN, _POSES, _ACCEPTED = 40, 40, 0.999
#: The quantile in σ of a normal error; time step of the rates' finite difference, s.
_ACCEPTED_SIGMAS = NormalDist().inv_cdf((1 + _ACCEPTED) / 2)
_DIFFERENCE = 5e-4
#: Share of robots within tolerances whose readings after homing must be accepted.
_HOMED = 0.9999
#: Factor of ferror over its prediction; correction limit without a prediction, machine units.
_SPARE, _UNPREDICTED = 1.25, 5.0
#: Assumed bandwidth of the drives' position loops, 1/s; delay of drives and encoders, cycles; time
#: over which a correction is blended in, s.
_BANDWIDTH, _LATE, _BLEND = 50.0, 3, 0.5
#: Largest velocity and acceleration of axes in m and rad, which no robot file has; assumed.
SPEEDS = {"m": (1.5, 20.0), "rad": (10.0, 200.0)}
#: Machine units per m and rad; axis letter of each coordinate.
_SHOWN = {"m": 1e3, "rad": math.degrees(1)}
_LETTERS = {"theta": "C", "rx": "A", "ry": "B", "rz": "C"}


def to_table(robot: Robot, controller: Controller, monitor: FaultMonitor) -> bytes:
    """Return a robot as hal/table.h reads it: the C interface's structs, by name.

    The table is valid on the kind of machine that wrote it; others refuse it.

    `robot` is the controller's model, nominal or calibrated. `monitor` uses period and gains of
    `controller`.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_linuxcnc.configuration import to_table
    >>> table = to_table(tp.load("five-bar"), tp.Controller(law="joint"), tp.FaultMonitor())
    >>> table[:12]
    b'trueposename'
    """
    if delays.settings(robot, controller.period) is not None:
        raise InputError(
            f"{robot.name}: a sensor has `sample_period` or `latency`, which LinuxCNC's components "
            "do not support: choose other sensors (--sensors)"
        )
    blocks = {b"name": robot.name.encode()[:32].ljust(32, b"\0"), b"robt": bytes(robot.core)}
    if robot.r:
        known = in_control(robot)
        if len(known.column) > _PARAMETERS:
            raise InputError(
                f"{robot.name}: {len(known.column)} uncertain parameters; LinuxCNC's components "
                f"hold {_PARAMETERS}: choose fewer sensors (--sensors)"
            )
        blocks |= {
            b"fine": bytes(robot.at_highest_level.core),
            b"wtch": bytes(monitor.setup(robot, controller).monitor),
            b"sigm": known.sigma.tobytes(),
            b"colm": np.array(known.column, dtype=np.int32).tobytes(),
            b"root": known.root.tobytes(),
        }
    rows = [name + struct.pack("=I", len(block)) + block for name, block in blocks.items()]
    table = b"truepose" + b"".join(rows) + b"mark" + struct.pack("=I", 8)
    mark = 14695981039346656037  # FNV-1a
    for byte in table:
        mark = (mark ^ byte) * 1099511628211 % 2**64
    return table + struct.pack("=Q", mark)


def _speeds(unit: str) -> dict[str, float]:
    """Return the limits of an axis in m or rad, in mm or degrees."""
    limits = zip(("velocity", "acceleration"), SPEEDS[unit], strict=True)
    return {name: _SHOWN[unit] * value for name, value in limits}


def to_configuration(
    robot: Robot, controller: Controller, monitor: FaultMonitor, machine: Robot | None = None
) -> dict[str, str | bytes]:
    """Return the files of a LinuxCNC configuration by name.

    ``robot.ini`` and ``robot.hal`` run a simulated machine; ``robot.table`` is the controller's
    model, ``machine.table`` the true machine.

    `robot`, `controller` and `monitor` are as in :func:`to_table`. `machine` is the true robot with
    the same sensors, default `robot`.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_linuxcnc.configuration import to_configuration
    >>> files = to_configuration(tp.load("h4"), tp.Controller(), tp.FaultMonitor())
    >>> sorted(files)
    ['machine.table', 'robot.hal', 'robot.ini', 'robot.table']
    """
    robot.require_chains("a LinuxCNC configuration")
    require_sensors(robot, controller.built_in)
    machine = machine or robot
    require_same_readings(robot, machine)
    units, axes = reading_units(robot), _axes(robot)
    exported, learnt = corrections(robot, controller)
    x = _workspace(robot)
    tej = np.abs(robot.tej(x, errors="nan")[1])
    noise = np.nanmax(tej @ robot.resolution, axis=0)  # of each error by one count of each reading
    moved = np.column_stack([np.maximum(exported, learnt), rates(robot, controller), noise])
    shown = np.array([_SHOWN[unit] for unit in units[: robot.m]])
    values: dict[str, Any] = {
        "mark": files.mark("LinuxCNC configuration"),
        "robot": robot,
        "letters": "".join(axis["letter"] for axis in axes),
        "period": controller.period,
        "linear": _speeds("m"),
        "angular": _speeds("rad"),
        "least": min(map(np.min, robot.conditioning(x))) / 2,
        "law": list(_core.laws).index(controller.law),
        "gain": _BANDWIDTH,
        "drawn": _DRAWN,
        "blend": _BLEND,
        "accepted": 100 * _ACCEPTED,
        "largest": np.max((exported + noise) * shown) if exported.any() else _UNPREDICTED,
        "largest_learnt": np.max((learnt + noise) * shown),
        "homed": 100 * _HOMED,
        "chi2": chi2_quantile(_HOMED, robot.r) if robot.r else 0.0,
        "joints": [_joint(robot, i, units[i], moved[i], controller) for i in range(robot.m)],
        "axes": axes,
        "sensors": _sensors(robot),
    }
    import jinja2

    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("truepose_linuxcnc"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        finalize=lambda value: f"{value:.6g}" if isinstance(value, float) else value,
    )
    return {
        **{n: templates.get_template(f"{n}.j2").render(values) for n in ("robot.ini", "robot.hal")},
        "robot.table": to_table(robot, controller, monitor),
        "machine.table": to_table(machine, controller, monitor),
    }


def corrections(robot: Robot, controller: Controller) -> tuple[Array, Array]:
    """Return the 99.9 % quantile of every motor's correction at steady state, m or rad.

    A law with redundant sensors holds the motors off their encoders' positions by e_q. Over robots
    within the file's tolerances e_q is about normal, so the quantile is 3.29 times the rms over
    them, at the worst of the workspace's corners and sampled poses. For the joint law this is the
    correction of the TEJ law.

    Return shapes are (n,): for the law with the file's model, and for an identified robot at its
    desired pose.

    Examples
    --------
    >>> import numpy as np
    >>> import truepose as tp
    >>> from truepose_linuxcnc.configuration import corrections
    >>> exported, learnt = corrections(tp.load("h4"), tp.Controller())
    >>> bool(1 < np.degrees(exported).max() < 4 < np.degrees(learnt).max() < 8)
    True
    """
    e_q = _errors(robot, controller, _workspace(robot))
    exported, learnt = _ACCEPTED_SIGMAS * np.sqrt(_mean(e_q**2)).max(axis=1)
    return exported, learnt


def rates(robot: Robot, controller: Controller) -> Array:
    """Return the rate of every motor's correction at full speed, m/s or rad/s.

    It is the 99.9 % quantile over robots: 3.29 times the rms along the worst direction, at the
    worst of the poses of :func:`corrections`, with the file's or the identified model. On a
    straight path the linear axes share one speed limit, and each angular axis moves at its own.

    Examples
    --------
    >>> import numpy as np
    >>> import truepose as tp
    >>> from truepose_linuxcnc.configuration import rates
    >>> bool(20 < np.degrees(rates(tp.load("h4"), tp.Controller())).max() < 50)
    True
    """
    linear = ~angles(robot)
    x = _workspace(robot)
    steps = _DIFFERENCE * np.diag([SPEEDS[unit][0] for _, unit in robot.coordinates])
    ahead, behind = (
        np.stack([_errors(robot, controller, x + sign * step) for step in steps], axis=-1)
        for sign in (1, -1)
    )
    rate = (ahead - behind) / (2 * _DIFFERENCE)
    moved = rate[..., linear]
    together = _mean(moved[..., :, None] * moved[..., None, :])
    rms = np.sqrt(np.linalg.norm(together, 2, axis=(-2, -1)))
    rms += np.sqrt(_mean(rate[..., ~linear] ** 2)).sum(axis=-1)
    return _ACCEPTED_SIGMAS * rms.max(axis=(0, 1))


def _errors(robot: Robot, controller: Controller, x: Array) -> Array:
    """Return e_q (2, robots, poses, n) of sampled robots at rest: file's law, and desired pose.

    Without redundant sensors it is 0.
    """
    law = "tej" if controller.law == "joint" else controller.law
    q_d = robot.ikm(x, errors="nan")
    e_q = np.zeros((2, _DRAWN, *q_d.shape))
    for k in range(_DRAWN if robot.r else 0):
        true = robot.sample(k)
        rest = steady_state(robot, true, x, replace(controller, law=law), errors="nan")
        for kind, there in enumerate((rest, x)):
            e_q[kind, k] = q_d - true.ikm(there, errors="nan")
    return e_q


def _mean(products: Array) -> Array:
    """Return the mean over the robots (axis 1) with a result."""
    return np.ma.masked_invalid(products).mean(axis=1).filled(0.0)


def _workspace(robot: Robot) -> Array:
    """Return home, the workspace's corners, and regular poses sampled in it."""
    x = samples_or_home(robot, _POSES)
    return np.vstack([poses(robot), x[np.isfinite(robot.ikm(x, errors="nan")).all(axis=1)]])


def _axes(robot: Robot) -> list[dict[str, Any]]:
    """Return letter, range and speeds of each axis; roll, pitch and yaw have no range."""
    if robot.spec.passive_axis:
        raise InputError(
            f"{robot.name}: {robot.coordinates[0][0]} is none of LinuxCNC's axes: a rotational "
            "robot has no configuration (choices: robots that move x, y, z)"
        )
    if robot.m > robot.n:
        raise InputError(
            f"{robot.name}: {robot.m} motors for {robot.n} freedoms: LinuxCNC's components take as "
            "many motors as freedoms"
        )
    box, axes = robot.spec.workspace, []
    for k, (name, unit) in enumerate(robot.coordinates):
        letter = _LETTERS.get(name, name.upper())
        axis: dict[str, Any] = {"letter": letter, "low": "-1e9", "high": "1e9", **_speeds(unit)}
        if box is not None and (unit == "m" or robot.n < 6):
            axis["low"], axis["high"] = (_SHOWN[unit] * e[k] for e in (box.minimum, box.maximum))
        axes.append(axis)
    return axes


def _joint(
    robot: Robot, i: int, unit: str, moved: Array, controller: Controller
) -> dict[str, str | float]:
    """Return the entries of [JOINT_i]; `moved`: largest correction, its rate, noise."""
    chain, scale, speeds = robot.spec.chain[i], _SHOWN[unit], _speeds(unit)
    stops = chain.limits or (-math.inf, math.inf)
    low, high = sorted(
        robot.core_drawn.motor_reading(i, stop) if math.isfinite(stop) else chain.gain * stop
        for stop in stops
    )
    lag = _LATE * controller.period * speeds["velocity"]
    # The drives' loops lag the command minus the correction, which is not fed forward: a correction
    # rate c' gives a lag c' / P, even if the joint itself moves slowly.
    correction, rate, noise = moved
    changes = rate / _BANDWIDTH
    blended = 1.875 * correction / (_BLEND * _BANDWIDTH)  # largest slope of the quintic
    least = _SPARE * scale * (blended + changes + noise)
    return {
        "type": "ANGULAR" if unit == "rad" else "LINEAR",
        "low": repr(max(scale * low, -1e9)),
        "high": repr(min(scale * high, 1e9)),
        "home": repr(float(scale * robot.ikm(robot.home)[i])),
        "blended": scale * blended,
        "changes": scale * changes,
        "noise": scale * noise,
        "lag": lag,
        "min_ferror": max(least, lag / 10),
        "ferror": least + _SPARE * lag,
        **speeds,
    }


def _sensors(robot: Robot) -> list[dict[str, str | float]]:
    """Return the index positions of the encoders, read at the file's home; others are absolute."""
    units = reading_units(robot)[robot.m :]
    index = robot.rkm(robot.home)
    return [
        {
            "name": sensor.name,
            "absolute": not _core.sensor_kinds[sensor.kind].shaft,
            "index": _SHOWN[unit] * at,
        }
        for sensor, unit, at in zip(robot.spec.used, units, index, strict=True)
    ]
