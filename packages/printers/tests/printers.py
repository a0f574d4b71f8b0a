"""Coverage of printers' stated σ: the table of packages/printers/docs/delta-printer.md.

Printers are sampled from the assumptions of `truepose klipper`, with noise between 0.01 and 0.1 mm,
probed at Klipper's seven points or more, and with distances measured on Klipper's printed object.
Each is tested fault-free and with one height off by 0.3 mm.

printers.py [--printers 400] [--seed 0] [--built 1] [--noise 0.01 0.1]     # some minutes
"""

import argparse

import numpy as np
from printer_trials import ASSUMED, trials

from truepose_printers.assessment import MM

KINDS = {
    ("delta", False, 0): "linear, 7 heights",
    ("delta", True, 0): "linear, 7 heights, 12 distances",
    ("delta", False, 18): "linear, 25 heights",
    ("delta", True, 18): "linear, 25 heights, 12 distances",
    ("rotary_delta", True, 18): "rotary, 25 heights, 12 distances",
}
HEADER = (
    "printers",
    "in 95 %: unknowns, x y, z (%)",
    "rms, x y z (mm)",
    "rms over the bound",
    "false warnings (%)",
    "can judge (%)",
    "0.3 mm off: detected, of the detectable ones",
    "failed",
)


def row(
    kind: tuple[str, bool, int], count: int, seed: int, assumed: dict[str, float], noise
) -> str:
    kinematics, distances, more = kind
    ran = list(trials(kinematics, count, seed, distances, assumed, noise, more))
    done = [trial for trial in ran if trial is not None]
    inside, error, bound = (
        np.mean([getattr(trial, name) for trial in done], axis=0)
        for name in ("inside", "error", "bound")
    )
    can = [trial.found for trial in done if trial.shows]
    cells = [
        KINDS[kind],
        " ".join(f"{100 * v:.1f}" for v in inside),
        " ".join(f"{v / MM:.3f}" for v in np.sqrt(error)),
        " ".join(f"{v:.2f}" for v in np.sqrt(error / bound)),
        f"{100 * np.mean([trial.rejected for trial in done]):.1f}",
        f"{100 * np.mean([trial.judges for trial in done]):.0f}",
        f"{sum(can)} of {len(can)}",
        f"{len(ran) - len(done)} of {len(ran)}",
    ]
    return " | ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--printers", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--built", type=float, default=1.0, help="share of building tolerances")
    parser.add_argument("--noise", type=float, nargs=2, default=(0.01, 0.1), help="between, mm")
    options = parser.parse_args()
    parts = ("arm", "angle", "radius", "endstop")
    assumed = ASSUMED | {name: options.built * ASSUMED[name] for name in parts}
    noise = tuple(MM * value for value in options.noise)
    print(f"| {' | '.join(HEADER)} |")
    print("| --- |" + " ---: |" * (len(HEADER) - 1))
    for kind in KINDS:
        print(f"| {row(kind, options.printers, options.seed, assumed, noise)} |", flush=True)


if __name__ == "__main__":
    main()
