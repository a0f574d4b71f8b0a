"""Residual motion of every shipped robot with all effects, under its chosen gains.

    python benchmarks/margins.py [--robots h4 …] [--rates 1 2 …] [--seeds 3]    # ten minutes

Prints gains and margins at the first rate, then the residual motion at each rate: µm, °, % of the
torque limit; bold if not at rest. Each seed is a robot sampled from its file's tolerances, and
phases of the effects. It makes its default move and holds the end for 2 s. At rest means: in the
last 0.2 s no coordinate moves by more than 50 µm or 0.05° peak to peak, and no motor's torque by
more than 2 % of its limit, rms about its mean.
"""

import numpy as np
from printing import arguments, head, row

import truepose as tp
from truepose.control.gains import REST, REST_TORQUE
from truepose.control.loci import worst
from truepose.robot import angles

LAWS = ("joint", "tej", "weighted", "estimated")
RATES = (1.0, 2.0, 5.0, 10.0, 20.0, 0.5)  # kHz
HOLD, LAST = 2.0, 0.2  # s


def chosen(robot: tp.Robot, law: str, period: float) -> tp.Controller | None:
    """Return the chosen controller, or None if none has the margins."""
    try:
        return tp.Controller.for_robot(robot, law=law, period=period)
    except tp.InputError as refused:
        print(refused)
        return None


def bears(robot: tp.Robot, controller: tp.Controller) -> list[str]:
    """Return gains and margins: of all motors together, then the least of any single one."""
    found = tp.control.stability_margins(robot, controller)
    together, *each = found.loops
    cells = [f"{controller.frequency:.0f}, {controller.velocity_bandwidth:.0f}"]
    for loops in ([together], each):
        least = worst([found.worst(loop) for loop in loops])
        gain = 20 * np.log10(min(least.more, least.less))
        cells.append(f"{gain:.1f} dB, {np.degrees(least.phase):.0f}°, {least.delay:.1f}")
    turning = angles(robot)
    swing = [found.limit_cycle[:, part].max(initial=0.0) for part in (~turning, turning)]
    return [*cells, f"{1e6 * swing[0]:.1f} µm, {np.degrees(swing[1]):.3f}°"]


def rests(robot: tp.Robot, controller: tp.Controller, seeds: int) -> str:
    """Simulate sampled robots and return their motion at the end of the hold."""
    limits = np.array([chain.torque_limit or np.inf for chain in robot.spec.chain])
    turning, found = angles(robot), []
    for seed in range(seeds):
        truth = robot.sample(seed)
        run = tp.simulate(
            robot,
            truth,
            controller,
            effects=tp.Effects(),
            run=tp.simulation.Run(hold=HOLD, seed=seed),
        )
        last = run.time >= run.time[-1] - LAST
        swing = np.ptp(run.x[last], axis=0)
        shake = (run.torque[last].std(axis=0) / limits).max()
        parts = [swing[part].max(initial=0.0) for part in (~turning, turning)]
        found.append([*parts, shake])
    far, turn, shake = np.max(found, axis=0)
    text = f"{1e6 * far:.1f}, {np.degrees(turn):.3f}, {100 * shake:.2f}"
    return text if (np.array([far, turn, shake]) <= [*REST, REST_TORQUE]).all() else f"**{text}**"


def main() -> None:
    asked = arguments(__doc__, robots=tuple(tp.list_robots()), laws=LAWS, rates=RATES, seeds=3)
    loops, held = [], []
    for name in asked.robots:
        robot = tp.load(name)
        # Without redundant sensors only the joint law applies.
        for law in asked.laws if robot.r else asked.laws[:1]:
            cells = []
            for rate in asked.rates:
                controller = chosen(robot, law, 1e-3 / rate)
                cells.append(rests(robot, controller, asked.seeds) if controller else "refused")
                if controller and rate == asked.rates[0]:
                    loops.append((name, law, *bears(robot, controller)))
            held.append((name, law, *cells))
            row(*held[-1])
    kept = f"all motors, {asked.rates[0]:g} kHz: gain, phase, cycles", "one motor or reading"
    rates = [f"{rate:g} kHz" for rate in asked.rates]
    for names, rows in ((["poles, filter (rad/s)", *kept, "limit cycle"], loops), (rates, held)):
        print()
        head("robot", "law", *names, words=2)
        for cells in rows:
            row(*cells)


if __name__ == "__main__":
    main()
