"""`truepose info`: reach, conditioning and motor speeds over the workspace."""

from collections import Counter
from pathlib import Path
from typing import Any

from typer import Option

from truepose.arguments import Array
from truepose.commands import options
from truepose.robot import Robot, load, reading_units
from truepose.robot.maps import condition_map, draw_map
from truepose.robot.workspace import LENGTH, Figures, Speed, measure, told, workspace
from truepose.show import PRINT, Cell, Table, figure_of, printed


def command(
    robot: options.RobotName,
    plot: Path | None = options.plot_option("the conditioning map"),
    samples: int = Option(100_000, min=1, max=10_000_000, help="Poses sampled from the workspace."),
    seed: options.Seed = 0,
    output: options.Output = options.Output(),
) -> None:
    """Print a robot's degrees of freedom, reach, conditioning and motor speeds.

    Example: **truepose info hexa --plot hexa.png**
    """
    output.check([robot], plot=plot)
    loaded = load(robot)
    measured = measure(loaded, samples, seed)
    output.write(plot=lambda: figure_of(lambda figure: draw(figure, loaded)))
    title = loaded.spec.title or loaded.name
    table = Table("info", title, ["figure", "value"], rows(loaded, measured))
    output.show([table])


def draw(figure: Any, robot: Robot) -> None:
    """Draw :func:`condition_map`."""
    mixed = len({unit for _, unit in robot.coordinates}) > 1
    note = f"angles times {1e3 * LENGTH:g} mm" if mixed else "conditioning"
    draw_map(figure, robot, *condition_map(robot), "condition number of J (–)", note, 1.0)


def rows(robot: Robot, figures: Figures) -> list[tuple[str, str]]:
    """Return name and value of each figure."""
    spec, box = robot.spec, workspace(robot)
    spare = [sensor.name for sensor in spec.sensor if sensor.name not in robot.sensors]
    actuators = Counter(spec.actuators)
    result = [
        ("mobility", spec.mobility),
        ("degrees of freedom n", Cell(str(robot.n), robot.n)),
        ("actuators", ", ".join(f"{count} {name}" for name, count in actuators.items())),
        ("redundant sensors r", f"{robot.r}: {', '.join(robot.sensors) or 'none'}"),
        ("further sensors in the file", ", ".join(spare) or "none"),
        ("geometric parameters", Cell(str(len(robot.parameters)), len(robot.parameters))),
    ]
    sides = zip(robot.coordinates, box.minimum, box.maximum, strict=True)
    result += [(f"workspace {name}", _range(low, high, unit)) for (name, unit), low, high in sides]
    share, regular = 100 * figures.reachable, 100 * figures.regular
    data = {"value": share, "unit": "%", "poses": figures.samples, "seed": figures.seed}
    text = f"{share:.4g} % of {figures.samples} poses, seed {figures.seed}"
    result += [
        ("reachable within the joint limits", Cell(text, data)),
        ("reachable and regular", Cell(f"{regular:.4g} %", {"value": regular, "unit": "%"})),
    ]
    if figures.refused:
        result.append(("other poses", told(figures.refused)))
    ranges = zip(figures.q_min, figures.q_max, reading_units(robot), strict=False)
    result += [(f"motor {k}", _range(*ends)) for k, ends in enumerate(ranges, 1)]
    low, middle, high = figures.condition
    numbers = f"{low:.2f} least, {middle:.2f} median, {high:.2f} greatest"
    spread = {"value": middle, "minimum": low, "maximum": high}
    mixed = len({unit for _, unit in robot.coordinates}) > 1
    scale = f", angles × {1e3 * LENGTH:g} mm" if mixed else ""
    result.append((f"condition number of J{scale}", Cell(numbers, spread)))
    for per, speed in (("1 m/s", figures.moving), ("1 rad/s", figures.turning)):
        if speed is not None:
            result.append((f"fastest motor at {per}", _speed(robot, speed)))
    if spec.stretches:
        forces = robot.rod_forces(robot.home, errors="nan")
        strains = robot.compliance * forces
        result.append(("tension of each chain at home", _each_chain(forces, "N")))
        result.append(("strain of its rods there", _each_chain(strains, "µm/m", 1e6)))
    result.append(("full level", robot.full.reason))
    if figures.full_less_ideal is not None:
        apart = zip(robot.coordinates, figures.full_less_ideal.tolist(), strict=True)
        for (name, unit), v in apart:
            factor, shown = PRINT[unit]
            cell = Cell(printed(v, unit), {"value": factor * v, "unit": shown})
            result.append((f"full − ideal of {name}, rms under the axes' tolerances", cell))
    return result


def _each_chain(values: Array, unit: str, factor: float = 1.0) -> Cell:
    text = f"{', '.join(f'{factor * v + 0.0:.3g}' for v in values)} {unit}"
    data = {f"chain {k} ({unit})": factor * float(v) for k, v in enumerate(values, 1)}
    return Cell(text, data)


def _range(low: float, high: float, unit: str) -> Cell:
    (factor, shown), form = PRINT[unit], ".1f" if unit == "m" else ".2f"
    data = {"minimum": factor * float(low), "maximum": factor * float(high), "unit": shown}
    return Cell(f"{factor * low:{form}} to {printed(high, unit, form)}", data)


def _speed(robot: Robot, speed: Speed) -> Cell:
    unit = f"{reading_units(robot)[speed.motor - 1]}/s"
    pose = list(zip(robot.coordinates, speed.pose.tolist(), strict=True))
    where = ", ".join(f"{name} = {printed(v, u, '.0f')}" for (name, u), v in pose)
    data = {"value": speed.value, "unit": unit, "motor": speed.motor}
    data |= {f"{name} ({PRINT[u][1]})": PRINT[u][0] * v for (name, u), v in pose}
    return Cell(f"{speed.value:.3g} {unit}, motor {speed.motor}, at {where}", data)
