"""Are a study's numbers the same whoever works on it, and is nothing lost on the way?"""

import os
import time
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.exceptions import InputError
from truepose.studies import workers
from truepose.studies.cases import Case

COUNT = 6


def off(case: Case) -> dict[str, float]:
    """θ's error at home with the motors right; something random of the case's own."""
    x = case.true.fkm(case.robot.ikm(case.robot.home), guess=case.robot.home)
    return {"off": x[-1] - case.robot.home[-1], "drawn": case.rng.normal()}


def dies_once(case: Case) -> dict[str, float]:
    """Take the first worker that comes with it."""
    mark = Path(os.environ["TRUEPOSE_TEST_MARK"])
    if case.number == 2 and not mark.exists():
        mark.touch()
        os._exit(9)
    return off(case)


def slow(case: Case) -> dict[str, float]:
    """Long enough to be killed in the middle."""
    time.sleep(0.3)
    return off(case)


def same(one: tp.Study, other: tp.Study) -> bool:
    """Whether two studies have the same numbers, to the last bit."""
    return list(one.columns) == list(other.columns) and all(
        np.array_equal(one.columns[name], other.columns[name]) for name in one.columns
    )


@pytest.fixture(scope="module")
def alone() -> tp.Study:
    return tp.study(off, ["3rrr", "h4"], COUNT, seed=3, workers=0)


@pytest.mark.parametrize("how", [{"on": "threads"}, {"on": "processes"}, {"chunk": 5}])
def test_numbers_do_not_depend_on_who_works(alone, how):
    options = {"seed": 3, "workers": 2, "chunk": 2, **how}
    assert same(alone, tp.study(off, ["3rrr", "h4"], COUNT, **options))


def test_each_true_robot_is_another_and_answers_in_its_place(alone):
    assert list(alone.columns["robot"][:4]) == ["3rrr", "h4", "3rrr", "h4"]
    assert list(alone.columns["number"]) == [k // 2 for k in range(2 * COUNT)]
    assert len(set(alone.columns["off"])) == len(set(alone.columns["drawn"])) == 2 * COUNT


def test_a_grid_asks_the_same_true_robots_at_every_point():
    def cube(case):
        return {"power": case.values["n"], "first": case.true.parameters["chain1.rod"].value}

    found = tp.study(cube, "3rrr", 3, grid={"n": [1, 2], "law": ["a", "b"]}, workers=0)
    assert len(found) == 12
    for number in range(3):
        assert len(set(found.columns["first"][found.columns["number"] == number])) == 1
    points = [row[1:3] for row in found.table().rows if row[3] == "power"]
    assert points == [[n, law] for n in "12" for law in "ab"]


def test_a_study_that_was_ended_goes_on_and_may_grow(alone, tmp_path):
    asked = []

    def counted(case):
        asked.append(case.number)
        return off(case)

    options = {"seed": 3, "workers": 0, "chunk": 4, "out": tmp_path / "kept"}
    tp.study(counted, ["3rrr", "h4"], 3, **options)
    (tmp_path / "kept" / "chunk-000000000.parquet").unlink()
    asked.clear()
    assert same(alone, tp.study(counted, ["3rrr", "h4"], COUNT, **options))
    assert asked == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]  # 4 to 5 were half a chunk: not kept
    asked.clear()
    assert same(alone, tp.study(counted, ["3rrr", "h4"], COUNT, **options))
    assert not asked


def test_a_folder_of_another_study_is_left_alone(tmp_path):
    tp.study(off, "3rrr", 2, workers=0, out=tmp_path / "kept")
    for other in ({"seed": 1}, {"grid": {"n": [1]}}, {"chunk": 7}):
        with pytest.raises(InputError, match=r"holds another study: (seed|grid|chunk) "):
            tp.study(off, "3rrr", 2, workers=0, out=tmp_path / "kept", **other)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").touch()
    with pytest.raises(InputError, match="must be empty, or hold this study"):
        tp.study(off, "3rrr", 2, workers=0, out=tmp_path / "mine")


def test_a_process_that_dies_loses_nothing(alone, tmp_path, monkeypatch):
    monkeypatch.setenv("TRUEPOSE_TEST_MARK", str(tmp_path / "mark"))
    found = tp.study(dies_once, ["3rrr", "h4"], COUNT, seed=3, workers=2, chunk=2)
    assert (tmp_path / "mark").exists() and same(alone, found)


def test_what_a_robot_refuses_is_told_and_what_fails_is_named():
    def far(case):
        return {"q": case.true.ikm(case.robot.home + 10)[0]}

    found = tp.study(far, "3rrr", 2, workers=0)
    assert found.failed.all() and "unreachable" in found.columns["error"][0]
    assert found.table().rows == [["3rrr", "–", "0", "", "", ""]]
    for wrong, said in (
        (lambda case: {"ratio": 1 / 0}, r"case 0 \(robot 3rrr, number 0\): ZeroDivisionError"),
        (lambda case: 3, "answer 3: must be a mapping"),
        (lambda case: {"x": [1]}, r"x = \[1\]: must be a number"),
        (lambda case: {"number": 1}, "'number' is the name of another column"),
    ):
        with pytest.raises(InputError, match=said):
            tp.study(wrong, "3rrr", 1, workers=0)


def test_on_a_cluster_a_worker_that_is_killed_loses_nothing(alone, tmp_path):
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path)
    ) as cluster:
        killed = []

        def kill(done, total):
            if done == 2 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], 9)

        options = {"seed": 3, "chunk": 1, "cluster": cluster, "progress": kill}
        found = tp.study(slow, ["3rrr", "h4"], COUNT, **options)
        assert killed and same(alone, found)


def test_a_cluster_of_other_versions_is_refused(monkeypatch):
    class Client:
        def __init__(self, found):
            self.found = found

        def run(self, _):
            return self.found

    old = workers.versions() | {"numpy": "1.0"}
    with pytest.raises(InputError, match=r"worker tcp://a has numpy 1\.0, here is"):
        workers._require_same(Client({"tcp://a": old}))
    with pytest.raises(InputError, match="no workers"):
        workers._require_same(Client({}))


def test_no_cluster_where_there_is_none_is_one_line(run, monkeypatch):
    pytest.importorskip("distributed", reason="dask is not installed")
    monkeypatch.setattr(workers, "PATIENCE", 0.5)
    status, _, errors = run("study", "rest", "3rrr", "--count", 2, "--cluster", "tcp://127.0.0.1:9")
    assert status == 2 and "--cluster tcp://127.0.0.1:9: no scheduler answers there" in errors


def test_the_command_asks_ready_questions_and_those_of_a_file(run, tmp_path):
    status, out, errors = run("study", "calibration", "h4", "--count", 2, "--workers", 0)
    assert status == 0 and "calibrated_mm" in out and "bound_deg" in out, errors
    script = tmp_path / "mine.py"
    script.write_text(
        "def rods(case):\n    return {'rod': case.true.parameters['chain1.rod'].value}\n"
    )
    words = ("study", f"{script}:rods", "3rrr", "--count", 4, "--workers", 2, "--chunk", 2)
    status, out, errors = run(*words, "-o", tmp_path / "kept", "--grid", "n=1,2")
    assert status == 0 and "3rrr   2  rod" in out and "Kept in" in out, errors
    for wrong, said in (
        ("nothing", "question 'nothing'"),
        (f"{script}:rod", "did you mean 'rods'"),
        (f"{tmp_path / 'no.py'}:rods", "cannot be read"),
    ):
        status, _, errors = run("study", wrong, "3rrr")
        assert status == 2 and said in errors and len(errors.splitlines()) == 1, errors
