"""Kinds of sensors, laws and faults in robot files and in the core, and the order of ξ."""

from typing import get_args

import pytest

import truepose as tp
from truepose import _core
from truepose.faults.fault import FAULT_KINDS, FaultKind
from truepose.robot import LAWS, Law, unit_of
from truepose.robotfile.sensors import SENSORS, Encoder
from truepose.robotfile.to_core import columns, drawn


def test_a_robot_file_knows_the_kinds_of_sensors_that_the_core_knows():
    assert sorted(SENSORS) == sorted(_core.sensor_kinds)


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_a_kind_is_described_by_what_its_reading_depends_on(kind):
    model, core = SENSORS[kind], _core.sensor_kinds[kind]
    assert sorted(model.mounting) == sorted(core.mounting)
    assert set(model.mounting.values()) <= set(model.model_fields)
    assert issubclass(model, Encoder) == core.shaft
    assert ("chain" in model.model_fields) == core.of_chain


def test_every_law_of_the_core_can_be_asked_for():
    assert get_args(Law) == LAWS == tuple(_core.laws)


def test_every_kind_of_fault_of_the_core_can_be_asked_for():
    assert get_args(FaultKind) == FAULT_KINDS == tuple(_core.fault_kinds)


@pytest.mark.parametrize("name", tp.list_robots())
def test_a_parameter_stands_in_the_column_of_its_name(name):
    robot = tp.load(name)
    most = min(_core.max_sensors, _core.max_readings - robot.n)
    robot = robot.with_sensors(*[sensor.name for sensor in robot.spec.sensor][:most])
    column, values = dict(columns(robot.spec)), drawn(robot.spec)
    xi = robot.core_drawn.drawn_parameters()
    assert max(column.values()) < len(xi)
    spare = {sensor.name for sensor in robot.spec.sensor} - {*robot.sensors}
    named = [key for key in values if key.split(".")[0] not in spare]
    assert set(named) <= set(column)
    for key in named:
        if not key.endswith((".yaw", ".tilt")):  # the core's drawn axes have neither
            assert xi[column[key]] == pytest.approx(values[key], abs=1e-15), key


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("chain1.base.x", "m"),
        ("chain1.yaw", "rad"),
        ("chain1.encoder_offset", "rad"),
        ("chain1.eccentricity.s2", "rad"),
        ("bar1.pivot", "m"),
        ("theta.offset", "rad"),
        ("theta.eccentricity.c1", "rad"),
        ("theta.gain", ""),
        ("wire1.offset", "m"),
        ("wire1.origin.x", "m"),
        ("z_telemeter.direction.x", ""),
    ],
)
def test_a_parameter_has_a_unit(h4, name, unit):
    assert unit_of(h4, name) == unit
