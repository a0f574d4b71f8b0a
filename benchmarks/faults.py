"""Simulated faults and disturbances of sampled robots, each rod on its own.

faults.py monitor [--robots 3]           # every kind, above its limit
faults.py rates [--robots 100] [--seconds 10]    # false alarms under normal noise
faults.py alarms [--robots 8] [--seconds 10]   # false alarms with all effects
faults.py payload [--robots 30]          # disturbances
faults.py campaign [--robots 5]          # every kind, in the safety shell
faults.py frozen [--robots 8]            # there: all readings at once
faults.py healthy [--robots 200] [--seconds 10]  # there: false alarms with all effects, an hour
faults.py consequences                   # every kind, with and without the monitor

The tables are in docs/results.md.

All but `monitor` and `alarms` need the package truepose-safety. Robots calibrated themselves on
readings at 100 poses. Errors are relative to the same run without a fault. Delays count from the
first cycle in which the reading is off by its size, under `monitor` from the fault on. Sizes:
fault_sizes.csv, the limits of
`tp.faults.detectability` in version 0.5 (median over paths of three robots without conditions).
"""

import csv
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
from printing import arguments, head, row

import truepose as tp
from truepose import _core
from truepose.faults.disturbance import KINDS
from truepose.faults.fault import in_core
from truepose.faults.monitor import first
from truepose.robot import LAWS, angles, reading_units, workspace_grid, workspace_samples
from truepose.simulation.paths import default_move

SETS = {
    "h4 θ": ("h4", ["theta"]),
    "h4 θ, z": ("h4", ["theta", "z_telemeter"]),
    "h4 θ, elbows": ("h4", ["theta", "elbow1", "elbow2", "elbow3", "elbow4"]),
    "delta z, elbows": ("delta", ["z_telemeter", "elbow1", "elbow2", "elbow3"]),
    "stewart z, U-joints": ("stewart", ["z_telemeter", *(f"u_joint{k}" for k in range(1, 7))]),
}
POSES = 100  #: of a calibration
SETTLING, PIECE = 33, 200  #: start-up cycles of the fault monitor; cycles of a path per restart
CHANCES = (1e-3, 1e-4, 1e-5)  #: false alarms per cycle
TIMES, AT = 1.5, 0.25  #: size of a fault over its detectability; its start, s, moves take 0.3 s
PICKED = 0.05  #: s, start of noise and payloads
SLOW = 0.01  #: m/s, from which on stops are compared with the printed distance
Fault, Disturbance, Run = tp.faults.Fault, tp.faults.Disturbance, tp.simulation.Run


def monitoring(carry: bool = False, **options: object) -> tp.FaultMonitor:
    """Return a fault monitor with an observer of external forces."""
    from truepose_safety import MomentumObserver

    return tp.FaultMonitor(forces=MomentumObserver(carry=carry), **options)


def shell_of(**options: object) -> Any:
    """Return a safety shell."""
    from truepose_safety import SafetyShell

    return SafetyShell(**options)


def sampled(which: str, seed: int, effects: tp.Effects | None = None) -> tuple[tp.Robot, tp.Robot]:
    """Return the controller's calibrated model and the true robot."""
    name, sensors = SETS[which]
    robot = tp.load(name).with_sensors(*sensors).expected()
    truth = there = robot.sample(seed)
    if effects is not None:
        robot, there = effects.allowed_for(robot), effects.geometry(truth, 0, seed)
    return tp.calibrate(robot, there.read(poses(robot, POSES, seed), seed=seed)).robot, truth


@cache
def sizes() -> dict[tuple[str, str], float]:
    """Return the detectability of each set's readings in version 0.5, rad or m."""
    with (Path(__file__).parent / "fault_sizes.csv").open(encoding="utf-8") as file:
        rows = csv.DictReader(file)
        return {(one["sensors"], one["reading"]): float(one["detected"]) for one in rows}


def poses(robot: tp.Robot, count: int, seed: int) -> np.ndarray:
    """Return random poses of the workspace."""
    return workspace_samples(robot, count, np.random.default_rng([seed, 1]))


def way(robot: tp.Robot, count: int, seed: int, each: float) -> tp.simulation.Waypoints:
    """Return a path over random poses."""
    return tp.simulation.Waypoints(poses=poses(robot, count, seed), duration=each)


