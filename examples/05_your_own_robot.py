"""A robot file of your own: a Delta with three arms, three translations, no redundant sensor."""

import tempfile
from pathlib import Path

import numpy as np

import truepose as tp

text = """name = "my-delta"
mobility = "translation"
home = [0.0, 0.0, -0.45]
pattern = { repeat = 3, about = "z" }  # the chain below, three times
chain_defaults = { actuator = "revolute", arm = 0.2, rod = 0.45 }  # m

[[chain]]
base = [0.15, 0.0, 0.0]  # a point of the motor's axis
axis = [0.0, 1.0, 0.0]   # u, of the motor
arm_zero = [1.0, 0.0, 0.0]   # e, the arm's direction at q = 0
anchor = [0.05, 0.0, 0.0]
"""

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "my-delta.toml"
    path.write_text(text, encoding="utf-8")
    robot = tp.load(path)
    print(robot)
    path.write_text(text.replace("rod =", "rd ="), encoding="utf-8")
    try:
        tp.load(path)
    except tp.RobotFileError as error:  # one line: file, key, value, choices
        print("a misspelt key:", str(error).removeprefix(folder)[:75], "…")

x = np.random.default_rng(0).uniform([-0.1, -0.1, -0.5], [0.1, 0.1, -0.4], size=(1000, 3))
print(f"round trip over its workspace: at most {np.abs(robot.fkm(robot.ikm(x)) - x).max():.0e} m")
print("condition of J at home:", np.linalg.cond(robot.jacobian(robot.home)).round(2))
