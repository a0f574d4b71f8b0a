"""Coverage of sleds' stated σ: the table of packages/sleds/docs/sleds.md.

Sleds are sampled from the assumptions of `truepose maslow`, anchors 20 mm about a frame, and read
at 48 poses with σ = 0.5 mm. Printed are NEES over the twelve unknowns with its scatter (1 ±), and
the rms of each anchor's error over σ. Strains are 3 σ at most, so poses can be assigned to sides.
Then --quarters sleds of 88 poses: scatter of anchors over disjoint quarters of the poses, in units
of σ, for comparison with the guide's real log.

sled_trials.py [--sleds 1000] [--quarters 200] [--seed 0]     # some minutes
"""

import argparse

import numpy as np

from truepose_sleds import belts

FRAME = {"tl.x": 0.03, "tl.y": 2.07, "tr.x": 2.98, "tr.y": 2.06, "br.x": 2.965}
READING = 5e-4


def drawn(
    rng: np.random.Generator, columns: int = 8, rows: int = 6
) -> tuple[np.ndarray, dict[str, float]]:
    """Return a sled's readings, and its true unknowns."""
    anchors = {name: v + 0.02 * rng.standard_normal() for name, v in FRAME.items()}
    offsets = rng.uniform(0, 0.16) + belts.OFFSET * rng.standard_normal(4)
    strains = belts.STRAIN * np.clip(rng.standard_normal(3), -3, 3)
    across, up = np.linspace(0.6, 2.4, columns), np.linspace(0.6, 1.4, rows)
    x = np.array([(x, y) for x in across for y in up])
    ends = [[anchors["tl.x"], anchors["tl.y"]], [anchors["tr.x"], anchors["tr.y"]]]
    corners = np.array([*ends, [0, 0], [anchors["br.x"], 0]])
    away = np.linalg.norm(x[:, None] - corners, axis=2)
    robot = belts.robot_of((corners, 0.0), READING, belts.Model())
    acting = belts.influences(robot, x, "sides")
    stretched = sum(s * np.asarray(of.pattern) for s, of in zip(strains, acting, strict=True))
    read = away - offsets + stretched + READING * rng.standard_normal(away.shape)
    truth = anchors | {f"{b}.offset": v for b, v in zip(belts.BELTS, offsets, strict=True)}
    return read, truth | {of.name: s for of, s in zip(acting, strains, strict=True)}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sleds", type=int, default=1000)
    parser.add_argument("--quarters", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    nees, normal, sigma = [], [], []
    for k in range(options.sleds):
        read, truth = drawn(np.random.default_rng((options.seed, k)))
        found = belts.calibrate(read)
        error = np.array([of.value - truth[name] for name, of in found.unknowns.items()])
        nees.append(error @ np.linalg.solve(found.fit.joint_covariance, error) / len(error))
        normal.append([(of.value - truth[n]) / of.sigma for n, of in found.anchors.items()])
        sigma.append([of.sigma for of in found.anchors.values()])
    spread = np.sqrt(2 / (len(error) * options.sleds))
    rms = np.sqrt(np.mean(np.square(normal), axis=0))
    print("| anchor | σ, mean (mm) | rms of the error over σ |\n| --- | ---: | ---: |")
    for name, s, r in zip(FRAME, np.mean(sigma, axis=0), rms, strict=True):
        print(f"| {name} | {1e3 * s:.2f} | {r:.2f} |")
    print(f"\nNEES / unknowns {np.mean(nees):.3f} (1 ± {spread:.3f}), {options.sleds} sleds")
    scatter = [
        belts.spread(drawn(np.random.default_rng((options.seed, k)), 11, 8)[0], belts.Model())
        for k in range(options.quarters)
    ]
    low, middle, high = np.quantile(scatter, [0.05, 0.5, 0.95])
    print(f"quarters, over σ's share: {middle:.2f} ({low:.2f} to {high:.2f}, 5 to 95 %)")


if __name__ == "__main__":
    main()
