"""The safety shell of simulated runs.

Experimental and uncertified.
"""

from dataclasses import dataclass

from truepose import _core
from truepose.control.limits import Limits, SafetyLimits
from truepose_safety import _safety

#: States, by the core's number.
STATES = ("ready", "running", "stopping", "stopped", "fault")


@dataclass(frozen=True, kw_only=True)
class SafetyShell(Limits):
    """A safety shell around the law of a simulated run: limits of every cycle, and stops.

    It opens the loop after a violation and stops the robot, with or without a fault monitor. Its
    parameters are those of :class:`truepose.control.Limits`.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_safety import SafetyShell
    >>> frozen, run = tp.faults.Fault("frame", "stuck", at=0.1), tp.simulation.Run
    >>> tp.simulate(tp.load("h4"), faults=[frozen], run=run(safety=SafetyShell())).status
    'safety shell: stale frame at 0.102 s, stopped by brake'
    """

    def guard(self, limits: SafetyLimits) -> _core.Guard:
        """Return the core's guard for one run."""
        return _safety.guard(limits.core, limits.counter)
