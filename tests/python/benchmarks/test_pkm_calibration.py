"""The benchmark pkm-calibration: files, scorer, baselines, and its generator against truepose."""

import copy
import shutil

import numpy as np
import pytest
from fixtures import refused
from pkm import baselines, files, generate, ideal, mechanism, score, with_truepose
from pkm.poses import difference

import truepose as tp

KINDS = sorted(path.stem for path in (files.HERE / "robots").glob("*.json"))


@pytest.fixture(params=KINDS)
def robot(request):
    return files.robot_of(files.HERE / "robots", request.param)


@pytest.fixture
def copied(tmp_path):
    """Return a copy of the published benchmark."""
    for name in ("robots", "logs"):
        shutil.copytree(files.HERE / name, tmp_path / name)
    for name in ("truth.json", "manifest.json"):
        shutil.copy(files.HERE / name, tmp_path / name)
    return tmp_path


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Return a generated benchmark of two logs with two machines each."""
    out = tmp_path_factory.mktemp("small")
    generate.generate(out, seed=3, machines=2, only=["five-bar-1", "delta-2"])
    return out


@pytest.fixture(scope="module")
def submitted(small, tmp_path_factory):
    """Return the folder of the baselines' submissions to it."""
    out = tmp_path_factory.mktemp("submitted")
    baselines.submit(small, out)
    return out


def test_published_logs_and_truth_belong_together():
    manifest, truth = score.check(files.HERE)
    assert len(manifest["logs"]) == len(truth) == 12
    assert {entry["robot"] for entry in manifest["logs"].values()} == set(KINDS)


def test_held_out_poses_have_readings_but_no_pose():
    for path in (files.HERE / "logs").glob("*.csv"):
        columns = files.read_csv(path)
        held = columns["use"] == files.HELD_OUT
        for name, values in columns.items():
            if name.startswith("measured_"):
                assert np.isnan(values[held]).all() and np.isfinite(values[~held]).all()
            elif name != "use":
                assert np.isfinite(values).all()


def test_truth_of_other_logs_is_refused_in_one_line(copied, capsys):
    truth = files.load(copied / "truth.json")
    truth["delta-1"]["sha256"] = truth["delta-2"]["sha256"]
    files.save(copied / "truth.json", truth)
    assert score.main([str(copied), "--benchmark", str(copied)]) == 1
    said = capsys.readouterr().err
    assert "delta-1: the truth of another log" in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("file", "old", "said"),
    [
        ("logs/h4-2.csv", "0.", r"h4-2\.csv: not the log of the manifest"),
        ("truth.json", "0.0", "not the truth of the manifest"),
    ],
)
def test_a_changed_file_is_refused(copied, file, old, said):
    text = (copied / file).read_text()
    (copied / file).write_text(text.replace(old, "0.1", 1))
    with pytest.raises(files.BenchmarkError, match=said):
        score.check(copied)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.pop("y_sigma"), "columns missing: y_sigma"),
        (lambda t: t.update(z=t["x"]), "unknown columns: z"),
        (lambda t: t["x"].__setitem__(3, np.nan), "not finite"),
        (lambda t: t["x_sigma"].__setitem__(3, -1.0), "not positive"),
        (lambda t: t["cov_x_y"].__setitem__(3, 1.0), "not positive definite"),
        (lambda t: t["pose"].__setitem__(3, 99), "1 held-out poses missing, first machine 0"),
    ],
)
def test_a_wrong_submission_is_refused_in_one_line(small, submitted, tmp_path, change, said):
    shutil.copytree(submitted / "nominal", tmp_path / "nominal")
    path = tmp_path / "nominal" / "five-bar-1.csv"
    columns = files.read_csv(path)
    change(columns)
    files.write_csv(path, columns, ".10g")
    with refused(said, files.BenchmarkError):
        score.score(tmp_path / "nominal", small)


