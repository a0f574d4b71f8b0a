"""Simulated sensor faults: docs/fault-consequences.md and the campaign of docs/safety-shell.md.

faults.py consequences [--moves 30] [--seed 0] [--calibrated]   # of packages/paper, minutes
faults.py campaign [--plant own] [--robots 8] [--jobs 2] [--out FILE]  # every kind, in the shell
faults.py frozen [--robots 8]                                   # all readings at once
faults.py healthy [--robots 200] [--seconds 10] [--out FILE]    # false alarms, all effects

Consequences: the nominal H4 without other errors makes the paper's move and others between poses of
Table 2. At a random time in each, one reading becomes faulty; errors count until 0.3 s after the
move. With --calibrated the controller's model is calibrated at Table 2's poses.

Campaign: robots, paths and sizes of faults as of `fault_monitor.py faults`, in the safety shell
alone and with the fault monitor. A fault's delay counts from the first cycle in which its reading
is off by the limit of `tp.faults.detectability` (median over the path).

Healthy: robots of each sensor set with all effects, in shell and monitor; laws and disturbances
take turns.

Results of both are added to FILE, a row of JSON for each robot; rows that it has are not computed
again.
"""

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import fault_monitor as fm
import numpy as np

import truepose as tp
from truepose import _core
from truepose.control.safety import CAUSES, SafetyLimits
from truepose.faults.disturbance import KINDS
from truepose.faults.fault import in_core
from truepose.robot.workspace import workspace_grid
from truepose.show.table import markdown

SETS = fm.SETS | fm.MORE
LAWS = ("joint", "estimated")
MODES = {"shell": None, "monitor and shell": tp.FaultMonitor()}
DISTURBED = "none", "payload", "contact", "friction"
AFTER = 0.3  #: s of a path after the fault
SLOW = 0.01  #: m/s, from which on stops are compared with the printed distance


@dataclass
class Trail:
    """What a plant recorded, a row per control period."""

    time: np.ndarray
    x: np.ndarray
    q_e: np.ndarray
    torque: np.ndarray
    cause: np.ndarray
    brakes: np.ndarray
    health: np.ndarray
    ended: str = ""  #: why before its time

    @property
    def stop(self) -> int | None:
        """The row of the first cause of a stop."""
        return int((self.cause > 0).argmax()) if self.cause.any() else None


Plant = Callable[..., Trail]  #: of faults and a monitor


def own_plant(robot: tp.Robot, truth: tp.Robot, control: tp.Controller, seed: int) -> Plant:
    """Return the package's own simulation along a path of two moves."""
    path = fm.way(robot, fm.AT + AFTER, seed, 0.3)

    def run(faults: tuple = (), monitor: tp.FaultMonitor | None = None) -> Trail:
        ran = tp.simulate(
            robot,
            truth,
            control,
            path=path,
            faults=faults,
            monitor=monitor,
            run=tp.simulation.Run(seed=seed, safety=tp.control.SafetyShell()),
        )
        columns = ran.q_e, ran.torque, ran.stop_cause, ran.brakes, ran.health
        return Trail(ran.time, ran.x, *columns, ran.ended)

    return run


def mujoco_plant(robot: tp.Robot, truth: tp.Robot, control: tp.Controller, seed: int) -> Plant:
    """Return rigid bodies in MuJoCo, in a move of half a second."""
    from truepose_mujoco.plant import MujocoPlant, _Drive

    class Recorded(_Drive):
        def _trace(self) -> np.ndarray:
            state, n, e = self.state, robot.n, robot.n + robot.r
            row = self.body.coordinates(), self.read, np.array(state.torque)[:n], state.cause
            rows.append((*row, state.brakes, np.array(state.health)[:e]))
            return super()._trace()

        def _faulty(self, time: float) -> np.ndarray:
            self.read = super()._faulty(time)
            return self.read

    rows: list[tuple] = []

    def run(faults: tuple = (), monitor: tp.FaultMonitor | None = None) -> Trail:
        rows.clear()
        plant = MujocoPlant(
            truth, seed=seed, duration=0.5, hold=0.2, longest=0.2, faults=faults, monitor=monitor,
            safety=tp.control.SafetyShell(),
        )  # fmt: skip
        said = Recorded(plant, robot, control, seed, 0.0).go(fm.poses(robot, 1, seed)[0], 0.0)[-1]
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        lost = said if said.startswith("lost") else ""
        return Trail(np.arange(len(rows)) * control.period, *columns, lost)

    return run


PLANTS = {"own": own_plant, "mujoco": mujoco_plant}


