"""Robots as JSON, for the page without installation."""

import base64
import json

import numpy as np
import pytest

import truepose as tp
from truepose.robot.knowledge import root
from truepose_printers.robot_json import to_json


@pytest.fixture(params=["nominal", "calibrated"])
def robot(request) -> tp.Robot:
    """Return an H4 as in its file, or after a calibration."""
    h4 = tp.load("h4").with_sensors("theta", "z_telemeter")
    if request.param == "nominal":
        return h4
    box = h4.spec.workspace
    x = np.random.default_rng(1).uniform(box.minimum, box.maximum, (30, h4.n))
    return tp.calibrate(h4, h4.replace({"chain3.rod": 0.483}).read(x, seed=1)).robot


def test_a_page_gets_prior_means_values_and_covariance_at_the_highest_level(robot):
    of = json.loads(to_json(robot))
    names = [each["name"] for each in of["parameters"]]
    for each in of["parameters"]:
        assert each["mean"] == robot.parameters[each["name"]].mean
        assert each["value"] == robot.parameters[each["name"]].value
    expected = root(robot, names)
    assert of["root"] == [row[: k + 1] for k, row in enumerate(expected.tolist())]
    assert of["sigma"] == robot.reading_sigma.tolist()
    image = bytes(robot.at_highest_level.core_drawn)
    assert base64.b64decode(of["description"]) == image
    assert [each["name"] for each in of["readings"]] == list(robot.readings)