def faults_of(robot: tp.Robot, reading: str, limit: float) -> dict[str, list[Fault]]:
    """Return faults of every kind, above this limit where they have a size."""
    units = dict(zip(robot.readings, reading_units(robot), strict=True))
    alike = [name for name, unit in units.items() if unit == units[reading] and name != reading]
    size = TIMES * limit
    sizes = {"reading": size, "reading/s": size / 0.1, "1": 1.1, "s": 0.02}
    return {
        kind: [
            Fault(
                reading,
                kind,
                AT,
                max(size, 0.02) if kind == "spike" else sizes.get(row.size),
                other=alike[0] if row.pair else None,
            )
        ]
        for kind, row in _core.fault_kinds.items()
        if alike or not row.pair
    }


def each_fault(law: str, shells: bool, task: tuple[str, int]) -> list[dict]:
    """Return the results on every fault of a robot, with the monitor and, if `shells`, without."""
    which, seed = task
    effects = tp.Effects()
    robot, truth = sampled(which, seed, effects)
    controller = tp.Controller.for_robot(robot, effects, law)
    shell = shell_of(effects=effects) if shells else None
    watching = monitoring(effects=effects) if shells else tp.FaultMonitor(effects=effects)
    path = way(robot, 3 if shells else 4, seed, 0.3)
    run = partial(
        tp.simulate, robot, truth, controller, path=path, effects=effects,
        run=Run(seed=seed, safety=shell),
    )  # fmt: skip
    try:
        healthy = run()
    except (tp.PoseError, tp.InputError):
        return []
    limits = tp.control.Limits().limits(robot, controller)
    detectable = tp.faults.detectability(robot, healthy.x[::20], poses(robot, POSES, seed))
    stated = detectable.pose_error(law)[..., 0].reshape(-1, len(robot.readings))
    turning = angles(robot)
    results = []
    for c, reading in enumerate(robot.readings):
        limit = sizes()[which, reading]
        for (kind, fault), monitor in product(
            faults_of(robot, reading, limit).items(), (watching, None)[: 1 + shells]
        ):
            ran = run(faults=fault, monitor=monitor)
            alone = _core.FaultyReadings(in_core(robot, fault, controller.period), 1e-3)
            read = np.asarray(alone.read(healthy.time.tolist(), healthy.q_e))
            beyond = ~(np.abs(read - healthy.q_e)[:, c] < limit)
            begun = beyond.argmax() if shells else np.searchsorted(ran.time, AT)
            if shells and not beyond.any():  # this kind never reaches the limit
                continue
            stops = (ran.stop_cause > 0) | ran.stops
            stop = int(stops.argmax()) if stops.any() else None
            seen = [at for at in (stop if shells else None, first(ran.health)) if at is not None]
            off = np.abs(ran.x - healthy.x[: len(ran.x)])[: None if stop is None else stop + shells]
            named = set(ran.failed)
            right = bool(named) and named <= {reading, fault[0].other}
            one = {
                "sensors": which,
                "kind": kind,
                "mode": "monitor" if monitor else "shell alone",
                "delay": max(0, min(seen) - begun) if seen else np.nan,
                "isolated": "right" if right else "wrong" if named else "none",
                "off": 1e3
                * np.linalg.norm(off[:, ~turning], 2 if shells else np.inf, 1).max(initial=0),
                "turned": np.degrees(off[:, turning].max(initial=0)),
                "stated": max(0.2, 2e3 * min(stated[:, c].max(), 1e6)),
                "way": np.nan,
                # Of these sizes, larger than what one cycle shows of these robots now.
                "visible": TIMES * limit > np.median(detectable.detected[:, c])
                or kind not in ("bias", "jump", "drift", "noise", "coarse"),
            }
            if shells and stop and ran.brakes[stop]:
                x = ran.x[stop - 1 :, ~turning]
                speed = np.linalg.norm(x[1] - x[0]) / controller.period
                if speed > SLOW:
                    far = np.linalg.norm(x[1:] - x[1], axis=1).max()
                    one["way"] = far / limits.stopping_distance(speed)
            results.append(one)
    return results


