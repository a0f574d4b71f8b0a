"""Gain of planned calibration poses over random ones.

    python benchmarks/plan.py [--robots h4 …] [--poses 30] [--sets 100]     # 2 minutes
    python benchmarks/plan.py --logged 15                                   # 1 minute

σ of the position (mm), root mean square over a grid of the workspace, predicted after calibration
on planned poses of 2000 candidates and on random sets from the workspace box: median and 5 to 95 %
of the sets, how many of them the plan beats, the time of the plan, and its certified gap.

--logged N plans on a real log: N of Jugglebot's 108 poses, with the robot file and the σ of
benchmarks/held_out.py; poses follow from the motors and the nominal robot. All parameters are
estimated from these poses only. The rest of the log is predicted and compared with motion capture:
rms, relative to the median with 60 random poses, and how many random sets of N it beats. Once from
all 108, and the median (lowest to highest) of 20 plans among 81 sampled ones. Plans are for the
position in the base's frame, and for the tracker's; over the workspace, and over the log's poses.
"""

import time

import numpy as np
from held_out import SIGMA, learn, predict, rms
from printing import arguments, head, row

import truepose as tp
from truepose import logs, robotfile
from truepose.robot import workspace_samples

COUNT = 2000


def cases(names: list[str]) -> list[tp.Robot]:
    """Return each robot with the sensors in use, or its first, and with all of them."""
    found = []
    for name in names:
        robot = tp.load(name)
        every = [sensor.name for sensor in robot.spec.sensor]
        for sensors in dict.fromkeys([robot.sensors or tuple(every[:1]), tuple(every)]):
            if sensors:
                found.append(robot.with_sensors(*sensors))
    return found


def random_sets(robot: tp.Robot, count: int, sets: int) -> list[np.ndarray]:
    x = workspace_samples(robot, 2 * sets * count, np.random.default_rng(1))
    x = x[np.isfinite(robot.ikm(x, "nan", "ideal", own_mode=True)).all(axis=1)]
    return [x[k * count : (k + 1) * count] for k in range(min(sets, len(x) // count))]


def logged(count: int, sets: int) -> None:
    """Plan on Jugglebot's log, and predict the rest."""
    robot = tp.load("jugglebot")
    log = logs.read(robot, robotfile.shipped()["jugglebot"].parent / "log.csv")
    q, seen = log.readings, log.measured
    x, rng = robot.fkm(q), np.random.default_rng(0)

    def missed(learnt: np.ndarray) -> float:
        rest = np.setdiff1d(np.arange(len(q)), learnt)
        fit = learn(robot, q[learnt], seen[learnt])
        return rms(predict(fit, fit.robot, q[rest], seen[rest]).position)

    def planned(among: np.ndarray, of_tracker: bool, over: np.ndarray | None) -> float:
        candidates = tp.design.CandidatePoses(
            poses=x[among], measured_sigma=SIGMA[0], measured_angle_sigma=SIGMA[3]
        )
        plan = tp.plan_poses(
            robot, count, candidates=candidates, use=tp.design.Use(poses=over), seen=of_tracker
        )
        return missed(among[[step.candidate for step in plan.steps]])

    sixty = np.median([missed(rng.permutation(len(q))[:60]) for _ in range(sets)])
    few = np.array([missed(rng.permutation(len(q))[:count]) for _ in range(sets)])
    middle, tenth = np.quantile(few, [0.5, 0.1]) / sixty
    print(f"60 random poses: {sixty:.2f} mm (median of {sets}); {count} random ones: median "
          f"{middle:.3f} of that, a tenth below {tenth:.3f}")  # fmt: skip
    among = [rng.permutation(len(q))[:81] for _ in range(20)]
    head("minimised", "over", f"{count} of {len(q)}", "beats", f"{count} of 81", "beat")
    for of_tracker in (False, True):
        for name, over in (("the workspace", None), ("the log's poses", x)):
            one = planned(np.arange(len(q)), of_tracker, over)
            many = np.array([planned(own, of_tracker, over) for own in among])
            ratio = np.quantile(many, [0.5, 0, 1]) / sixty
            beats = [f"{100 * (few > of).mean():.0f} %" for of in (one, many[:, None])]
            spread = "{:.3f} ({:.3f} to {:.3f})".format(*ratio)
            what = "measured pose" if of_tracker else "the position"
            row(what, name, f"{one / sixty:.3f}", beats[0], spread, beats[1])


def main() -> None:
    asked = arguments(__doc__, robots=tuple(tp.list_robots()), poses=30, sets=100, logged=0)
    if asked.logged:
        logged(asked.logged, asked.sets)
        return
    head("robot, sensors", "before", "planned", "random", "5 to 95 %", "beats", "s", "gap")
    for robot in cases(asked.robots):
        start = time.perf_counter()
        plan = tp.plan_poses(robot, asked.poses, candidates=COUNT)
        took = time.perf_counter() - start
        sets = random_sets(robot, asked.poses, asked.sets)
        others = np.array([1e3 * tp.accuracy(robot, plan.over, calibrated_on=x).rms for x in sets])
        before, after = 1e3 * plan.sigma[[0, -1], -1]
        low, median, high = np.quantile(others, [0.05, 0.5, 0.95])
        sigmas = (f"{value:.3g}" for value in (before, after, median))
        beats = f"{100 * (others > after).mean():.0f} %"
        row(f"{robot.name}, {len(robot.sensors)}", *sigmas, f"{low:.3g} to {high:.3g}", beats,
            f"{took:.1f}", f"{plan.gap:.1%}")  # fmt: skip


if __name__ == "__main__":
    main()