def case(run: Trail, healthy: Trail, robot: tp.Robot, limits: SafetyLimits) -> dict:
    """Return how a run in the shell ended, against the same run without a fault."""
    period, stop = limits.core.period, run.stop
    rows = min(len(run.x), len(healthy.x))
    moving = np.array([unit == "m" for _, unit in robot.coordinates])
    alarm = fm.first(run.health)
    seen = [at for at in (stop, alarm) if at is not None]
    off = np.abs(run.x[:rows] - healthy.x[:rows])[: None if stop is None else stop + 1]
    steps = np.abs(np.diff(run.torque, axis=0)) / (limits.motors("slew") * period)
    found = {
        "detected": min(seen) if seen else None,
        "named": tp.faults.monitor.failed(robot, run.health),
        "cause": CAUSES[run.cause[-1]],
        "ended": run.ended,
        "off": float(1e3 * np.linalg.norm(off[:, moving], axis=1).max()),
        "turned": float(np.degrees(off[:, ~moving].max())) if (~moving).any() else 0.0,
        "step": float(steps.max()),
    }
    if stop:
        speed = np.linalg.norm(run.x[stop, moving] - run.x[stop - 1, moving]) / period
        way = np.linalg.norm(run.x[stop:, moving] - run.x[stop, moving], axis=1).max()
        found |= {"speed": float(speed), "way": float(1e3 * way), "brake": bool(run.brakes[stop])}
        found["printed"] = 1e3 * limits.stopping_distance(max(float(speed), 1e-6))
    return found


def job(plant: str, which: str, law: str, seed: int) -> list[dict] | None:
    """Return the results of every fault of one calibrated robot; None: it cannot make the path."""
    robot, truth = fm.drawn(which, seed, True, None)
    controller = tp.Controller(law=law)
    run = PLANTS[plant](robot, truth, controller, seed)
    try:
        healthy = run()
    except (tp.PoseError, tp.InputError):
        return None
    if healthy.cause.any():
        return [{"kind": "none", "mode": "shell", "cause": CAUSES[healthy.cause[-1]]}]
    detectable = tp.faults.detectability(robot, healthy.x[::20], fm.poses(robot, fm.POSES, seed))
    stated = detectable.pose_error(law)[..., 0].reshape(-1, len(robot.readings))
    limits, results = tp.control.SafetyShell().limits(robot, controller), []
    for c, reading in enumerate(robot.readings):
        limit = float(np.median(detectable.detected[:, c]))
        if not limit < fm.MOST:
            continue
        for (kind, fault), (mode, monitor) in product(
            fm.faults_of(robot, reading, limit).items(), MODES.items()
        ):
            found = case(run(fault, monitor), healthy, robot, limits)
            core = in_core(robot, fault, controller.period)
            alone = _core.FaultyReadings(core, controller.period)
            read = np.asarray(alone.read(healthy.time.tolist(), healthy.q_e))
            beyond = ~(np.abs(read - healthy.q_e)[:, c] < limit)
            found |= {
                "reading": reading,
                "kind": kind,
                "mode": mode,
                "crossed": int(beyond.argmax()) if beyond.any() else None,
                "wrong": bool(set(found["named"]) - {reading, fault[0].other}),
                "stated": float(1e3 * stated[:, c].max()),
            }
            results.append(found)
    return results


def frozen(which: str, law: str, counter: bool, seed: int) -> list[dict]:
    """Return the way after all readings freeze, at several speeds, of one nominal robot."""
    name, sensors = SETS[which]
    robot = tp.load(name).with_sensors(*sensors)
    shell = tp.control.SafetyShell(counter=counter)
    controller = tp.Controller(law=law)
    limits, results = shell.limits(robot, controller), []
    random = np.random.default_rng([seed, 3])
    box = robot.spec.workspace
    for speed in (0.02, 0.1, 0.3, 0.6):
        direction = np.zeros(robot.n)
        direction[:3] = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        start = np.clip(robot.home - 0.04 * direction, box.minimum, box.maximum)
        end = np.clip(robot.home + 0.04 * direction, box.minimum, box.maximum)
        duration = 1.875 * float(np.linalg.norm(end - start)) / speed
        at = round(duration * random.uniform(0.35, 0.65), 3)
        fault = [tp.faults.Fault("frame", "stuck", at)]
        try:
            run = tp.simulate(
                robot,
                None,
                controller,
                faults=fault,
                run=tp.simulation.Run(
                    start=start, end=end, duration=duration, hold=0.2, seed=seed, safety=shell
                ),
            )
        except (tp.PoseError, tp.InputError):
            continue
        k = round(at / controller.period)
        x = run.x[:, :3]
        now = float(np.linalg.norm(x[k] - x[k - 1]) / controller.period)
        way = 1e3 * float(np.linalg.norm(x[k:] - x[k], axis=1).max())
        stop = int((run.stop_cause > 0).argmax())
        cause = CAUSES[run.stop_cause[-1]]
        results.append(
            {
                "speed": speed,
                "now": now,
                "cycles": stop - k if cause != "none" else None,
                "cause": cause,
                "way": way,
                "printed": 1e3 * limits.stopping_distance(now),
                "which": which,
            }
        )
    return results


