"""`truepose info`: reach, conditioning and motor speeds over the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from truepose import _core
from truepose.arguments import Array
from truepose.commands.options import Force, How, RobotName, Seed, plot_to, wrote
from truepose.exceptions import InputError
from truepose.robot.maps import draw_map, workspace_slice
from truepose.robot.robot import Robot, load
from truepose.robot.workspace import workspace
from truepose.show.results import figure_of
from truepose.show.table import Cell, Table
from truepose.show.terminal import Format, show
from truepose.show.units import PRINT, printed

LENGTH = 0.1  #: m; makes platform angles comparable to lengths in a condition number


def command(
    robot: RobotName,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw the conditioning map (PNG, SVG, PDF).")
    ] = None,
    samples: Annotated[
        int, typer.Option(min=1, max=10_000_000, help="Poses sampled from the workspace.")
    ] = 100_000,
    seed: Seed = 0,
    length: Annotated[
        float,
        typer.Option(min=1e-6, max=1e3, help="Length that makes angles comparable to lengths, m."),
    ] = 0.1,
    how: How = Format.table,
    force: Force = False,
) -> None:
    """Print a robot's degrees of freedom, reach, conditioning and motor speeds.

    Example: **truepose info hexa --plot hexa.png**
    """
    save = plot_to(plot, [robot], force)
    loaded = load(robot)
    measured = measure(loaded, samples, seed, length)
    save(lambda: figure_of(lambda figure: draw(figure, loaded, length)))
    show([table(loaded, measured)], how)
    wrote(how, plot)


@dataclass(frozen=True)
class Speed:
    """Largest speed of any motor while the platform moves at 1 m/s or turns at 1 rad/s."""

    value: float  #: rad/s or m/s
    motor: int  #: from 1
    pose: Array


@dataclass(frozen=True)
class Figures:
    """Results of :func:`measure` over a workspace box."""

    samples: int
    seed: int
    length: float  #: m, see `LENGTH`
    reachable: float  #: fraction of the poses, within the joint limits
    regular: float  #: fraction of the poses that are reachable and not singular
    refused: dict[str, int]  #: number of other poses by reason and chain
    q_min: Array
    q_max: Array
    condition: tuple[float, float, float]  #: least, median, greatest condition number of J
    moving: Speed | None  #: at 1 m/s, in the worst direction; None if it only turns
    turning: Speed | None  #: at 1 rad/s, about the worst axis; None if the platform cannot turn
    full_less_ideal: Array | None  #: (n,), see :func:`level_difference`


def measure(robot: Robot, samples: int = 100_000, seed: int = 0, length: float = LENGTH) -> Figures:
    """Evaluate a robot at poses sampled from its workspace box.

    Parameters
    ----------
    robot : Robot
    samples, seed : int
        Number of poses; the same seed gives the same ones.
    length : float
        Factor of the platform's angles in condition numbers, m.

    Raises
    ------
    InputError
        The file has no workspace, or no pose of it is regular.

    Examples
    --------
    >>> import truepose as tp
    >>> figures = measure(tp.load("delta"), samples=1000)
    >>> figures.reachable, [round(c, 1) for c in figures.condition]
    (1.0, [1.0, 1.3, 1.9])
    """
    box = workspace(robot)
    generator = np.random.default_rng(seed)
    x = generator.uniform(box.minimum, box.maximum, size=(samples, robot.n))
    q, status, chain = _core.ikm(robot.core, x, False)
    reached = status == 0
    J, rank, lost = _core.jacobian(robot.core, x, False)
    regular = reached & (rank == 0)
    refused = reasons(np.where(reached, rank, status), np.where(reached, lost, chain))
    if not regular.any():
        raise InputError(
            f"{robot.name}: no pose of its workspace is reachable and regular: {told(refused)}"
        )
    x, J = x[regular], J[regular]
    condition = _condition(robot, J, length)
    K = np.linalg.inv(J)  # q̇ = K ẋ
    linear = np.array([unit == "m" for _, unit in robot.coordinates])
    return Figures(
        samples=samples,
        seed=seed,
        length=length,
        reachable=float(reached.mean()),
        regular=float(regular.mean()),
        refused=refused,
        q_min=q[reached].min(axis=0),
        q_max=q[reached].max(axis=0),
        condition=(float(condition.min()), float(np.median(condition)), float(condition.max())),
        moving=_fastest(K[:, :, linear], x) if linear.any() else None,
        turning=None if linear.all() else _fastest(K[:, :, ~linear], x),
        full_less_ideal=level_difference(robot, x[:100], seed),
    )


def reasons(status: Array, chain: Array) -> dict[str, int]:
    """Count poses by the reason of failure, most frequent first."""
    counts: dict[str, int] = {}
    pairs, numbers = np.unique(np.column_stack([status, chain]), axis=0, return_counts=True)
    for k in np.argsort(-numbers):
        what, who = (int(v) for v in pairs[k])
        if what:
            guilty = f" (chain {who + 1})" if who >= 0 else ""
            counts[_core.describe(what) + guilty] = int(numbers[k])
    return counts


def told(refused: dict[str, int]) -> str:
    """Format counts of :func:`reasons` as one line."""
    return ", ".join(f"{reason}: {count}" for reason, count in refused.items())


def level_difference(robot: Robot, poses: Array, seed: int = 0, count: int = 100) -> Array | None:
    """Root mean square of full − ideal under the file's axis tolerances.

    Samples `count` robots with yaw and tilt of every motor's axis, normal with the file's σ, and
    compares at each pose the platform poses of both levels for the same motor positions.

    Returns
    -------
    ndarray, shape (n,), or None
        m and rad; None where the full level equals the ideal one or does not exist, the file has
        no tolerance of an axis, or no pose is reachable with them (lengths in mm, for example).

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose.paper import article
    >>> robot = tp.load("h4")
    >>> rms = level_difference(robot, article.table2()[::25])
    >>> bool((abs(rms[:3] * 1e3 - [0.11, 0.20, 0.14]) < 0.03).all())
    True
    """
    sigma = {
        name: parameter.sigma
        for name, parameter in robot.parameters.items()
        if name.endswith((".yaw", ".tilt")) and parameter.sigma > 0
    }
    paired = any(name.endswith(".rod_difference") for name in robot.parameters)
    if not (robot.full and paired and sigma):
        return None
    generator = np.random.default_rng(seed)
    squares = []
    for _ in range(count):
        draw = generator.normal(size=len(sigma))
        real = robot.replace(
            {
                name: robot.parameters[name].value + s * d
                for (name, s), d in zip(sigma.items(), draw, strict=True)
            }
        )
        q = real.ikm(poses, errors="nan", level="full")
        squares.append((poses - real.fkm(q, guess=poses, errors="nan")) ** 2)
    if not np.isfinite(squares).any():
        return None
    return np.sqrt(np.nanmean(squares, axis=(0, 1)))


def condition_map(robot: Robot, length: float = LENGTH, points: int = 101) -> tuple[Array, Array]:
    """Return poses of a :func:`workspace_slice` and the condition number of J, NaN if singular."""
    x = workspace_slice(robot, points)
    J = robot.jacobian(x, errors="nan")
    condition = np.full((points, points), np.nan)
    regular = np.isfinite(J).all(axis=(2, 3))
    condition[regular] = _condition(robot, J[regular], length)
    return x, condition


def draw(figure: Any, robot: Robot, length: float = LENGTH) -> None:
    """Draw :func:`condition_map`."""
    angles = len({unit for _, unit in robot.coordinates}) > 1
    note = f"angles times {1e3 * length:g} mm" if angles else "conditioning"
    draw_map(figure, robot, *condition_map(robot, length), "condition number of J (–)", note, 1.0)


def table(robot: Robot, figures: Figures) -> Table:
    """Return the table that `truepose info` prints."""
    title = robot.spec.title or robot.name
    return Table("info", title, ["figure", "value"], [list(row) for row in rows(robot, figures)])


def rows(robot: Robot, figures: Figures) -> list[tuple[str, str]]:
    """Return name and value of each figure: mm and degrees in the text, SI in the data."""
    spec, box = robot.spec, workspace(robot)
    angles = len({unit for _, unit in robot.coordinates}) > 1
    scale = f", angles × {1e3 * figures.length:g} mm" if angles else ""
    known = [sensor.name for sensor in spec.sensor]
    spare = [name for name in known if name not in robot.sensors]
    result = [
        ("mobility", spec.mobility),
        ("degrees of freedom n", _number(robot.n)),
        ("actuators", _count([chain.actuator for chain in spec.chain])),
        ("redundant sensors r", f"{robot.r}: {', '.join(robot.sensors) or 'none'}"),
        ("further sensors in the file", ", ".join(spare) or "none"),
        ("geometric parameters", _number(len(robot.parameters))),
    ]
    for (name, unit), low, high in zip(robot.coordinates, box.minimum, box.maximum, strict=True):
        result.append((f"workspace {name}", _range(low, high, unit)))
    poses = f"{figures.samples} poses, seed {figures.seed}"
    share = {"value": 100 * figures.reachable, "unit": "%", "poses": figures.samples}
    text = f"{100 * figures.reachable:.4g} % of {poses}"
    result += [
        ("reachable within the joint limits", Cell(text, share | {"seed": figures.seed})),
        (
            "reachable and regular",
            Cell(f"{100 * figures.regular:.4g} %", {"value": 100 * figures.regular, "unit": "%"}),
        ),
    ]
    if figures.refused:
        result.append(("other poses", told(figures.refused)))
    for k, chain in enumerate(spec.chain):
        unit = "rad" if chain.actuator == "revolute" else "m"
        result.append((f"motor {k + 1}", _range(figures.q_min[k], figures.q_max[k], unit)))
    low, middle, high = figures.condition
    numbers = f"{low:.2f} least, {middle:.2f} median, {high:.2f} greatest"
    spread = {"value": middle, "minimum": low, "maximum": high}
    result.append((f"condition number of J{scale}", Cell(numbers, spread)))
    if figures.moving is not None:
        result.append(("fastest motor at 1 m/s", _speed(robot, figures.moving)))
    if figures.turning is not None:
        result.append(("fastest motor at 1 rad/s", _speed(robot, figures.turning)))
    if spec.stretches:
        result += _stretch(robot)
    result.append(("full level", robot.full.reason))
    if figures.full_less_ideal is not None:
        parts = zip(robot.coordinates, figures.full_less_ideal, strict=True)
        for (name, unit), v in parts:
            data = {"value": float(v), "unit": unit}
            result.append(
                (
                    f"full − ideal of {name}, rms under the axes' tolerances",
                    Cell(printed(v, unit), data),
                )
            )
    return result


def _stretch(robot: Robot) -> list[tuple[str, str]]:
    """Return rod forces at home and the strains."""
    at = robot.rod_forces(robot.home, errors="nan")
    strain = robot.compliance * at
    names = [f"chain {k}" for k in range(1, robot.n + 1)]

    def each(values: Array, unit: str, factor: float = 1.0) -> Cell:
        text = f"{', '.join(f'{factor * v + 0.0:.3g}' for v in values)} {unit}"
        return Cell(text, dict(zip(names, map(float, values), strict=True)))

    return [
        ("tension of each chain at home", each(at, "N")),
        ("strain of its rods there", each(strain, "µm/m", 1e6)),
    ]


def _condition(robot: Robot, J: Array, length: float) -> Array:
    scale = np.array([1.0 if unit == "m" else length for _, unit in robot.coordinates])
    return np.linalg.cond(J * scale[:, None])


def _fastest(K: Array, x: Array) -> Speed:
    """Find the fastest motor; its worst platform velocity is along its row of K."""
    speeds = np.linalg.norm(K, axis=2)
    pose, motor = np.unravel_index(int(speeds.argmax()), speeds.shape)
    return Speed(float(speeds[pose, motor]), int(motor) + 1, x[pose])


def _count(names: list[str]) -> str:
    return ", ".join(f"{names.count(name)} {name}" for name in dict.fromkeys(names))


def _number(count: int) -> Cell:
    return Cell(str(count), count)


def _range(low: float, high: float, unit: str) -> Cell:
    data = {"minimum": float(low), "maximum": float(high), "unit": unit}
    factor, _ = PRINT[unit]
    form = ".1f" if unit == "m" else ".2f"
    return Cell(f"{factor * low:{form}} to {printed(high, unit, form)}", data)


def _speed(robot: Robot, speed: Speed) -> Cell:
    chain = robot.spec.chain[speed.motor - 1]
    unit = "rad/s" if chain.actuator == "revolute" else "m/s"
    where = ", ".join(
        f"{name} = {printed(v, u, '.0f')}"
        for (name, u), v in zip(robot.coordinates, speed.pose, strict=True)
    )
    text = f"{speed.value:.3g} {unit}, motor {speed.motor}, at {where}"
    pose = zip(robot.coordinates, speed.pose, strict=True)
    data = {"value": speed.value, "unit": unit, "motor": speed.motor}
    return Cell(text, data | {f"{name} ({u})": float(v) for (name, u), v in pose})
