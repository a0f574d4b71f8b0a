"""A robot is a file. Here a Delta: three arms, three translations, no redundant sensor."""

import tempfile
from pathlib import Path

import numpy as np

import truepose as tp

HEAD = """name = "my-delta"
mobility = "translation"
home = [0.0, 0.0, -0.45]
every_chain = { actuator = "revolute", arm = 0.2, rod = 0.45 }  # m
"""
text = HEAD
for degrees in (0, 120, 240):  # base point, motor axis u, arm's direction e at q = 0, anchor
    c, s = np.cos(np.radians(degrees)).round(9), np.sin(np.radians(degrees)).round(9)
    text += f"""[[chain]]
base = [{0.15 * c}, {0.15 * s}, 0.0]
axis = [{-s}, {c}, 0.0]
zero = [{c}, {s}, 0.0]
anchor = [{0.05 * c}, {0.05 * s}, 0.0]
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