def disturbances(robot: tp.Robot, kind: str, seed: int) -> list[tp.faults.Disturbance]:
    """Return what a healthy robot tolerates."""
    random, disturbance = np.random.default_rng([seed, 4]), tp.faults.Disturbance
    limits = [chain.torque_limit for chain in robot.spec.chain]
    if kind == "payload":
        return [disturbance("payload", random.uniform(0.3, 3), random.uniform(0.2, 3))]
    if kind == "contact":  # a push with a quarter, a blow with half of the force that they hold
        J, pulls = robot.jacobian(robot.home)[:3], random.normal(size=(2, 3))
        pulls /= np.abs(pulls @ J / limits).max(axis=1, keepdims=True)
        return [
            disturbance(
                "contact", at, force=[*share * pull, *[0.0] * (robot.n - 3)], until=at + lasts
            )
            for pull, at, share, lasts in zip(
                pulls, (1.0, 3.0), (0.25, 0.5), (0.1, 0.02), strict=True
            )
        ]
    return [  # three times the assumed friction
        disturbance("friction", 0.0, 0.02 * limit, f"q{i + 1}")
        for i, limit in enumerate(limits)
        if kind == "friction"
    ]


def healthy(seconds: float, which: str, law: str, kind: str, seed: int) -> dict:
    """Return the cycles of one healthy robot with all effects, its alarms, and the names given."""
    effects = tp.Effects()
    robot, truth = fm.drawn(which, seed, True, effects)
    try:
        control = tp.Controller.for_robot(robot, effects, law)
        run = tp.simulate(
            robot,
            truth,
            control,
            path=fm.way(robot, seconds, seed, 0.7),
            effects=effects,
            monitor=tp.FaultMonitor(effects=effects),
            run=tp.simulation.Run(
                seed=seed,
                safety=tp.control.SafetyShell(effects=effects),
                disturbances=disturbances(robot, kind, seed),
            ),
        )
    except (tp.PoseError, tp.InputError) as error:
        return {"cycles": 0, "alarm": "", "status": str(error), "names": []}
    alarm = ""
    if run.stop_cause.any() or (run.health > 0).any():
        faulty = [name for name, of in zip(robot.readings, run.health.T, strict=True) if of.any()]
        alarm = f"{CAUSES[run.stop_cause[-1]]}; {', '.join(faulty)}"
    names = list(dict.fromkeys(KINDS[k] for k in run.disturbance[run.disturbance > 0]))
    return {"cycles": len(run.x), "alarm": alarm, "status": run.status, "names": names}


def resumed(pool: ProcessPoolExecutor, work: Callable, keys: list[tuple], out: Path) -> list:
    """Return the results of all keys; those that `out` does not have are computed and added."""
    text = out.read_text() if out.exists() else ""
    have = {tuple(row["job"]): row["found"] for row in map(json.loads, text.splitlines())}
    missing = [key for key in keys if key not in have]
    with out.open("a") as file:
        for key, found in zip(missing, pool.map(partial(_starred, work), missing), strict=True):
            have[key] = found
            print(json.dumps({"job": key, "found": found}), file=file, flush=True)
    return [have[key] for key in keys]


def _starred(work: Callable, key: tuple) -> object:
    return work(*key)


def run_campaign(
    pool: ProcessPoolExecutor, plant: str, sets: list[str], robots: int, out: Path
) -> list[dict]:
    """Return all cases of the campaign."""
    keys = [(plant, *key) for key in product(sets, LAWS, range(robots))]
    names = "plant", "which", "law", "seed"
    found = resumed(pool, job, keys, out)
    return [
        dict(zip(names, key, strict=True)) | one
        for key, cases in zip(keys, found, strict=True)
        for one in cases or ()
    ]


