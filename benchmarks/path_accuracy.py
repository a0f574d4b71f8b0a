"""Tables of docs/results.md, Paths: H4s on a circle and a square.

path_accuracy.py contour [--robots 20] [--jobs 1]    # 2 Hz, exactly known geometry
path_accuracy.py iso [--robots 20] [--jobs 1]        # AT and RT at three speeds

Every robot is sampled from the tolerances, each rod on its own. Minutes on one core.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
from printing import arguments, head, row

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot import LAWS, workspace_grid

CENTRE, RADIUS = (0.0, 0.0, -0.4, 0.0), 0.05  #: m; the square's half side is the circle's radius
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
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


CIRCLE = tp.simulation.Circle(centre=CENTRE, radius=RADIUS, frequency=1.0)
PATHS = {
    "circle": CIRCLE,
    "square": tp.simulation.Waypoints(
        poses=[[RADIUS * x, RADIUS * y, *CENTRE[2:]] for x, y in CORNERS], duration=0.4
    ),
}


def sampled(effects: tp.Effects, seed: int) -> tuple[tp.Robot, tp.Robot, tp.Robot]:
    """Return a true robot, the nominal model, which allows for the effects, and the calibrated one.

    It calibrates itself, cold, under joint control near Table 2's poses, so that rounding differs.
    """
    nominal = tp.load("h4")
    truth = nominal.sample(np.random.SeedSequence([0, seed]))
    allowed, there = effects.allowed_for(nominal), effects.geometry(truth, seed=seed)
    poses = workspace_grid(nominal)
    poses += np.random.default_rng(seed).uniform(-5e-4, 5e-4, poses.shape)
    readings = there.read(tp.steady_state(allowed, there, poses, "joint"))
    return (
        truth,
        allowed,
        tp.calibrate(
            allowed, readings, options=CalibrationOptions(cause="ignore", loss="squares")
        ).robot,
    )


def iso(seed: int) -> dict:
    """Return AT, RT (m), AT θ (rad), contouring and tracking (m) of one robot."""
    effects, found = tp.Effects(), {}
    truth, allowed, calibrated = sampled(effects, seed)
    for law in LAWS:
        controller = tp.Controller.for_robot(tp.load("h4"), effects, law)
        nominal = allowed.expected() if law in ("weighted", "estimated") else allowed
        for known, robot in (("nominal", nominal), ("calibrated", calibrated)):
            for speed, (name, path) in product((1.0, 0.5, 0.1), PATHS.items()):
                run = tp.simulation.path_accuracy(
                    robot, path, truth, controller, speed=speed, effects=effects, seed=seed
                )
                found[name, speed, known, law] = (
                    run.AT, run.RT, run.AT_angle, run.contour, run.tracking, run.saturated,
                )  # fmt: skip
    return found


def print_iso(robots: list[dict]) -> None:
    """Print medians over the robots."""
    head("path, speed, robot, law", "AT (mm)", "RT (mm)", "AT θ (°)", "contouring (mm)",
         "tracking (mm)", "saturated (%)")  # fmt: skip
    for case in sorted(robots[0], key=str):
        median = np.median([one[case] for one in robots], axis=0)
        cells = median * [1e3, 1e3, 180 / np.pi, 1e3, 1e3, 100]
        row(", ".join(map(str, case)), *(f"{cell:.3g}" for cell in cells))


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
                replace(CIRCLE, frequency=2.0, turns=3),
                controller=controller,
                effects=effects,
                time=time,
                runs=RUNS,
                seed=seed,
            )
            found[case, law] = followed.contour, followed.contour_max
    return found


def print_contour(robots: list[dict]) -> None:
    """Print the largest rms and error, the median rms, and the robots beyond the goal."""
    head("case", *(f"{law} (mm)" for law in LAWS))
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
    both = {"contour": (contour, print_contour), "iso": (iso, print_iso)}
    args = arguments(__doc__, *both, robots=20, jobs=1)
    with ProcessPoolExecutor(args.jobs) as pool:
        work, show = both[args.what]
        show(list(pool.map(work, range(args.robots))))


if __name__ == "__main__":
    main()
