"""Saved robots load back with their comments, and are never half written."""

import os

import pytest
from fixtures import drawn_poses

import truepose as tp
from truepose import files, robotfile


def saved(robot, path) -> tp.Robot:
    robot.save(path, force=True)
    return tp.load(path)


def same(a: tp.Robot, b: tp.Robot) -> bool:
    x = a.home
    return (
        a.parameters == b.parameters
        and a.sensors == b.sensors
        and (a.resolution == b.resolution).all()
        and (a.extended_positions(x) == b.extended_positions(x)).all()
        and a.spec.gravity == b.spec.gravity
    )


def test_a_robot_with_every_parameter_changed_loads_back_bit_for_bit(any_robot, rng, tmp_path):
    changed = {
        name: parameter.value + 1e-4 * rng.random()
        for name, parameter in any_robot.parameters.items()
    }
    robot = any_robot.replace(changed)
    assert same(saved(robot, tmp_path / "mine.toml"), robot)


def test_an_unchanged_robot_saves_the_file_it_came_from(any_robot, tmp_path):
    any_robot.save(tmp_path / "mine.toml")
    source = robotfile.shipped()[any_robot.name].read_text(encoding="utf-8")
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == source


def test_a_robot_that_came_from_no_file_is_written_out(any_robot, tmp_path):
    spec = any_robot.spec.model_copy()
    spec._text = ""
    name = next(name for name, of in any_robot.parameters.items() if of.value == 0)
    robot = tp.Robot(spec).replace({name: 0.01})
    assert same(saved(robot, tmp_path / "mine.toml"), robot)


def test_comments_and_order_stay(h4, h4_text, tmp_path):
    h4.replace({"chain2.rod": 0.4812345678901235}).save(tmp_path / "mine.toml")
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert text.startswith(h4_text)
    assert text[len(h4_text) :].split() == [
        "[parameters]",
        '"chain2.rod"',
        "=",
        "0.4812345678901235",
    ]


def test_a_second_save_replaces_the_value_where_it_stands(h4, tmp_path):
    path = tmp_path / "mine.toml"
    once = saved(h4.replace({"chain2.rod": 0.481}), path)
    text = path.read_text(encoding="utf-8").replace("0.481\n", "0.481 # measured\n")
    path.write_text(text, encoding="utf-8")
    saved(tp.load(path).replace({"chain2.rod": 0.4815}), path)
    assert path.read_text(encoding="utf-8") == text.replace("0.481 #", "0.4815 #")
    assert same(once.replace({"chain2.rod": 0.4815}), tp.load(path))


def test_a_parameter_put_back_to_the_drawn_value_stays_there(h4, tmp_path):
    path = tmp_path / "mine.toml"
    once = saved(h4.replace({"chain2.rod": 0.481}), path)
    assert same(saved(once.replace({"chain2.rod": 0.48}), path), h4)


def test_a_sensors_range_is_saved_and_outlives_a_calibration(h4, h4_text, rng, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(h4_text.replace("gear = 4.0", "gear = 4.0\nrange = [-0.6, 0.6]"))
    robot = tp.load(path)
    written_out = robot.spec.model_copy()
    written_out._text = ""
    poses = drawn_poses(h4, 30, rng)
    for one in (robot, tp.Robot(written_out), tp.calibrate(robot, robot.read(poses, seed=1)).robot):
        assert saved(one, path).spec.used[0].range == (-0.6, 0.6)


def test_sensors_gravity_and_counts_are_saved(h4, tmp_path):
    robot = h4.with_sensors("z_telemeter", "theta").with_gravity((0, 0, 0)).without_quantization()
    assert not robot.resolution.any()
    assert same(saved(robot, tmp_path / "mine.toml"), robot)


def test_a_file_based_on_a_shipped_robot_is_short_and_saves_as_such(h4, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'based_on = "h4"\nname = "ours" # the one by the door\n'
        '[chain_defaults]\narm = 0.25\n[parameters]\n"chain1.rod" = 0.483\n',
        encoding="utf-8",
    )
    ours = tp.load(path)
    assert ours.name == "ours" and ours.n == 4
    assert ours.parameters["chain3.arm"].value == 0.25
    assert ours.parameters["chain1.rod"] == h4.parameters["chain1.rod"]._replace(value=0.483)
    again = saved(ours.replace({"chain1.rod": 0.484}).with_sensors(), tmp_path / "again.toml")
    assert again.parameters["chain1.rod"].value == 0.484 and again.r == 0
    assert "the one by the door" in (tmp_path / "again.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("fails", ["fsync", "replace"])
def test_an_interrupted_save_leaves_the_old_file(h4, h4_text, tmp_path, monkeypatch, fails):
    path = tmp_path / "mine.toml"
    path.write_text(h4_text, encoding="utf-8")

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, fails, interrupt)
    with pytest.raises(KeyboardInterrupt):
        h4.replace({"chain1.rod": 0.5}).save(path, force=True)
    assert path.read_text(encoding="utf-8") == h4_text
    assert os.listdir(tmp_path) == ["mine.toml"]
