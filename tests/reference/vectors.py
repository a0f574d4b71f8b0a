"""Reference vectors for every build of the core, seeded.

Run as ``python tests/reference/vectors.py HEADER``: what the installed truepose answers in Python,
which agree.c compares with what a build of the C interface answers.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import truepose as tp
from truepose.arguments import Array
from truepose.deploy.c_tables import identifier, to_c

#: One robot of each mobility (with two axes for all rotational ones), and of each actuator.
ROBOTS = ("five-bar", "3rrr", "linear-delta", "h4", "stewart", "g1-ankle")
POSES, SEED = 6, 20261122


def robot_of(name: str) -> tp.Robot:
    """Return a robot as on small machines: ideal level, the file's sensors.

    The ankle's file lists its sensors without using any; its roll encoder is used here.
    """
    robot = tp.load(name).with_level("ideal")
    return robot.with_sensors("roll_encoder") if name == "g1-ankle" else robot


def vectors_of(robot: tp.Robot, source: np.random.Generator) -> dict[str, Array]:
    """Return results of a robot at random poses, one array per quantity.

    The readings `q_e` are slightly inconsistent, as on a real robot.
    """
    box = robot.spec.workspace
    assert box is not None
    x = source.uniform(box.minimum, box.maximum, (POSES, robot.n))
    q_e = robot.extended_positions(x) + 1e-3 * source.uniform(-1, 1, (POSES, robot.n + robot.r))
    _, tej = robot.tej(x)
    answers = {
        "x": x,
        "q_e": q_e,
        "ikm": robot.ikm(x),
        "fkm": robot.fkm(robot.ikm(x), guess=robot.home),
        "readings": robot.extended_positions(x),
        "jacobian": robot.jacobian(x).reshape(POSES, -1),
        "tej": tej.reshape(POSES, -1),
        "error": np.einsum("kij,kj->ki", tej, robot.extended_positions(x) - q_e),
        "estimate": robot.estimate(q_e).x if robot.r else x,
    }
    return {name: np.asarray(values) for name, values in answers.items()}


def header() -> str:
    """Return the file's text."""
    source = np.random.default_rng(SEED)
    tables, sets, rows = [], [], []
    for name in ROBOTS:
        robot = robot_of(name)
        word = identifier(name)
        tables.append(to_c(robot, tp.Controller(law="joint"), tp.FaultMonitor()))
        answers = vectors_of(robot, source)
        for question, values in answers.items():
            numbers = ",\n  ".join(", ".join(map(repr, row)) for row in values.tolist())
            sets.append(f"static const truepose_real {word}_{question}[] = {{\n  {numbers}}};\n")
        known = f"&{word}_knowledge" if robot.r else "0"
        rows.append(f"  {{&{word}, {known}, {', '.join(f'{word}_{key}' for key in answers)}}}")
    return (
        "/* Written by tests/reference/vectors.py: what Python's truepose answers. */\n"
        "#ifndef TRUEPOSE_VECTORS_H\n#define TRUEPOSE_VECTORS_H\n\n"
        + "\n".join(tables)
        + "\n"
        + "\n".join(sets)
        + f"\nenum {{ VECTOR_POSES = {POSES} }};\n\n"
        "typedef struct vectors {\n"
        "  const truepose_description* robot;\n  const truepose_knowledge* known;\n"
        f"  const truepose_real {', '.join(f'*{key}' for key in answers)};\n}} vectors;\n\n"
        "static const vectors vectors_of[] = {\n" + ",\n".join(rows) + "};\n\n#endif\n"
    )


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(header(), encoding="utf-8")
