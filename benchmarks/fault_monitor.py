"""Tables of docs/fault-monitor.md: false-alarm rate and detection of the fault monitor.

fault_monitor.py alarms [--robots 100] [--seconds 10] [--jobs 2]   # healthy robots, all effects
fault_monitor.py rates [--robots 100] [--seconds 10] [--jobs 2]    # normal noise: false-alarm rate
fault_monitor.py faults [--robots 30] [--rest] [--jobs 2]          # every kind, above its limit

Every robot is sampled from the tolerances, each rod on its own. Calibrated ones calibrated
themselves on readings at 100 poses.
"""

import argparse
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import truepose as tp
from truepose import _core
from truepose.faults.monitor import first
from truepose.robot.units import reading_units

CHANCES = (1e-3, 1e-4, 1e-5, None)  #: false alarms per cycle; None: one in 1000 hours
SETS = {
    "h4 θ": ("h4", ["theta"]),
    "h4 θ, z": ("h4", ["theta", "z_telemeter"]),
    "h4 θ, elbows": ("h4", ["theta", "elbow1", "elbow2", "elbow3", "elbow4"]),
}
#: Other robots with enough redundant sensors for stated detectability.
MORE = {
    "delta z, elbows": ("delta", ["z_telemeter", "elbow1", "elbow2", "elbow3"]),
    "stewart z, U-joints": ("stewart", ["z_telemeter", *(f"u_joint{k}" for k in range(1, 7))]),
}
SOFT = {"frequency": 40.0, "velocity_bandwidth": 300.0}  #: stable with compliant arms and a delay
POSES = 100  #: of a calibration
MOST = 0.1  #: detectability, rad or m, beyond which the others do not monitor a reading
SETTLING = 33  #: start-up cycles of the fault monitor
PIECE = 200  #: cycles of a path per restart of the fault monitor
AT_REST = ("bias", "jump", "spike", "dropout", "drift")  #: kinds that are detectable at rest
TIMES = 1.5  #: size of a fault over its detectability
AT = 0.25  #: s, start of a fault; moves take 0.3 s each


def drawn(which: str, seed: int, calibrated: bool, effects: tp.Effects | None) -> tuple:
    """Return the controller's model and the true robot."""
    name, sensors = (SETS | MORE)[which]
    robot = tp.load(name).with_sensors(*sensors).expected()
    truth = robot.sample(seed)
    if not calibrated:
        return robot, truth
    if effects is not None:
        robot = effects.allowed_for(robot)
    there = truth if effects is None else effects.geometry(truth, 0, seed)
    return tp.calibrate(robot, there.read(poses(robot, POSES, seed), seed=seed)).robot, truth


def poses(robot: tp.Robot, count: int, seed: int) -> np.ndarray:
    """Return random poses of the workspace."""
    box = robot.spec.workspace
    return np.random.default_rng([seed, 1]).uniform(box.minimum, box.maximum, (count, robot.n))


def way(robot: tp.Robot, seconds: float, seed: int, each: float) -> tp.simulation.Waypoints:
    """Return a path from pose to pose for some seconds."""
    return tp.simulation.Waypoints(poses=poses(robot, int(seconds / each) + 2, seed), duration=each)


def alarms(which: str, calibrated: bool, seconds: float, seed: int) -> dict:
    """Count cycles, and those with an alarm at each chance, of one healthy robot."""
    effects = tp.Effects()
    robot, truth = drawn(which, seed, calibrated, effects)
    control = tp.Controller(law="joint", **SOFT)
    try:
        path = way(robot, seconds, seed, 0.7)
        run = tp.simulate(
            robot, truth, control, path=path, effects=effects, run=tp.simulation.Run(seed=seed)
        )
    except tp.PoseError:
        return {}
    found = {}
    for chance in CHANCES:
        allowed = {} if chance is None else {"false_alarms": chance * 3.6e6}
        monitor = tp.FaultMonitor(effects=effects, **allowed)
        review = monitor.review(robot, run.q_e)
        found[chance] = int((review.health > 0).any(axis=1).sum()), first(review.health)
    return {"cycles": len(run.q_e), "found": found}


