"""Damping on a singularity, and the paper's law elsewhere."""

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import robotfile

BAND = 0.05
WIRE = """
[[sensor]]
name = "wire"
kind = "distance"
origin = [0.1, 0.6, 0.0]
"""


@pytest.fixture(scope="module")
def sinking(tmp_path_factory):
    """Return a five-bar with a draw-wire, and a path of poses that ends with its rods in line."""
    text = robotfile.shipped()["five-bar"].read_text(encoding="utf-8")
    path = tmp_path_factory.mktemp("five-bar") / "robot.toml"
    path.write_text(text + WIRE, encoding="utf-8")
    robot = tp.load(path).with_sensors("wire")
    path = robot.home - [0, 1] * np.linspace(0, 0.2, 4001)[:, None]
    parallel = robot.conditioning(path).parallel
    last = np.argmin(parallel)
    assert parallel[last] < 1e-3
    return robot, path[: last + 1], parallel[: last + 1]


def test_outside_the_band_the_tej_is_the_papers_to_the_last_bit(chained_robot, anywhere, rng):
    x = anywhere(chained_robot, 200, rng)
    for exact, damped in zip(
        chained_robot.tej(x), chained_robot.tej(x, damped_below=BAND), strict=True
    ):
        assert (exact == damped).all()
    assert chained_robot.conditioning(x).parallel.min() > BAND


def test_a_simulated_robot_says_where_its_controller_was_damped(sinking):
    robot, path, parallel = sinking
    controller = tp.Controller(law="joint", damped_below=0.3)
    end = path[np.argmax(parallel < 0.25)]
    run = tp.simulate(
        robot.without_quantization(),
        controller=controller,
        run=tp.simulation.Run(start=path[0], end=end),
    )
    near = robot.conditioning(run.x_d).parallel < 0.3
    assert (run.near_singular == near).all()
    assert near.any() and not near.all()


@pytest.mark.parametrize("wrong", [-0.1, 1.5, float("nan"), "wide"])
def test_a_band_is_a_number_from_0_to_1(h4, wrong):
    with refused(r"damped_below = .*: must be a number from 0 to 1"):
        h4.tej(h4.home, damped_below=wrong)
    with refused("damped_below"):
        tp.Controller(damped_below=wrong)


@pytest.mark.parametrize("turn", [-np.pi / 2, np.pi / 2])
def test_a_hexapod_turned_by_90_degrees_is_singular(turn):
    stewart, turned = tp.load("stewart"), np.array([0, 0, 0, 0, 0, turn])
    with pytest.raises(tp.PoseError, match=r"motor position q = .*: singular"):
        stewart.fkm(stewart.ikm(stewart.home + turned))
