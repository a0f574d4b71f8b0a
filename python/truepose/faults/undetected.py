"""What stays undetected: motor encoders that are off by less than any test of the readings sees."""

from collections.abc import Sequence

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import assumed_friction
from truepose.faults.limits import Detectability
from truepose.robot import angles, reading_units
from truepose.show import PRINT, Cell, Table, measured, number

#: Largest fault that is considered, by the reading's unit: m or rad (assumed).
MOST = {"rad": np.radians(3), "m": 0.01}


def undetected_motors(found: Detectability, poses: Array) -> Table:
    """Return one row a motor: its encoder off by just less than `detected` where that moves most.

    The motors hold their setpoints, so the platform stands where that encoder puts it. `poses`
    (N, n) are those of `found`.

    Examples
    --------
    >>> import numpy as np, truepose as tp
    >>> from truepose.faults.undetected import undetected_motors
    >>> h4 = tp.load("h4")
    >>> found = tp.faults.detectability(h4, [h4.home], [h4.home])
    >>> print(*undetected_motors(found, np.array([h4.home])).rows[0], sep="; ")
    q1; 3.00°; 14.4 mm, 0°; theta 0°; 0.0482 N·m (0.300)
    """
    robot, n = found.robot, found.robot.m
    turns, units = angles(robot), reading_units(robot)
    detected = found.detected.reshape(len(poses), -1)
    leak = found.cross_sensitivity["joint"].reshape(len(poses), -1, 2)[..., int(turns.all())]
    rest, rows = np.zeros(robot.n), []
    for i, (chain, own) in enumerate(zip(robot.spec.chain, units, strict=False)):
        most = np.minimum(detected[:, i], MOST[own])
        at = int((leak[:, i] * most).argmax())
        x, off = poses[at], float(most[at])
        q = robot.ikm(x)
        q[i] -= off
        there = robot.fkm(q, guess=x, errors="nan")
        moves = {
            unit: float(np.linalg.norm((there - x)[part]))
            for unit, part in (("m", ~turns), ("rad", turns))
            if part.any()
        }
        change = (robot.rkm(there, errors="nan") - robot.rkm(x)).tolist()
        sensors = list(zip(robot.sensors, change, units[n:], strict=True))
        told = ", ".join(f"{s} {measured(abs(v), u)}" for s, v, u in sensors)
        hold = robot.inverse_dynamics(np.array([x, there]), rest, rest, errors="nan")
        torque, friction = np.abs(hold[1] - hold[0]).max(), assumed_friction(chain)
        unit = "N·m" if own == "rad" else "N"
        rows.append(
            [
                robot.readings[i],
                _cell({own: off}, "off"),
                _cell(moves, "moves"),
                Cell(told, {f"{s} ({PRINT[u][1]})": PRINT[u][0] * v for s, v, u in sensors}),
                Cell(
                    f"{number(torque)} {unit} ({number(friction)})",
                    {f"torque ({unit})": torque, f"friction ({unit})": friction},
                ),
            ]
        )
    header = ["motor", "off by", "platform moves", "sensors change", "torques change (friction)"]
    return Table("undetected", "Undetected motor encoders, each at its worst pose", header, rows)


def worst_of(table: Table) -> str:
    """Return the row whose platform moves farthest, as a sentence."""

    def way(row: Sequence[str]) -> float:
        return float(next(iter(row[2].data.values())))  # type: ignore[attr-defined]

    motor, off, moves, sensors, torques = max(table.rows, key=way)
    seen = f"the sensors by {sensors} and " if sensors else ""
    return (
        f"Undetected at the worst pose: {motor} off by {off} moves the platform by {moves}, {seen}"
        f"the torques at rest by {torques.replace('(', '(friction: ')}."
    )


def _cell(values: dict[str, float], what: str) -> Cell:
    data = {f"{what} ({PRINT[u][1]})": PRINT[u][0] * value for u, value in values.items()}
    if not np.isfinite([*values.values()]).all():
        return Cell("out of the workspace", data)
    return Cell(", ".join(measured(value, unit) for unit, value in values.items()), data)