def test_scores_of_a_case_computed_by_hand():
    off = np.array([[3e-3, 4e-3], [0.0, 0.0], [1e-3, 0.0], [0.0, 0.0]])
    P = np.tile(np.diag([1e-6, 4e-6]), (4, 1, 1))
    one = score.score_log(off, P, 2.0)
    assert one.position == pytest.approx(np.sqrt((25 + 1) / 4))
    assert np.isnan(one.angle) and one.cpu == 2.0
    assert one.coverage == 6 / 8  # 3 σ and 2 σ are outside 1.96 σ
    assert one.ratio == pytest.approx(np.sqrt((9 + 4 + 1) / 8))


def test_angles_are_scored_in_degrees_and_by_rotation():
    x = np.array([[0.0, 0.0, 0.0, 0.5, 0.0, 0.0]])
    y = np.array([[0.0, 0.0, 0.0, 0.4, 0.0, 0.0]])
    names = ["x", "y", "z", "rx", "ry", "rz"]
    off = difference(names, x, y)
    np.testing.assert_allclose(off, x - y, atol=1e-15)
    one = score.score_log(off, np.eye(6)[None], 0.0)
    assert one.angle == pytest.approx(np.degrees(0.1))
    x = np.array([[0.0, 0.0, 0.0, 3.1]])
    turns = difference(["x", "y", "z", "theta"], x, -x)
    assert turns[0, 3] == pytest.approx(6.2 - 2 * np.pi)


def test_jacobian_of_the_ideal_model_is_that_of_finite_differences(robot):
    model = ideal.Ideal(robot)
    p = np.random.default_rng(0).normal(size=len(model.used)) / 2
    q = np.array(robot["home"]["motors"])[None] + 0.01
    x = model.fkm(q, p, np.array(robot["home"]["pose"])[None])
    found, columns = model.jacobian(x, q, p), []
    for step in 1e-3 * np.eye(len(p)):
        ahead, behind = model.fkm(q, p + step, x), model.fkm(q, p - step, x)
        columns.append(difference(model.names, ahead, behind) / 2e-3)
    for step in 1e-5 * np.eye(model.n):
        ahead, behind = model.fkm(q + step, p, x), model.fkm(q - step, p, x)
        columns.append(difference(model.names, ahead, behind) / 2e-5)
    np.testing.assert_allclose(found, np.stack(columns, axis=-1), atol=1e-7)


def test_three_independent_models_agree_on_the_nominal_robot(robot):
    rng = np.random.default_rng(1)
    machine = mechanism.Machine(generate.disturb(robot, rng, 0.0))
    x = rng.uniform(robot["workspace"]["low"], robot["workspace"]["high"])
    q = machine.motors_for(x)
    loaded, model = with_truepose.load(robot), ideal.Ideal(robot)
    np.testing.assert_allclose(loaded.ikm(x), q, atol=1e-8)
    np.testing.assert_allclose(loaded.rkm(x), machine.sensors(), atol=1e-12)
    home = np.array(robot["home"]["pose"])[None]
    np.testing.assert_allclose(model.fkm(q[None], np.zeros(len(model.used)), home)[0], x, atol=1e-8)
    np.testing.assert_allclose(model.sensors(x[None])[0], machine.sensors(), atol=1e-12)


def test_mujoco_and_truepose_agree_on_machines_with_errors(robot):
    exact = copy.deepcopy(robot)
    exact["tolerances"] |= {"rod_end": [0.0] * 3, "axis": 0.0}  # no such parameters, other signs
    real = generate.disturb(exact, np.random.default_rng(2))
    machine, nominal = (
        mechanism.Machine(real),
        mechanism.Machine(generate.disturb(robot, np.random.default_rng(0), 0.0)),
    )
    values = {}
    for i, (chain, drawn) in enumerate(zip(real["chains"], robot["chains"], strict=True), 1):
        for key in ("base", "anchor"):
            values |= {f"chain{i}.{key}.{c}": v for c, v in zip("xyz", chain[key], strict=True)}
        if chain["motor"] == "hinge":
            values[f"chain{i}.arm"] = chain["arm"]
        if chain["motor"] != "leg":
            values[f"chain{i}.rod"] = np.mean(chain["lengths"])
        if "spacing" in drawn:
            values[f"chain{i}.rod_difference"] = chain["lengths"][0] - chain["lengths"][1]
    for k, bar in enumerate(real["bars"], 1):
        values[f"bar{k}.pivot"] = np.linalg.norm(bar["hinge"])
    loaded = with_truepose.load(robot)
    values = {name: float(v) for name, v in values.items() if name in loaded.parameters}
    q = nominal.motors_for(np.array(robot["home"]["pose"]) + 0.01)
    machine.move_to(q, nominal.data.qpos)
    x = loaded.replace(values).fkm(q, guess=machine.pose, level=loaded.highest_level)
    np.testing.assert_allclose(x, machine.pose, atol=1e-9)


