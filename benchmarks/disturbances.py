"""Tables of docs/fault-monitor.md: noisy readings, loose contacts, payloads, false alarms.

disturbances.py noise [--robots 3]          # error beyond a healthy robot's
disturbances.py loose [--robots 3]          # the same, calibrated robots, all effects
disturbances.py payload [--robots 30]       # error of the identified mass, calibrated robots
disturbances.py alarms [--robots 25]        # false alarms and names, robots as built
"""

import argparse
from collections import Counter
from itertools import product

import numpy as np
from fault_monitor import SETS, drawn, row

import truepose as tp
from truepose.faults.disturbance import KINDS

AT = 0.05  #: s, start of noise and payloads
MASSES = (0.7, 1.0, 2.0, 4.0)  #: kg


def kinds(robot: tp.Robot, reading: str) -> dict[str, list[tp.faults.Fault]]:
    """Return the noise of a reading: sizes in its counts, times in s."""
    count = robot.resolution[robot.readings.index(reading)]
    bursts = (AT, 0.12, 0.19, 0.26)
    return {
        "counts 16 times coarser": [tp.faults.Fault(reading, "coarse", AT, 16)],
        "noise, σ 10 counts": [tp.faults.Fault(reading, "noise", AT, 10 * count)],
        "bursts of 30 ms, σ 20 counts": [
            tp.faults.Fault(reading, "noise", at, 20 * count, at + 0.03) for at in bursts
        ],
        "held for 5 ms": [tp.faults.Fault(reading, "hold", AT, 0.005)],
        "held for 10 ms": [tp.faults.Fault(reading, "hold", AT, 0.01)],
    }


def noise(robots: int) -> None:
    row("sensors, law", "reading", "noise", "without (mm)", "with (mm)", "failed")
    row("---", "---", "---", "---:", "---:", "---:")
    for which in ("h4 θ", "h4 θ, z"):
        for law in ("joint", "tej", "estimated"):
            cases: dict = {}
            for seed in range(robots):
                robot, truth = drawn(which, seed, True, None)
                healthy = tp.simulate(robot, truth, law, run=tp.simulation.Run(seed=seed))
                for reading in ("q1", *SETS[which][1]):
                    for name, faults in kinds(robot, reading).items():
                        off, failed = [], 0
                        for monitor in (None, tp.FaultMonitor()):
                            run = tp.simulate(
                                robot,
                                truth,
                                law,
                                faults=faults,
                                monitor=monitor,
                                run=tp.simulation.Run(seed=seed),
                            )
                            away = (run.x - healthy.x[: len(run.x)])[:, :3]
                            off.append(1e3 * np.linalg.norm(away, axis=1).max())
                            failed = len(run.failed) + int(run.stops.any())
                        cases.setdefault((reading, name), []).append((*off, failed))
            for (reading, name), found in cases.items():
                without, with_it, failed = np.array(found).T
                ends = f"{without.max():.2f}", f"{with_it.max():.2f}", int(failed.sum())
                row(f"{which}, {law}", reading, name, *ends)


def loose(robots: int) -> None:
    row("sensors", "reading", "failed or stopped", "another failed", "error (mm), median, largest")
    row("---", "---", "---:", "---:", "---:")
    effects = tp.Effects()
    monitor = tp.FaultMonitor(effects=effects)
    for which in ("h4 θ, z", "h4 θ, elbows"):
        cases: dict = {}
        for seed in range(robots):
            robot, truth = drawn(which, seed, True, effects)
            run = tp.simulation.Run(seed=seed, hold=0.3)
            usual = {"effects": effects, "monitor": monitor, "run": run}
            controller = tp.Controller.for_robot(robot, effects)
            healthy = tp.simulate(robot, truth, controller, **usual)
            for reading, at in product(robot.readings, np.arange(0.03, 0.22, 0.035)):
                contact = [tp.faults.Fault(reading, "loose", at)]
                run = tp.simulate(robot, truth, controller, faults=contact, **usual)
                moves = ~run.stops
                away = (run.x - healthy.x[: len(run.x)])[moves, :3]
                found = reading in run.failed or run.stops.any(), bool({*run.failed} - {reading})
                kind = "motors" if reading in robot.readings[: robot.n] else "sensors"
                off = 1e3 * np.linalg.norm(away, axis=1).max()
                cases.setdefault(kind, []).append((*found, off))
        for kind, rows in cases.items():
            found, wrong, off = np.array(rows).T
            ends = f"{np.median(off):.2f}, {off.max():.2f}"
            row(which, kind, f"{int(found.sum())} of {len(rows)}", int(wrong.sum()), ends)