def print_campaign(cases: list[dict]) -> None:
    """Print one row per mode and kind of fault, and what both together do not detect."""
    print("stops of healthy robots:", [one for one in cases if one["kind"] == "none"])
    cases = [one for one in cases if one["kind"] != "none"]
    error = "error median, 99 %, largest (mm)"
    fm.row(
        "kind", "cases", "detected", "median, 99 % (ms)", "wrong", error,
        "beyond max(1 mm, 1.2 × stated)", "stop, over the printed one",
    )  # fmt: skip
    fm.row("---", *["---:"] * 7)
    for mode in MODES:
        kinds = defaultdict(list)
        for one in cases:
            if one["mode"] == mode:
                kinds[one["kind"]].append(one)
        for kind, those in kinds.items():
            crossed = [one for one in those if one["crossed"] is not None]
            if not crossed:  # this kind never reaches the limit
                fm.row(f"{kind}, {mode}", "0", *[""] * 6)
                continue
            seen = [one for one in crossed if one["detected"] is not None]
            delays = [max(0, one["detected"] - one["crossed"]) for one in seen]
            off = np.array([one["off"] for one in crossed])
            bound = [max(1.0, 1.2 * min(one["stated"], 1e9)) for one in crossed]
            ways = [
                one["way"] / one["printed"]
                for one in those
                if one.get("brake") and one["speed"] > SLOW
            ]
            late = np.quantile(delays, [0.5, 0.99]) if delays else [np.nan] * 2
            fm.row(
                f"{kind}, {mode}",
                f"{len(crossed)}",
                f"{len(seen)}",
                f"{late[0]:.0f}, {late[1]:.0f}",
                sum(one["wrong"] for one in those),
                f"{np.median(off):.2f}, {np.quantile(off, 0.99):.1f}, {off.max():.1f}",
                int((off > bound).sum()),
                f"{max(ways):.2f}" if ways else "",
            )
    print(f"largest torque step over the slew limit: {max(one['step'] for one in cases):.9f}")
    undetected = Counter(
        (one["mode"], one["which"], one["reading"], one["kind"])
        for one in cases
        if one["crossed"] is not None and one["detected"] is None and one["mode"] != "shell"
    )
    print("undetected by both:", dict(undetected))


def print_frozen(pool: ProcessPoolExecutor, robots: int) -> None:
    keys = list(product(SETS, LAWS, (True, False), range(robots)))
    table = defaultdict(list)
    for key, rows in zip(keys, pool.map(partial(_starred, frozen), keys), strict=True):
        for one in rows:
            table[one["speed"], key[2]].append(one)
    fm.row("speed (m/s)", "frames", "cases", "detected after (cycles)", "way (mm)", "over printed")
    fm.row(*["---:"] * 6)
    for (speed, counter), rows in sorted(table.items(), key=lambda item: (item[0][0], -item[0][1])):
        cycles = [one["cycles"] for one in rows if one["cycles"] is not None]
        fm.row(
            speed,
            "with a counter" if counter else "without",
            len(rows),
            f"{min(cycles)} to {max(cycles)}" + f", {len(rows) - len(cycles)} never",
            f"{max(one['way'] for one in rows):.1f}",
            f"{max(one['way'] / one['printed'] for one in rows):.2f}",
        )


def print_healthy(
    pool: ProcessPoolExecutor, sets: list[str], robots: int, seconds: float, out: Path
) -> None:
    """Print one row per sensor set and disturbance."""
    keys = [
        (seconds, which, LAWS[seed % 2], DISTURBED[seed // 2 % len(DISTURBED)], seed)
        for seed, which in product(range(robots), sets)
    ]
    table = defaultdict(list)
    for (_, which, _, kind, _), one in zip(keys, resumed(pool, healthy, keys, out), strict=True):
        table[which, kind].append(one)
    fm.row("sensors", "disturbance", "robots", "cycles", "alarms", "named")
    fm.row("---", "---", "---:", "---:", "---:", "---")
    for (which, kind), found in sorted(table.items()):
        alarms = Counter(one["alarm"] for one in found if one["alarm"])
        names = Counter(", then ".join(one["names"]) or "none" for one in found if one["cycles"])
        fm.row(
            which,
            kind,
            sum(one["cycles"] > 0 for one in found),
            sum(one["cycles"] for one in found),
            "; ".join(f"{alarm}: {times}" for alarm, times in alarms.items()) or 0,
            "; ".join(f"{name}: {times}" for name, times in names.most_common()),
        )


def consequences(moves: int, seed: int, calibrated: bool) -> None:
    """Print the table of docs/fault-consequences.md."""
    from truepose_paper import faulty, tables

    robot = truth = tp.load("h4")
    if calibrated:
        robot = tp.calibrate(truth, truth.read(workspace_grid(truth))).robot
    print(markdown(tables.faults(faulty.study(robot, moves, seed, truth=truth))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("consequences", "campaign", "frozen", "healthy"))
    parser.add_argument("--moves", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calibrated", action="store_true")
    parser.add_argument("--robots", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--plant", choices=PLANTS, default="own")
    parser.add_argument("--out", type=Path, default=Path("campaign.jsonl"))
    args = parser.parse_args()
    if args.what == "consequences":
        return consequences(args.moves, args.seed, args.calibrated)
    with ProcessPoolExecutor(args.jobs) as pool:
        if args.what == "campaign":
            print_campaign(run_campaign(pool, args.plant, args.sets, args.robots, args.out))
        elif args.what == "frozen":
            print_frozen(pool, args.robots)
        else:
            print_healthy(pool, args.sets, args.robots, args.seconds, args.out)
    return None


if __name__ == "__main__":
    main()