def rates(which: str, calibrated: bool, seconds: float, seed: int) -> dict:
    """Count pieces of a path, and those with an alarm, of one healthy robot with normal noise."""
    robot, truth = (normal(one) for one in drawn(which, seed, calibrated, None))
    try:
        path = way(robot, seconds, seed, 0.7)
        run = tp.simulate(
            robot, truth, tp.Controller(law="joint"), path=path, run=tp.simulation.Run(seed=seed)
        )
    except tp.PoseError:
        return {}
    pieces = run.q_e[: len(run.q_e) // PIECE * PIECE].reshape(-1, PIECE, run.q_e.shape[1])
    found = {}
    for chance in CHANCES[:-1]:
        monitor = tp.FaultMonitor(false_alarms=chance * 3.6e6)
        found[chance] = sum(bool(monitor.review(robot, piece).health.any()) for piece in pieces)
    return {"pieces": len(pieces), "found": found}


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


def faults_of(robot: tp.Robot, reading: str, limit: float) -> dict[str, list[tp.faults.Fault]]:
    """Return faults of every kind, just above their detectability where there is one."""
    units = dict(zip(robot.readings, reading_units(robot), strict=True))
    alike = [name for name, unit in units.items() if unit == units[reading] and name != reading]
    size = TIMES * limit
    sizes = {"reading": size, "reading/s": size / 0.1, "1": 1.1, "s": 0.02}
    found = {}
    for kind, row in _core.fault_kinds.items():
        if row.pair and not alike:
            continue
        of = max(size, 0.02) if kind == "spike" else sizes.get(row.size)
        other = alike[0] if row.pair else None
        found[kind] = [tp.faults.Fault(reading, kind, AT, of, other=other)]
    return found


def faults(which: str, rest: bool, seed: int) -> list[tuple]:
    """Return the fault monitor's results on every fault of one calibrated robot."""
    robot, truth = drawn(which, seed, True, None)
    if rest:
        path = tp.simulation.Waypoints(
            poses=np.repeat(poses(robot, 1, seed), 2, axis=0), duration=0.6
        )
    else:
        path = way(robot, 0.6, seed, 0.3)
    limits = tp.faults.detectability(
        robot, path.setpoints(robot, 1e-3).x[::20], poses(robot, POSES, seed)
    )
    law, rows = "estimated", []
    try:
        healthy = tp.simulate(robot, truth, law, path=path, run=tp.simulation.Run(seed=seed))
    except tp.PoseError:
        return []
    for c, reading in enumerate(robot.readings):
        limit = float(np.median(limits.detected[:, c]))
        if not limit < MOST:  # a bias of it is undetectable
            continue
        for kind, fault in faults_of(robot, reading, limit).items():
            if rest and kind not in AT_REST:
                continue
            run = tp.simulate(
                robot,
                truth,
                law,
                path=path,
                faults=fault,
                monitor=tp.FaultMonitor(),
                run=tp.simulation.Run(seed=seed),
            )
            lines = slice(None, min(len(run.x), len(healthy.x)))
            moves = ~run.stops[lines]  # a stop leads off the path
            turning = np.array([unit == "rad" for _, unit in robot.coordinates])
            off = np.abs(run.x[lines] - healthy.x[lines])[moves]
            turned = off[:, turning].max() if turning.any() else 0.0
            at = first(run.health)
            named = set(run.failed)
            guilty = {reading, fault[0].other}
            verdict = "named" if named and named <= guilty else "wrong" if named else "unnamed"
            delay = np.nan if at is None else 1e3 * (run.time[at] - AT)
            rows.append((reading, kind, delay, verdict, 1e3 * off[:, ~turning].max(), turned))
    return rows


def print_alarms(pool: ProcessPoolExecutor, robots: int, seconds: float) -> None:
    heads = ["sensors", "robots", "cycles", "per cycle at 1e-3", "1e-4", "1e-5", "at the default"]
    row(*heads)
    row("---", *["---:"] * (len(heads) - 1))
    for which in SETS:
        for calibrated in (False, True):
            work = partial(alarms, which, calibrated, seconds)
            robots_found = [one for one in pool.map(work, range(robots)) if one]
            cycles = sum(one["cycles"] for one in robots_found)
            rates = []
            for chance in CHANCES:
                bad = sum(one["found"][chance][0] for one in robots_found)
                rates.append(f"{bad / cycles:.1e}" if chance else f"{bad}")
            what = f"{which}, {'calibrated' if calibrated else 'as built'}"
            row(what, len(robots_found), cycles, *rates)


def print_rates(pool: ProcessPoolExecutor, robots: int, seconds: float) -> None:
    heads = ["sensors", "robots", "cycles", *(f"over allowed at {c:g}" for c in CHANCES[:-1])]
    row(*heads)
    row("---", *["---:"] * (len(heads) - 1))
    for which in SETS:
        for calibrated in (False, True):
            work = partial(rates, which, calibrated, seconds)
            found = [one for one in pool.map(work, range(robots)) if one]
            pieces = sum(one["pieces"] for one in found)
            cells = []
            for chance in CHANCES[:-1]:
                # Count pieces with an alarm, as alarms after the first are not independent.
                share = sum(one["found"][chance] for one in found) / pieces
                rate = -np.log1p(-min(share, 1 - 1e-9)) / (PIECE - SETTLING)
                cells.append(f"{rate / chance:.2g} ({round(share * pieces)})")
            what = f"{which}, {'calibrated' if calibrated else 'as built'}"
            row(what, len(found), pieces * (PIECE - SETTLING), *cells)


def print_faults(pool: ProcessPoolExecutor, robots: int, rest: bool) -> None:
    heads = [
        "sensors",
        "fault",
        "detected",
        "median, 99 % (ms)",
        "isolated, not isolated, wrong",
        "error (mm, °)",
    ]
    row(*heads)
    row("---", "---", *["---:"] * (len(heads) - 2))
    for which in SETS | MORE:
        table = defaultdict(list)
        for rows in pool.map(partial(faults, which, rest), range(robots)):
            for _, kind, *case in rows:
                table[kind].append(case)
        for kind, cases in table.items():
            delays = np.array([case[0] for case in cases])
            found = np.isfinite(delays)
            names = Counter(case[1] for case in cases)
            late = np.quantile(delays[found], [0.5, 0.99]) if found.any() else [np.nan] * 2
            row(
                which,
                kind,
                f"{found.sum()} of {len(cases)}",
                f"{late[0]:.0f}, {late[1]:.0f}",
                ", ".join(str(names[verdict]) for verdict in ("named", "unnamed", "wrong")),
                f"{max(case[2] for case in cases):.1f}, "
                f"{np.degrees(max(case[3] for case in cases)):.1f}",
            )


def row(*cells: object) -> None:
    print("|", " | ".join(map(str, cells)), "|", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("alarms", "rates", "faults"))
    parser.add_argument("--rest", action="store_true", help="the robot stands still")
    parser.add_argument("--robots", type=int)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    with ProcessPoolExecutor(args.jobs) as pool:
        if args.what == "alarms":
            print_alarms(pool, args.robots or 100, args.seconds)
        elif args.what == "rates":
            print_rates(pool, args.robots or 100, args.seconds)
        else:
            print_faults(pool, args.robots or 30, args.rest)


if __name__ == "__main__":
    main()
