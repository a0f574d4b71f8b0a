"""Observer of external forces for the fault monitor.

Experimental and uncertified.
"""

from __future__ import annotations

from dataclasses import dataclass

from truepose import _core
from truepose.arguments import require
from truepose.robot.robot import Robot
from truepose_safety._safety import momentum


@dataclass(frozen=True, kw_only=True)
class MomentumObserver:
    """Observes external forces by the generalised momentum, and names their cause.

    The fault monitor then blames no reading for a payload, friction or a contact. Without torque
    limits there is no observer.

    Parameters
    ----------
    carry : bool
        Whether an identified payload is fed forward.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_safety import MomentumObserver
    >>> monitor = tp.FaultMonitor(forces=MomentumObserver())
    >>> picked = tp.faults.Disturbance("payload", at=0.05, size=2.0)
    >>> options = tp.simulation.Run(disturbances=[picked])
    >>> run = tp.simulate(tp.load("h4"), monitor=monitor, run=options)
    >>> run.status.split(" from")[0]
    'payload of 2 kg'
    """

    carry: bool = False

    def __post_init__(self) -> None:
        require(self.carry, bool, "carry", "True or False")

    def supervisor(self, robot: Robot, settings: _core.ControlSettings) -> _core.Supervisor | None:
        """Return the core's supervisor for one run."""
        return momentum(robot.core, settings, self.carry)