def print_faults(found: Iterable[list[dict]], by: str) -> None:
    """Print one row per kind of fault and mode or sensor set."""
    groups = defaultdict(list)
    for one in chain.from_iterable(found):
        groups[one[by], one["kind"]].append(one)
    head(by, "kind", "cases", "above the limit", "of these detected", "detected",
        "median, 99 % (ms)", "isolated: right, none, wrong",
        "error: median, 99 %, largest (mm, °)", "found: beyond 2 × detectability's and 0.2 mm",
        "stop, over the printed one", words=2)  # fmt: skip
    for (group, kind), cases in groups.items():
        off, turned, stated, ways, delays = (
            np.array([one[key] for one in cases])
            for key in ("off", "turned", "stated", "way", "delay")
        )
        found = np.isfinite(delays)
        delays, ways = delays[found], ways[np.isfinite(ways)]
        late = np.quantile(delays, [0.5, 0.99]) if len(delays) else [np.nan] * 2
        names = Counter(one["isolated"] for one in cases)
        visible = [one for one in cases if one["visible"]]
        row(
            group,
            kind,
            len(cases),
            len(visible),
            sum(np.isfinite(one["delay"]) for one in visible),
            len(delays),
            f"{late[0]:.0f}, {late[1]:.0f}",
            ", ".join(str(names[verdict]) for verdict in ("right", "none", "wrong")),
            f"{np.median(off):.2f}, {np.quantile(off, 0.99):.1f}, {off.max():.1f}, "
            f"{turned.max():.1f}",
            ((off > stated) & found).sum(),
            f"{ways.max():.2f}" if len(ways) else "",
        )


def frozen(task: tuple[str, str, bool, int]) -> list[tuple]:
    """Return speed, counter, delay and way after all readings of a nominal robot freeze."""
    which, law, counter, seed = task
    name, sensors = SETS[which]
    robot = tp.load(name).with_sensors(*sensors)
    shell, controller = shell_of(counter=counter), tp.Controller(law=law)
    limits, results = shell.limits(robot, controller), []
    random = np.random.default_rng([seed, 3])
    box = robot.spec.workspace
    for speed in (0.02, 0.1, 0.3, 0.6):
        direction = np.zeros(robot.n)
        direction[:3] = random.normal(size=3)
        direction *= 0.04 / np.linalg.norm(direction)
        start, end = (
            np.clip(robot.home + side * direction, box.minimum, box.maximum) for side in (-1, 1)
        )
        duration = 1.875 * float(np.linalg.norm(end - start)) / speed
        at = round(duration * random.uniform(0.35, 0.65), 3)
        try:
            run = tp.simulate(
                robot, None, controller, faults=[Fault("frame", "stuck", at)],
                run=Run(start=start, end=end, duration=duration, hold=0.2, seed=seed, safety=shell),
            )  # fmt: skip
        except (tp.PoseError, tp.InputError):
            continue
        k, x = round(at / controller.period), run.x[:, :3]
        now = float(np.linalg.norm(x[k] - x[k - 1]) / controller.period)
        way = float(np.linalg.norm(x[k:] - x[k], axis=1).max())
        cycles = int((run.stop_cause > 0).argmax()) - k if run.stop_cause.any() else np.inf
        results.append((speed, counter, cycles, 1e3 * way, way / limits.stopping_distance(now)))
    return results


def print_frozen(pool: ProcessPoolExecutor, robots: int) -> None:
    tasks = product(SETS, ("joint", "estimated"), (True, False), range(robots))
    rows = np.array([*chain.from_iterable(pool.map(frozen, tasks))])
    head("speed (m/s)", "frames", "cases", "detected after (cycles)", "way (mm)", "over printed")
    for speed, counter in sorted(map(tuple, np.unique(rows[:, :2], axis=0)), reverse=True):
        cycles, way, over = rows[(rows[:, :2] == (speed, counter)).all(axis=1), 2:].T
        frames = "with a counter" if counter else "without"
        delays = f"{cycles.min():.0f} to {cycles.max():.0f}"
        row(speed, frames, len(way), delays, f"{way.max():.1f}", f"{over.max():.2f}")


def disturbances(robot: tp.Robot, kind: str, seed: int) -> list[Disturbance]:
    """Return what a healthy robot tolerates."""
    random = np.random.default_rng([seed, 4])
    limits = [chain.torque_limit for chain in robot.spec.chain]
    if kind == "payload":
        return [Disturbance("payload", random.uniform(0.3, 3), random.uniform(0.2, 3))]
    if kind == "contact":  # a push with a quarter, a blow with half of the force that they hold
        J, pulls = robot.jacobian(robot.home)[:3], random.normal(size=(2, 3))
        pulls /= np.abs(pulls @ J / limits).max(axis=1, keepdims=True)
        rest = [0.0] * (robot.n - 3)
        return [
            Disturbance("contact", 1.0, force=[*0.25 * pulls[0], *rest], until=1.1),
            Disturbance("contact", 3.0, force=[*0.5 * pulls[1], *rest], until=3.02),
        ]
    return [  # three times the assumed friction
        Disturbance("friction", 0.0, 0.02 * limit, f"q{i + 1}")
        for i, limit in enumerate(limits)
        if kind == "friction"
    ]


