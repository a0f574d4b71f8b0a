"""Output of an estimate: a new printer.cfg, a robot file."""

from __future__ import annotations

from truepose.commands.options import file_text
from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import Assessment
from truepose.integrations.klipper.config import rewritten
from truepose.integrations.klipper.estimate import as_drawn, knowing
from truepose.integrations.klipper.printer import options


def config_text(found: Assessment) -> str:
    """Return the printer's file with the estimate, as SAVE_CONFIG would write it.

    Only free parameters change. Their nominal values, on which the estimate depends, are kept as
    comments, as SAVE_CONFIG does.
    """
    config = found.printer.config
    if config.kind != "printer.cfg":
        raise InputError(f"--write: {config.path} is no printer.cfg ({config.kind}): give that")
    changes: dict[str, dict[str, str]] = {}
    learnt = found.estimate.learnt(found.model.names)
    known = options(found.printer.kinematics)
    for (name, of), value in zip(known.items(), found.estimate.p.tolist(), strict=True):
        if name in learnt or name.startswith("angle"):
            changes.setdefault(of.section, {})[of.option] = f"{value / of.scale:.6f}"
    drawn = as_drawn(found.prior, found.printer.kinematics)
    return rewritten(config, changes, drawn)


def robot_text(found: Assessment) -> str:
    """Return the robot file of the printer with the estimate's parameters and covariance."""
    readings = found.printer.readings
    source = f"Klipper's saved readings: {len(readings.heights)} heights, "
    source += f"{len(readings.distances)} distances"
    covariance = found.estimate.covariance_p
    return file_text(knowing(found.model, found.estimate.p, covariance, source))