def payload(robots: int) -> None:
    row("payload (kg)", "named", "error after 0.5 s (%), median, largest", "sag, with feed-forward")
    row("---:", "---:", "---:", "---:")
    for mass in MASSES:
        error, sag = [], []
        for seed in range(robots):
            robot, truth = drawn("h4 θ", seed, True, None)
            picked = [tp.faults.Disturbance("payload", AT, mass)]
            healthy = tp.simulate(robot, truth, run=tp.simulation.Run(hold=0.4, seed=seed))
            away = []
            for carry in (False, True):
                monitor = tp.FaultMonitor(carry=carry)
                run = tp.simulate(
                    robot,
                    truth,
                    monitor=monitor,
                    run=tp.simulation.Run(hold=0.4, seed=seed, disturbances=picked),
                )
                away.append(1e3 * np.linalg.norm((run.x - healthy.x)[-1, :3]))
            sag.append(away)
            k = np.searchsorted(run.time, AT + 0.5)
            if KINDS[run.disturbance[k]] == "payload":
                error.append(abs(100 * (run.disturbance_size[k] / mass - 1)))
        ends = f"{np.median(error):.1f}, {max(error):.1f}"
        row(mass, f"{len(error)} of {robots}", ends, "{:.2f}, {:.2f} mm".format(*np.median(sag, 0)))


def alarms(robots: int) -> None:
    row("disturbance", "effects", "faults", "named")
    row("---", "---", "---:", "---")
    for effects in (None, tp.Effects()):
        found: dict = {}
        for seed in range(robots):
            robot, truth = drawn("h4 θ", seed, False, None)
            rng = np.random.default_rng(seed)
            push, blow = ([*rng.uniform(-size, size, 3), 0.0] for size in (40, 200))
            disturbance = tp.faults.Disturbance
            assumed = 0.01 * robot.spec.chain[0].torque_limit
            cases = {
                "none": [],
                "payload, 0.2 to 3 kg": [disturbance("payload", AT, rng.uniform(0.2, 3))],
                "push of 0.1 s": [disturbance("contact", 0.1, force=push, until=0.2)],
                "blow of 20 ms": [disturbance("contact", 0.1, force=blow, until=0.12)],
                "friction, three times, all motors": [
                    disturbance("friction", 0, 2 * assumed, f"q{i}") for i in range(1, 5)
                ],
                "friction, ten times, one motor": [
                    disturbance("friction", 0, 10 * assumed, f"q{seed % 4 + 1}")
                ],
            }
            for name, given in cases.items():
                run = tp.simulate(
                    robot,
                    truth,
                    monitor=tp.FaultMonitor(effects=effects),
                    effects=effects,
                    run=tp.simulation.Run(disturbances=given, seed=seed),
                )
                names = dict.fromkeys(KINDS[k] for k in run.disturbance if k)
                case = found.setdefault(name, [0, Counter()])
                case[0] += bool(run.failed or run.stops.any())
                case[1][", then ".join(names) or "none"] += 1
        for name, (faults, names) in found.items():
            said = "; ".join(f"{what}: {times}" for what, times in names.most_common())
            row(name, "all" if effects else "none", f"{faults} of {robots}", said)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("noise", "loose", "payload", "alarms"))
    parser.add_argument("--robots", type=int)
    args = parser.parse_args()
    usual = {
        "noise": (noise, 3),
        "loose": (loose, 3),
        "payload": (payload, 30),
        "alarms": (alarms, 25),
    }
    table, robots = usual[args.what]
    table(args.robots or robots)


if __name__ == "__main__":
    main()
