"""Table docs/results/effects.csv: loss of self-calibration's gain by effect; needs packages/paper.

effects_table.py [--robots 16] [--seed 0]      # a minute per robot on one core

H4s with the paper's errors run on the dynamic plant, two hours after a cold start: with no effect,
all, one alone, all but one. Each calibrates itself with motors and θ under joint control, and is
then controlled on its estimate.
"""

import argparse
from functools import partial
from itertools import product

import numpy as np

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.control.effects import Effects
from truepose.exceptions import PoseError
from truepose.simulation.plants.dynamic import DynamicPlant
from truepose.threads import each
from truepose_paper.article import offset, table2
from truepose_paper.experiment import draw_robots, over_robots, position_rms

#: A PD whose loop is stable with all effects on.
SOFT = partial(tp.Controller, frequency=40.0, velocity_bandwidth=300.0, gains="diagonal")
WARM = 7200.0  #: s
LEARN, JUDGE = 3, 7  #: strides through Table 2 of calibration poses and of evaluation poses
ALL = Effects()
CASES = {"none": Effects.none(), "all": ALL}
CASES |= {f"{group} alone": ALL.only(group) for group in Effects.groups()}
CASES |= {f"all but {group}": ALL.without(group) for group in Effects.groups()}


def errors(
    robot: tp.Robot, number: int, truth: tp.Robot, effects: Effects
) -> tuple[float, float, int]:
    """Return the position rms of one robot, usual and calibrated, mm, and its poses left out."""
    learn, judge = offset(table2()[::LEARN], number), table2()[1::JUDGE]
    plant = DynamicPlant(truth, effects, WARM, number)
    taught, usual = (plant.visit(robot, poses, SOFT(law="joint")) for poses in (learn, judge))
    readings = taught.q_e[taught.status == "ok"]
    try:
        ignore = CalibrationOptions(cause="ignore", loss="squares")
        believed = tp.calibrate(effects.allowed_for(robot), readings, options=ignore).robot
        x = plant.visit(believed, judge, SOFT(law="estimated")).x
    except PoseError:  # no calibration: every pose is left out
        x = np.full_like(usual.x, np.nan)
    left_out = int(np.isnan([usual.x, x]).any(axis=2).sum())
    return position_rms(usual.x - judge), position_rms(x - judge), left_out


def interval(*calibrated: np.ndarray) -> str:
    """Return the rms over the robots, or its difference to another case's, and a 90 % interval.

    The interval is a bootstrap over the robots.
    """

    def of(which: np.ndarray) -> np.ndarray:
        rms = [over_robots(each[which]) for each in calibrated]
        return rms[0] - (rms[1] if rms[1:] else 0)

    count = len(calibrated[0])
    drawn = np.random.default_rng(0).integers(count, size=(2000, count))
    low, high = np.nanpercentile(of(drawn), [5, 95])
    return f"{of(np.arange(count)):.2f} [{low:.2f}, {high:.2f}]"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    robot = tp.load("h4")
    truths = list(enumerate(draw_robots(robot, chosen.robots, chosen.seed)))
    tasks = [(*truth, effects) for effects, truth in product(CASES.values(), truths)]
    found = np.array(list(each(lambda task: errors(robot, *task), tasks))).reshape(
        len(CASES), -1, 3
    )
    by = dict(zip(CASES, found, strict=True))
    print("| effects | calibrated (mm) | gain | left out | effect adds (mm) |")
    print("|---|---:|---:|---:|---:|")
    for case, (usual, calibrated, left_out) in ((case, of.T) for case, of in by.items()):
        group = case.removesuffix(" alone").removeprefix("all but ")
        pair = ("all", case) if case.startswith("all but") else (case, "none")
        adds = interval(*(by[name][:, 1] for name in pair)) if group in Effects.groups() else ""
        gain = over_robots(usual) / over_robots(calibrated)
        print(f"| {case} | {interval(calibrated)} | {gain:.1f} | {left_out.sum():.0f} | {adds} |")


if __name__ == "__main__":
    main()
