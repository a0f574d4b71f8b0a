"""Logs of simulated runs, read again for calibration."""

import builtins
import json

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import logs
from truepose.simulation.plants.exact import ExactPlant

FORMATS = ["csv", "parquet", "mcap"]


@pytest.fixture(scope="module")
def move(h4):
    return tp.simulate(h4, run=tp.simulation.Run(duration=0.1, hold=0.02))


@pytest.mark.parametrize("ending", FORMATS)
def test_a_move_comes_back_bit_for_bit(h4, move, tmp_path, ending):
    path = tmp_path / f"move.{ending}"
    logs.write(move, path)
    log = logs.read(h4, path)
    assert (log.readings == move.q_e).all()
    assert log.measured is None
    assert {"time", "torque1", "true_x"} <= set(log.unused)


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize("ending", FORMATS)
def test_truepose_calibrate_reads_what_was_written(run, h4, truth, table2, tmp_path, ending):
    path = tmp_path / f"visit.{ending}"
    beside = np.random.default_rng(0).uniform(-5e-4, 5e-4, table2.shape)
    visit = ExactPlant(truth, tp.Effects().only("quantization")).visit(
        h4, (table2 + beside)[::3], tp.Controller(law="joint")
    )
    logs.write(visit, path, h4)
    code, out, err = run("calibrate", "h4", path, "-o", tmp_path / "calibrated.toml")
    assert code == 0, err
    assert "Wrote" in out and (tmp_path / "calibrated.toml").exists()


def test_every_column_says_its_unit_and_what_it_is(h4, move, truth):
    visit = ExactPlant(truth).visit(h4, np.array([h4.home]), tp.Controller())
    for listed in (logs.columns(move), logs.columns(visit, h4)):
        names = [column.name for column in listed]
        assert len(set(names)) == len(names)
        assert set(h4.readings) <= set(names)
        assert all(c.what and c.unit in ("s", "m", "rad", "N·m", "1") for c in listed)
        assert len({len(c.values) for c in listed}) == 1


def test_parquet_holds_units_and_descriptions(move, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    logs.write(move, tmp_path / "a.parquet")
    field = parquet.read_schema(tmp_path / "a.parquet").field("torque1")
    assert field.metadata[b"unit"] == "N·m".encode() and field.metadata[b"description"]


def test_mcap_channels_have_json_schemas_with_units(move, tmp_path):
    reader = pytest.importorskip("mcap.reader")
    logs.write(move, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = list(reader.make_reader(file).iter_messages(topics=["/torque"]))
    assert len(messages) == len(move.time)
    schema, channel, message = messages[3]
    assert channel.message_encoding == "json" and schema.encoding == "jsonschema"
    assert json.loads(schema.data)["properties"]["torque2"]["description"].endswith("N·m")
    assert message.log_time == round(1e9 * move.time[3])
    assert json.loads(message.data)["torque2"] == move.torque[3, 1]


@pytest.mark.parametrize(("ending", "package"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_a_missing_package_is_one_line_that_says_how_to_get_it(
    move, h4, tmp_path, monkeypatch, ending, package
):
    path = tmp_path / f"a.{ending}"
    logs.write(move, path)
    there = builtins.__import__

    def without(name, *args, **kwargs):
        if name.split(".")[0] == package:
            raise ImportError(name)
        return there(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    for work in (lambda: logs.write(move, path, force=True), lambda: logs.read(h4, path)):
        with refused(f"pip install {package}"):
            work()


def test_an_unknown_ending_is_said(move, tmp_path):
    with refused(r"unknown ending '.mcaq'; did you mean '.mcap'"):
        logs.write(move, tmp_path / "a.mcaq")


@pytest.mark.parametrize("cut", [6, 100, 3000])
def test_a_spoilt_mcap_file_is_said_in_one_line(move, h4, tmp_path, cut):
    path = tmp_path / "a.mcap"
    logs.write(move, path)
    path.write_bytes(path.read_bytes()[:cut])
    with refused(r"cannot be read as MCAP: "):
        logs.read(h4, path)


def test_a_column_in_two_channels_is_refused(h4, tmp_path):
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "a.mcap").open("wb") as file:
        out = writer.Writer(file)
        out.start()
        for topic in ("/a", "/b"):
            channel = out.register_channel(topic, "json", 0)
            out.add_message(channel, 0, b'{"q1": 0.5}', 0)
        out.finish()
    with refused("column 'q1' is in two channels, /a and /b"):
        logs.read(h4, tmp_path / "a.mcap")


def test_a_visit_needs_its_robot(h4, truth):
    visit = ExactPlant(truth).visit(h4, np.array([h4.home]), tp.Controller())
    with refused("needs its robot"):
        logs.columns(visit)
