"""Output of an estimate: a new printer.cfg, a robot file."""

from __future__ import annotations

from truepose import robotfile
from truepose.integrations.klipper.assessment import Assessment
from truepose.integrations.klipper.config import rewritten
from truepose.integrations.klipper.estimate import as_drawn, knowing
from truepose.integrations.klipper.printer import options
from truepose.robot.robot import Robot


def config_text(found: Assessment) -> str:
    """Return the printer's file with the estimate, as SAVE_CONFIG would write it.

    Only free parameters change. Their nominal values, on which the estimate depends, are kept as
    comments, as SAVE_CONFIG does.
    """
    changes: dict[str, dict[str, str]] = {}
    learnt = found.estimate.learnt(found.model.names)
    values = zip(found.model.names, found.estimate.p.tolist(), strict=True)
    known = options(found.printer.kinematics)
    for name, value in values:
        if name in learnt or name.startswith("angle"):
            option = known[name]
            text = f"{value / option.scale:.6f}"
            changes.setdefault(option.section, {})[option.option] = text
    drawn = as_drawn(found.prior, found.model.names, found.printer.kinematics)
    return rewritten(found.printer.config, changes, drawn)


def robot_of(found: Assessment) -> Robot:
    """Return the printer as a robot with the estimate's parameters and covariance."""
    readings = found.printer.readings
    source = f"Klipper's saved readings: {len(readings.heights)} heights, "
    source += f"{len(readings.distances)} distances"
    return knowing(found.model, found.estimate.p, found.estimate.covariance_p, source)


def robot_text(found: Assessment) -> str:
    """Return the robot file of :func:`robot_of`."""
    robot = robot_of(found)
    return robotfile.to_toml(robot.spec, {n: p.value for n, p in robot.parameters.items()})
