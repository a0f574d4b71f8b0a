"""The 625 poses of the paper's Table 2 under joint and TEJ control: errors at steady state."""

import numpy as np

import truepose as tp
from truepose.robot.workspace import workspace_grid

nominal = tp.load("h4")
true = nominal.sample(seed=0)  # every part within its tolerances
poses = workspace_grid(nominal)

squares = {}
print(f"{len(poses)} poses: rms of x, y, z (mm) and θ (degrees)")
for law in ("joint", "tej"):
    error = (tp.steady_state(nominal, true, poses, law) - poses) * [1e3, 1e3, 1e3, 180 / np.pi]
    squares[law] = (error**2).sum(axis=0)
    print(f"{law:6}", *(f"{rms:8.3f}" for rms in np.sqrt(squares[law] / len(poses))))

ratio = squares["tej"][3] / squares["joint"][3]
print(f"the TEJ leaves {ratio:.4f} of θ's sum of squares with a perfect sensor")
print("the paper's Table 3: truepose reproduce, of packages/paper")
