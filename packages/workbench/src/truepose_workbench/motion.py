"""Simulated back-and-forth motion with faults and fault monitor, for the workbench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from truepose.faults.fault import Fault
from truepose.faults.monitor import HEALTH, SYMPTOMS, FaultMonitor
from truepose.robot.laws import Law
from truepose.simulation.paths import Waypoints, default_move
from truepose.simulation.simulate import Simulation, simulate
from truepose_workbench.state import State

LAPS, LEG = 2, 0.6  #: laps (there and back) of a run; time of one way, s


def run(
    state: State, law: Law | None = None, faults: Sequence[Fault] = (), monitored: bool = True
) -> Simulation:
    """Simulate `LAPS` laps of the true robot, there and back.

    The motion up to a time depends only on the faults before it. A fault that is switched on during
    playback is thus a run of the same seed with that fault from then on.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose_workbench.state import begin
    >>> state = begin(tp.load("h4"))
    >>> before, after = run(state), run(state, faults=[tp.faults.Fault("theta", "stuck", at=1.0)])
    >>> bool((before.x[:1000] == after.x[:1000]).all()), after.failed
    (True, ['theta'])
    """
    start, end = default_move(state.robot)
    path = Waypoints(poses=[start, *[end, start] * LAPS], duration=LEG)
    monitor = FaultMonitor() if monitored else None
    return simulate(state.robot, state.truth, law, path=path, faults=faults, monitor=monitor)


def lights(played: Simulation, k: int) -> list[tuple[str, str, str]]:
    """Return name, health and symptom ("" if valid) of every reading in period k."""
    health = [HEALTH[code] for code in played.health[k]]
    why = [SYMPTOMS[code] for code in played.symptom[k]]
    rows = zip(played.robot.readings, health, why, strict=True)
    return [(name, state, "" if state == "valid" else symptom) for name, state, symptom in rows]


def ended(faults: Sequence[Fault], reading: str, time: float) -> list[Fault]:
    """Return the faults, with those of a reading ended at `time` if they began before it."""
    return [
        replace(fault, until=time)
        if fault.reading == reading and fault.until is None and fault.at < time
        else fault
        for fault in faults
    ]
