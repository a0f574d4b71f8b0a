"""Are estimates of printers as good as they say? Prints the table of docs/guides/delta-printer.md.

Printers drawn from what `truepose klipper` assumes of them, probed at Klipper's seven points and,
with distances, measured on Klipper's printed object. 1 ± are for NEES over its unknowns.

printers.py [--printers 1000] [--seed 0] [--built 1]     # some minutes; --built 0.5: twice as well
"""

import argparse

import numpy as np

from truepose.printers.estimate import Assumed
from truepose.printers.trials import trials

KINDS = {
    ("delta", True): "linear delta, 7 heights and 12 distances",
    ("delta", False): "linear delta, 7 heights",
    ("rotary_delta", True): "rotary delta, 7 heights and 12 distances",
    ("rotary_delta", False): "rotary delta, 7 heights",
}


def row(kinematics: str, distances: bool, count: int, seed: int, assumed: Assumed) -> str:
    ran = list(trials(kinematics, count, seed, distances, assumed))
    unknowns = ran[0].unknowns
    nees = np.mean([trial.nees for trial in ran]) / unknowns
    error = np.mean([trial.error for trial in ran], axis=0)
    bound = np.mean([trial.bound for trial in ran], axis=0)
    cells = [
        KINDS[kinematics, distances],
        f"{nees:.2f} (1 ± {np.sqrt(2 / (count * unknowns)):.2f})",
        " ".join(f"{v:.2f}" for v in np.sqrt(error / bound)),
        " ".join(f"{1e3 * v:.3f}" for v in np.sqrt(error)),
    ]
    return " | ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--printers", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--built", type=float, default=1.0, help="share of building tolerances")
    options = parser.parse_args()
    usual, parts = Assumed(), ("arm", "angle", "radius", "endstop")
    assumed = Assumed(**{name: options.built * getattr(usual, name) for name in parts})
    print("| printers | NEES / unknowns | rms over the bound, x y z | rms, x y z (mm) |")
    print("| --- | ---: | ---: | ---: |")
    for kinematics, distances in KINDS:
        cells = row(kinematics, distances, options.printers, options.seed, assumed)
        print(f"| {cells} |", flush=True)


if __name__ == "__main__":
    main()
