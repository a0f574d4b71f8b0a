"""Tables of docs/path-accuracy.md: H4s on a circle and a square.

path_accuracy.py contour [--robots 20] [--jobs 1]    # 2 Hz, exactly known geometry
path_accuracy.py iso [--robots 20]                   # AT and RT at three speeds, as with --full

Every robot is sampled from the tolerances, each rod on its own. Minutes on one core.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import truepose as tp
from truepose.robot.laws import LAWS
from truepose.show.table import markdown
from truepose_paper import following, tables

RUNS = 3  #: of each robot at 2 Hz
MOTORS = tp.Effects().without("eccentricity", "thermal")  #: effects that motors observe
WARM = 7200.0  #: s
RMS, MOST = 0.3, 0.5  #: mm, goals of contouring with effects that motors observe
#: Effects, whether the gains are stable under them, and time since start-up, s.
CASES = {
    "ideal: no effects, no counts, nominal gains": (None, False, 0.0),
    "all effects but eccentricity and warm-up": (MOTORS, True, 0.0),
    "eccentric encoders alone": (tp.Effects().only("eccentricity"), True, 0.0),
    "warm-up alone, warm": (tp.Effects().only("thermal"), True, WARM),
    "all effects, warm": (tp.Effects(), True, WARM),
}


def circle(frequency: float, turns: float) -> tp.simulation.Circle:
    return tp.simulation.Circle(
        centre=following.CENTRE, radius=following.RADIUS, frequency=frequency, turns=turns
    )


def contour(seed: int) -> dict:
    """Return rms and largest error, m, by case and law, of one robot of known geometry."""
    truth = tp.load("h4").sample(seed)
    found = {}
    for law in LAWS:
        bears = tp.Controller.for_robot(truth, tp.Effects(), law)
        for case, (effects, soft, time) in CASES.items():
            robot = truth.without_quantization() if effects is None else truth
            controller = bears if soft else tp.Controller(law=law)
            followed = tp.simulation.path_accuracy(
                robot,
                circle(2, 3),
                controller=controller,
                effects=effects,
                time=time,
                runs=RUNS,
                seed=seed,
            )
            found[case, law] = followed.contour, followed.contour_max
    return found


def row(*cells: object) -> None:
    print("|", " | ".join(map(str, cells)), "|", flush=True)


def print_contour(robots: list[dict]) -> None:
    """Print the largest rms and error, the median rms, and the robots beyond the goal."""
    row("case", *(f"{law} (mm)" for law in LAWS))
    row("---", *["---:"] * len(LAWS))
    for case in CASES:
        cells = []
        for law in LAWS:
            rms, most = 1e3 * np.array([one[case, law] for one in robots]).T
            cells.append(f"{rms.max():.2g}, {most.max():.2g} ({np.median(rms):.2g})")
        row(case, *cells)
    case = "all effects but eccentricity and warm-up"
    goal = f"of {len(robots)} robots beyond {RMS:g} mm rms or {MOST:g} mm"
    beyond = [
        sum(1e3 * one[case, law][0] > RMS or 1e3 * one[case, law][1] > MOST for one in robots)
        for law in LAWS
    ]
    row(f"{case}: {goal}", *beyond)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("contour", "iso"))
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if args.what == "iso":
        for table in tables.following(following.study(tp.load("h4"), args.robots, seed=0)):
            print(f"{table.title}\n\n{markdown(table)}\n", flush=True)
        return
    with ProcessPoolExecutor(args.jobs) as pool:
        print_contour(list(pool.map(contour, range(args.robots))))


if __name__ == "__main__":
    main()
