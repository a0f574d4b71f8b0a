"""How does a run become a file? Parquet, MCAP (Foxglove, PlotJuggler) or CSV, described columns.

Readings have the names that :func:`truepose.calibrate` and `truepose calibrate` look for, measured
coordinates are ``measured_x`` …: what is written here can be calibrated on.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truepose.calibration.log_checks import sensor_is_angle
from truepose.exceptions import InputError, choose
from truepose.files.write import Output, mark, replace_file
from truepose.files.write import check as checked
from truepose.paper.virtual_experiment import Run
from truepose.robot.robot import Robot
from truepose.robot.to_core import Array
from truepose.simulation.plants import Visit
from truepose.simulation.simulate import Simulation


class Column(NamedTuple):
    """One quantity of a run, in SI units."""

    topic: str  #: what it belongs to: a channel of an MCAP file
    name: str
    unit: str
    what: str
    values: Array  #: (N,)


def columns(run: Simulation | Run | Visit, robot: Robot | None = None) -> list[Column]:
    """Name, unit, description and values of everything in a run.

    Parameters
    ----------
    run : Simulation, Run or Visit
        A simulated move; the poses of an experiment, as measured; or as the plant stood there.
    robot : Robot, optional
        Of a Visit, which does not hold it.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.logs.write import columns
    >>> [c.name for c in columns(tp.simulate(tp.load("h4")))][:6]
    ['time', 'q1', 'q2', 'q3', 'q4', 'theta']
    """
    result = _columns(run, robot)
    names = [column.name for column in result]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(
            f"sensor {twice}: a run's log has a column of this name: rename the sensor"
        )
    return result


def _columns(run: Simulation | Run | Visit, robot: Robot | None) -> list[Column]:
    if isinstance(run, Simulation):
        robot = run.truth
        result = [Column("time", "time", "s", "since the start", run.time)]
        result += readings(robot, run.q_e)
        result += _pose(robot, "desired", "asked of the controller", run.x_d)
        result += _pose(robot, "true", "of the simulated robot", run.x)
        angle = _angles(robot)
        for topic, values, what, units in (
            ("motor_error", run.motor_error, "motor error ê_q of the law,", ("m", "rad")),
            ("torque", run.torque, "torque (force) of", ("N", "N·m")),
        ):
            for i in range(robot.n):
                described = f"{what} motor {i + 1}"
                own = Column(topic, f"{topic}{i + 1}", units[angle[i]], described, values[:, i])
                result.append(own)
        damped = run.near_singular.astype(float)
        what = "1 where the controller's Jacobian was damped"
        return [*result, Column("near_singular", "near_singular", "1", what, damped)]
    if isinstance(run, Run):
        robot = run.believed
        result = _numbered(run.q_e) + readings(robot, run.q_e)
        result += _pose(robot, "desired", "asked of the controller", run.desired)
        result += _pose(robot, "measured", "by the vision system", run.measured)
        sigma = np.sqrt(np.diagonal(run.covariance, axis1=1, axis2=2)[:, [0, 1, 2, 5]])
        result += [
            Column(c.topic, f"{c.name}_sigma", c.unit, f"σ of {c.what}, as it claims", values)
            for c, values in zip(result[-robot.n :], sigma.T, strict=True)
        ]
        result += _pose(robot, "estimated", "from the readings", run.estimated)
        what = "1 where the pose counts"
        return [*result, Column("counted", "counted", "1", what, run.counted.astype(float))]
    if robot is None:
        raise InputError("a Visit's log needs its robot: columns(visit, robot)")
    result = _numbered(run.q_e) + readings(robot, run.q_e)
    return result + _pose(robot, "true", "of the plant", run.x)


def write(
    run: Simulation | Run | Visit,
    path: str | Path,
    robot: Robot | None = None,
    *,
    force: bool = False,
) -> None:
    """Write a run as its file's name ends: .parquet, .mcap or .csv.

    Parameters
    ----------
    run, robot
        As of :func:`columns`.
    path : str or Path
        A log that truepose wrote before is replaced; an interrupted write leaves it as it was.
    force : bool
        Replace any other file, too; never what is read-only, or is no regular file.

    Raises
    ------
    InputError
        An unknown ending, a package that is missing, a file that cannot or may not be written.

    Examples
    --------
    >>> import tempfile, truepose as tp
    >>> from truepose.logs import read as logs
    >>> from truepose.logs import write as run_logs
    >>> h4 = tp.load("h4")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run_logs.write(tp.simulate(h4), folder + "/move.csv")
    ...     logs.read(h4, folder + "/move.csv").readings.shape[1]
    5
    """
    path = Path(path)
    check(path, force=force)
    replace_file(path, encoded(path, columns(run, robot)), "log", force)


def check(path: str | Path, inputs: Iterable[str | Path] = (), force: bool = False) -> Output:
    """Look whether a log may be written, best before any work is done for it.

    Parameters
    ----------
    path, inputs, force
        As of :func:`truepose.files.write.check`.

    Raises
    ------
    InputError
        An unknown ending, or a file that may not be written.
    """
    output = Output(Path(path), "log")
    checked([output], inputs, force)
    if output.path.suffix not in _WRITERS:
        raise InputError(f"{path}: " + choose("ending", output.path.suffix, _WRITERS))
    return output


def encoded(path: Path, listed: list[Column]) -> bytes:
    """Return the contents of a log file, as its name ends; the first column is time or number."""
    return _WRITERS[path.suffix](path, listed)


def _angles(robot: Robot) -> list[bool]:
    """Whether each reading is in rad (else m)."""
    motors = [chain.actuator == "revolute" for chain in robot.spec.chain]
    return motors + sensor_is_angle(robot)


def readings(robot: Robot, q_e: Array) -> list[Column]:
    """Columns of readings (N, n + r) by the names that a calibration looks for."""
    kinds = {sensor.name: sensor.kind for sensor in robot.spec.sensor}
    angle = _angles(robot)
    result = []
    for k, name in enumerate(robot.readings):
        what = f"motor {k + 1}'s encoder" if k < robot.n else f"sensor {name} ({kinds[name]})"
        unit = "rad" if angle[k] else "m"
        result.append(Column("readings", name, unit, f"reading of {what}", q_e[:, k]))
    return result


def _pose(robot: Robot, kind: str, what: str, x: Array) -> list[Column]:
    return [
        Column(kind, f"{kind}_{name}", unit, f"{kind} {name} of the nacelle, {what}", x[:, k])
        for k, (name, unit) in enumerate(robot.coordinates)
    ]


def _numbered(rows: Array) -> list[Column]:
    number = np.arange(len(rows), dtype=float)
    return [Column("pose", "pose", "1", "number of the pose, from 0", number)]


def _parquet(path: Path, listed: list[Column]) -> bytes:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            f"{path}: Parquet needs pyarrow: pip install 'truepose[parquet]'; CSV needs nothing"
        ) from None
    fields = [
        pyarrow.field(c.name, pyarrow.float64(), metadata={"unit": c.unit, "description": c.what})
        for c in listed
    ]
    table = pyarrow.table(
        [c.values for c in listed], schema=pyarrow.schema(fields, {"truepose": mark("log")})
    )
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()


def _mcap(path: Path, listed: list[Column]) -> bytes:
    """One channel for each topic, a message for each row; JSON with its schema.

    A row's time is the run's, or one second for each pose.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError(
            f"{path}: MCAP needs mcap: pip install 'truepose[mcap]'; CSV needs nothing"
        ) from None
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="", library=mark("log"))
    times = np.round(1e9 * listed[0].values).astype(np.int64).tolist()
    for topic in dict.fromkeys(c.topic for c in listed):
        own = [c for c in listed if c.topic == topic]
        schema = {
            "type": "object",
            "title": topic,
            "properties": {
                c.name: {"type": ["number", "null"], "description": f"{c.what}, {c.unit}"}
                for c in own
            },
        }
        text = json.dumps(schema, ensure_ascii=False).encode()
        number = writer.register_schema(f"truepose.{topic}", "jsonschema", text)
        channel = writer.register_channel(f"/{topic}", "json", number)
        rows = zip(*(c.values.tolist() for c in own), strict=True)
        for at, row in zip(times, rows, strict=True):
            cells = {c.name: v if np.isfinite(v) else None for c, v in zip(own, row, strict=True)}
            writer.add_message(channel, at, json.dumps(cells).encode(), at)
    writer.finish()
    return buffer.getvalue()


def _csv(path: Path, listed: list[Column]) -> bytes:
    buffer = io.StringIO()
    buffer.write(f"# {mark('log')}\n")
    for c in listed:
        buffer.write(f"# {c.name}: {c.what}, {c.unit}\n")
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow([c.name for c in listed])
    cells = np.column_stack([c.values for c in listed]).tolist()
    rows.writerows([[repr(v) if np.isfinite(v) else "" for v in row] for row in cells])
    return buffer.getvalue().encode()


_WRITERS = {".parquet": _parquet, ".mcap": _mcap, ".csv": _csv}