def test_a_published_log_is_generated_again():
    log = "five-bar-2"
    seed = files.load(files.HERE / "manifest.json")["seed"]
    kind, _, cause = generate.LOGS[log]
    robot = files.robot_of(files.HERE / "robots", kind)
    x, q_e, _, gross = generate.one_machine(robot, cause, (seed, list(generate.LOGS).index(log), 0))
    columns = files.read_csv(files.HERE / "logs" / f"{log}.csv")
    own = columns["machine"] == 0
    written = files.matrix(columns, files.columns_of(robot), log)[own]
    assert np.sum(np.abs(written - q_e) > 1e-6) <= 1  # a reading may round to the next count
    truth = files.load(files.HERE / "truth.json")[log]
    held = columns["use"][own] == files.HELD_OUT
    np.testing.assert_allclose(truth["poses"][: held.sum()], x[held], atol=1e-6)
    assert [where for machine, *where in truth["gross"] if machine == 0] == gross


def test_baselines_are_scored_and_calibration_helps(small, submitted, capsys):
    names = ["nominal", "least-squares", "truepose-ideal", "truepose-full"]
    found = {name: score.score(submitted / name, small) for name in names}
    five_bar = {name: scores["five-bar-1"].position for name, scores in found.items()}
    assert five_bar["least-squares"] < 0.2 * five_bar["nominal"]
    assert five_bar["truepose-full"] < 0.2 * five_bar["nominal"]
    folders = [str(submitted / name) for name in found]
    assert score.main([*folders, "--benchmark", str(small)]) == 0
    said = capsys.readouterr().out
    assert "five-bar-1 (none)" in said and "all logs" in said


def test_a_refused_machine_stays_nominal_and_is_counted(small, monkeypatch, tmp_path, capsys):
    def refuse(*_, **__):
        raise tp.InputError("readings: q1: slipped before row 19")

    monkeypatch.setattr(tp, "calibrate", refuse)
    assert baselines.main(["--benchmark", str(small), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "truepose-full: delta-2: 2 machines refused, 0: readings: q1: slipped" in said
    found = {name: score.score(tmp_path / name, small) for name in ("nominal", "truepose-full")}
    assert (
        found["truepose-full"]["delta-2"].refused == 2
        and found["truepose-full"]["all"].refused == 4
    )
    nominal, refused = (one["delta-2"].position for one in found.values())
    assert nominal == refused


def test_baselines_of_a_wrong_benchmark_are_refused_in_one_line(copied, capsys):
    (copied / "logs" / "delta-1.csv").unlink()
    assert baselines.main(["--benchmark", str(copied)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_baselines_run_without_truepose(monkeypatch, robot):
    monkeypatch.setattr(baselines, "find_spec", lambda _: None)
    assert list(baselines.methods(robot)) == ["nominal", "least-squares"]


def test_the_robot_file_of_a_description_is_complete(robot):
    loaded = with_truepose.load(robot)
    assert isinstance(loaded, tp.Robot) and loaded.r == len(robot["sensors"])
    pairs = "spacing" in robot["chains"][0]
    assert (loaded.full.reason == "" if pairs else True) or loaded.highest_level == "full"