def healthy(seconds: float, alone: bool, task: tuple[int, str]) -> tuple:
    """Return set, disturbance, cycles, alarm and names of one healthy robot with all effects.

    `alone`: the monitor without observer and shell.
    """
    seed, which = task
    kind = ("none", "payload", "contact", "friction")[seed // 2 % 4]
    effects = tp.Effects()
    robot, truth = sampled(which, seed, effects)
    try:
        control = tp.Controller.for_robot(robot, effects, ("joint", "estimated")[seed % 2])
        run = tp.simulate(
            robot, truth, control, path=way(robot, int(seconds / 0.7) + 2, seed, 0.7),
            effects=effects,
            monitor=tp.FaultMonitor(effects=effects) if alone else monitoring(effects=effects),
            run=Run(seed=seed, safety=None if alone else shell_of(effects=effects),
                    disturbances=disturbances(robot, kind, seed)),
        )  # fmt: skip
    except (tp.PoseError, tp.InputError):
        return which, kind, 0, "", ""
    alarmed = run.stop_cause.any() or run.stops.any() or (run.health > 0).any()
    alarm = run.status if alarmed else ""
    names = dict.fromkeys(KINDS[k] for k in run.disturbance[run.disturbance > 0])
    return which, kind, len(run.x), alarm, ", then ".join(names) or "none"


def print_healthy(pool: ProcessPoolExecutor, robots: int, seconds: float, alone: bool) -> None:
    groups = defaultdict(list)
    one_robot = partial(healthy, seconds, alone)
    for which, kind, *one in pool.map(one_robot, product(range(robots), SETS)):
        groups[which, kind].append(one)
    head("sensors", "disturbance", "robots", "cycles", "alarms", "named", words=2)
    for group, found in sorted(groups.items()):
        cycles, alarms, names = zip(*(one for one in found if one[0]), strict=True)
        said = "; ".join(f"{name}: {times}" for name, times in Counter(names).most_common())
        row(*group, len(cycles), sum(cycles), "; ".join(filter(None, alarms)) or 0, said)


def normal(robot: tp.Robot) -> tp.Robot:
    """Return the robot with normal noise of the same σ instead of counts."""
    sigma = dict(zip(robot.readings, robot.reading_sigma.tolist(), strict=True))
    spec = robot.spec
    chains = [
        chain.model_copy(update={"encoder_noise": sigma[f"q{k + 1}"] if k < robot.n else 0.0})
        for k, chain in enumerate(spec.chain)
    ]
    sensors = [
        sensor.model_copy(update={"noise": sigma.get(sensor.name, sensor.noise)})
        for sensor in spec.sensor
    ]
    changes = {"chain": tuple(chains), "sensor": tuple(sensors), "quantized": False}
    values = {name: p.value for name, p in robot.parameters.items()}
    return tp.Robot(spec.model_copy(update=changes), values)


def rates(seconds: float, task: tuple[str, int]) -> list[int]:
    """Count pieces of a path, and those with an alarm at each chance, of one healthy robot."""
    which, seed = task
    robot, truth = map(normal, sampled(which, seed))
    try:
        path = way(robot, int(seconds / 0.7) + 2, seed, 0.7)
        run = tp.simulate(robot, truth, tp.Controller(law="joint"), path=path, run=Run(seed=seed))
    except tp.PoseError:
        return [0] * (1 + len(CHANCES))
    pieces = run.q_e[: len(run.q_e) // PIECE * PIECE].reshape(-1, PIECE, run.q_e.shape[1])
    monitors = [monitoring(false_alarms=chance * 3.6e6) for chance in CHANCES]
    alarms = (
        sum(bool(monitor.review(robot, piece).health.any()) for piece in pieces)
        for monitor in monitors
    )
    return [len(pieces), *alarms]


def print_rates(pool: ProcessPoolExecutor, robots: int, seconds: float) -> None:
    head("sensors", "cycles", *(f"over allowed at {c:g}" for c in CHANCES))
    for which in list(SETS)[:3]:
        tasks = [(which, seed) for seed in range(robots)]
        pieces, *alarms = np.sum(list(pool.map(partial(rates, seconds), tasks)), axis=0)
        # Pieces with an alarm, as alarms after the first are not independent.
        share = -np.log1p(-np.array(alarms) / (pieces + 1e-9)) / (PIECE - SETTLING)
        cells = [f"{r / c:.2g} ({a})" for r, c, a in zip(share, CHANCES, alarms, strict=True)]
        row(which, pieces * (PIECE - SETTLING), *cells)


def payload(robots: int) -> None:
    head("payload (kg)", "named", "error after 0.5 s (%), median, largest",
         "sag, with feed-forward")  # fmt: skip
    for mass in (0.7, 1.0, 2.0, 4.0):
        error, sag = [], []
        for seed in range(robots):
            pair, still = sampled("h4 θ", seed), Run(hold=0.4, seed=seed)
            picked = replace(still, disturbances=[Disturbance("payload", PICKED, mass)])
            usual, *runs = (
                tp.simulate(*pair, run=run, monitor=monitor)
                for run, monitor in (
                    (still, None),
                    (picked, monitoring()),
                    (picked, monitoring(carry=True)),
                )
            )
            sag.append([1e3 * np.linalg.norm((ran.x - usual.x)[-1, :3]) for ran in runs])
            k = np.searchsorted(runs[1].time, PICKED + 0.5)
            if KINDS[runs[1].disturbance[k]] == "payload":
                error.append(abs(100 * (runs[1].disturbance_size[k] / mass - 1)))
        ends = f"{np.median(error):.1f}, {max(error):.1f}"
        row(mass, f"{len(error)} of {robots}", ends, "{:.2f}, {:.2f} mm".format(*np.median(sag, 0)))


def consequences() -> None:
    """Print a row per fault: 30 moves of the nominal H4."""
    robot, rng = tp.load("h4"), np.random.default_rng(0)
    table = workspace_grid(robot)
    others = [table[rng.choice(len(table), 2, replace=False)] for _ in range(29)]
    ways = [(*default_move(robot), 0.1)]  # the paper's
    ways += [(start, end, round(rng.uniform(0, 0.3), 3)) for start, end in others]
    sizes = dict.fromkeys(("bias", "spike", "drift"), np.radians(1))
    sizes |= dict.fromkeys(("stuck", "dropout", "sign")) | {"gain": 1.05, "delay": 0.005}
    sizes |= {"swap": None}
    head("fault", *LAWS, "median", "detected")
    cases = [("theta", "none", None), *((c, *of) for of in sizes.items() for c in ("theta", "q1"))]
    for reading, kind, size in cases:
        cells, monitored = [], []
        for law in LAWS:
            texts = []
            for monitor in (None, monitoring()):
                runs = []
                for start, end, at in ways:
                    other = {"theta": "q1", "q1": "q2"}[reading] if kind == "swap" else None
                    faults = [] if kind == "none" else [Fault(reading, kind, at, size, other=other)]
                    runs.append(
                        tp.simulate(
                            robot, robot, law, faults=faults, monitor=monitor,
                            run=Run(start=start, end=end, duration=0.3, hold=0.3),
                        )
                    )  # fmt: skip
                mm = [1e3 * np.linalg.norm(run.error[:, :3], axis=1).max() for run in runs]
                angle = np.degrees(max(np.abs(run.error[:, 3]).max() for run in runs))
                left = sum(bool(run.ended) for run in runs)
                texts.append(f"{max(mm):.2g}, {angle:.2g}°" + f" ({left})" * (left > 0))
            monitored += zip(mm, runs, strict=True)
            cells.append(" → ".join(texts))
        median = np.median([mm for mm, _ in monitored])
        found = sum(first(run.health) is not None for _, run in monitored)
        row(f"{reading}: {kind}", *cells, f"{median:.2g}", found)


def main() -> None:
    robots = {
        "monitor": 3, "campaign": 5, "frozen": 8, "healthy": 200, "rates": 100,
        "alarms": 8, "payload": 30, "consequences": 1,
    }  # fmt: skip
    args = arguments(__doc__, *robots, robots=0, seconds=10.0, jobs=2)
    count = args.robots or robots[args.what]
    with ProcessPoolExecutor(args.jobs) as pool:
        tasks = list(product(SETS, range(count)))

        def faults(shells: bool, *laws: str) -> Iterable[list[dict]]:
            return chain(*(pool.map(partial(each_fault, law, shells), tasks) for law in laws))

        print_of = {
            "monitor": lambda: print_faults(faults(False, "estimated"), "sensors"),
            "campaign": lambda: print_faults(faults(True, "joint", "estimated"), "mode"),
            "frozen": lambda: print_frozen(pool, count),
            "healthy": lambda: print_healthy(pool, count, args.seconds, alone=False),
            "rates": lambda: print_rates(pool, count, args.seconds),
            "alarms": lambda: print_healthy(pool, count, args.seconds, alone=True),
            "payload": lambda: payload(count),
            "consequences": consequences,
        }
        print_of[args.what]()


if __name__ == "__main__":
    main()
