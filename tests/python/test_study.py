"""Monte Carlo studies: the same numbers on any number of processes, resumable."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.exceptions import InputError
from truepose.integrations.dask import cluster as dask_cluster
from truepose.studies import storage, workers
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


def same(one: tp.studies.Study, other: tp.studies.Study) -> bool:
    """Whether two studies have the same numbers, to the last bit."""
    return list(one.columns) == list(other.columns) and all(
        np.array_equal(one.columns[name], other.columns[name]) for name in one.columns
    )


@pytest.fixture(scope="module")
def alone() -> tp.studies.Study:
    return tp.monte_carlo(off, ["3rrr", "h4"], COUNT, seed=3, workers=0)


@pytest.mark.parametrize("how", [{}, {"chunk": 5}])
def test_numbers_do_not_depend_on_who_works(alone, how):
    options = {"seed": 3, "workers": 2, "chunk": 2, **how}
    assert same(alone, tp.monte_carlo(off, ["3rrr", "h4"], COUNT, **options))


def test_each_true_robot_is_another_and_answers_in_its_place(alone):
    assert list(alone.columns["robot"][:4]) == ["3rrr", "h4", "3rrr", "h4"]
    assert list(alone.columns["number"]) == [k // 2 for k in range(2 * COUNT)]
    assert len(set(alone.columns["off"])) == len(set(alone.columns["drawn"])) == 2 * COUNT


def test_a_case_has_one_true_robot_and_one_stream_of_random_numbers():
    """Whatever else was spawned from its seed before; each access goes on from the one before."""

    def asked(case):
        first = case.seed.spawn(1)[0] if case.values["spawned"] else None
        noise = case.rng.normal(size=2)
        assert case.true is case.true and first != case.true
        return {"rod": case.true.parameters["chain1.rod"].value, "noise": noise @ [1, 0]} | {
            "next": case.rng.normal() - noise[0]
        }

    found = tp.monte_carlo(asked, "3rrr", 3, grid={"spawned": [0, 1]}, workers=0)
    assert [row[1] for row in found.table().rows if row[2] == "rod"] == ["0", "1"]
    rods, noise = found.columns["rod"].reshape(3, 2), found.columns["noise"]
    assert (rods[:, 0] == rods[:, 1]).all() and len(set(rods[:, 0])) == 3
    assert len(set(noise)) == 3 and found.columns["next"].all()


def test_a_calibration_on_more_poses_is_a_better_one():
    found = tp.monte_carlo("calibration", "h4", 6, grid={"poses": [5, 160]}, workers=0)
    few, many = found.columns["bound_mm"].reshape(6, 2).T
    assert (many < 0.9 * few).all()
    off = found.columns["calibrated_mm"].reshape(6, 2)
    assert (off[:, 0] != off[:, 1]).all()
    alone = tp.monte_carlo("calibration", "h4", 6, grid={"poses": [40]}, workers=0)
    default = tp.monte_carlo("calibration", "h4", 6, workers=0)
    assert (alone.columns["calibrated_mm"] == default.columns["calibrated_mm"]).all()


@pytest.mark.parametrize(
    ("function", "grid", "message"),
    [
        ("calibration", {"banana": [1]}, r"grid: unknown key 'banana' \(choices: poses\)"),
        ("calibration", {"Poses": [1]}, r"unknown key 'Poses'; did you mean 'poses'"),
        ("calibration", {"poses": [10, "many"]}, "poses = .many.: must be a whole number of at"),
        ("calibration", {"poses": [0]}, "poses = 0: must be a whole number of at least 1"),
        ("rest", {"poses": [1]}, "study rest: grid: unknown key 'poses' .choices: law"),
        (
            lambda case: {"x": case.values["n"]},
            {"n": [1], "m": [2]},
            "unknown key 'm': the function reads n of case.values; leave the key out",
        ),
        (off, {"banana": [1]}, "unknown key 'banana': the function reads none of case.values"),
    ],
)
def test_a_grid_that_is_not_used_is_refused(function, grid, message):
    with refused(message, InputError):
        tp.monte_carlo(function, "3rrr", 2, grid=grid, workers=0)


def test_cases_without_an_answer_are_counted_and_spoil_no_median(run, tmp_path):
    """Two of a hundred are NaN in one number, a third refused."""
    script = tmp_path / "mine.py"
    script.write_text(
        "import truepose\n\ndef some(case):\n    if case.number == 2:\n"
        "        raise truepose.TrueposeError('no such pose')\n"
        "    return {'a': float('nan') if case.number < 2 else 1.0, 'b': 2}\n"
    )
    status, out, errors = run(
        "monte-carlo", f"{script}:some", "3rrr", "--workers", 0, "--format", "csv"
    )
    assert status == 0, errors
    assert out.splitlines() == [
        "table,robot,asked,robots,no answer,rms,median,95 %",
        "study,3rrr,a,100.0,3.0,1.0,1.0,1.0",
        "study,3rrr,b,100.0,1.0,2.0,2.0,2.0",
    ]
    assert "3 of 100 cases had no answer; the first: no such pose" in errors
    status, out, errors = run("monte-carlo", f"{script}:some", "3rrr", "--count", 2, "--workers", 0)
    assert "Results over 2 robots (2 without an answer)" in out
    assert "2 of 2 cases had no answer; the first: a result is not finite (NaN)" in errors


def test_a_study_that_was_ended_goes_on_with_other_tasks_and_may_grow(alone, tmp_path):
    asked = []

    def counted(case):
        asked.append(case.number)
        return off(case)

    def end(done, total):
        if done >= 4:
            raise KeyboardInterrupt

    options = {"seed": 3, "workers": 0, "out": tmp_path / "kept"}
    with pytest.raises(KeyboardInterrupt):
        tp.monte_carlo(counted, ["3rrr", "h4"], 3, chunk=4, progress=end, **options)
    asked.clear()
    assert same(alone, tp.monte_carlo(counted, ["3rrr", "h4"], COUNT, chunk=3, **options))
    assert asked == [2, 2, 3, 3, 4, 4, 5, 5]
    asked.clear()
    fewer = tp.monte_carlo(counted, ["3rrr", "h4"], 2, **options)
    assert np.array_equal(fewer.columns["off"], alone.columns["off"][:4])
    assert same(alone, tp.monte_carlo(counted, ["3rrr", "h4"], COUNT, **options))
    assert not asked


def test_a_study_writes_its_file_while_it_runs(alone, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(storage, "EVERY", 0.0)
    monkeypatch.setattr(storage, "SHARE", 0.0)
    file, seen = tmp_path / "kept" / "cases.parquet", []
    options = {"seed": 3, "workers": 0, "chunk": 2, "out": tmp_path / "kept"}

    def look(*_):
        seen.append(len(parquet.read_table(file)) if file.exists() else 0)

    tp.monte_carlo(off, ["3rrr", "h4"], COUNT, progress=look, **options)
    assert seen == [*range(0, 2 * COUNT + 1, 2)]
    table = parquet.read_table(file).to_pydict()
    assert table["case"] == [*range(2 * COUNT)]
    assert np.array_equal(table["off"], alone.columns["off"])
    monkeypatch.setattr(storage, "EVERY", 60.0)
    tp.monte_carlo(off, ["3rrr", "h4"], COUNT + 2, progress=look, **options)
    assert seen[-1] == 2 * COUNT  # a fast study does not write for each task
    assert len(parquet.read_table(file)) == 2 * COUNT + 4


@pytest.mark.parametrize("seconds", [1e-4, 0.04, 3.0])
def test_tasks_take_about_a_second_and_are_small_at_the_end(seconds):
    tasks, count, sizes = workers.Tasks([(100, 900), (0, 50)], None), 850, []
    asked = set()
    while tasks.left:
        start, stop = tasks.take(2)
        sizes.append(stop - start)
        asked |= {*range(start, stop)}
        tasks.took(stop - start, seconds * (stop - start))
    assert asked == {*range(50), *range(100, 900)} and sum(sizes) == count
    assert max(sizes) * seconds <= max(workers.TASK, seconds) and sizes[-1] == 1
    assert max(sizes) >= min(0.9 * workers.TASK / seconds, 100, 850)
    fixed = workers.Tasks([(0, 10)], 4)
    assert [fixed.take(2) for _ in range(3)] == [(0, 4), (4, 8), (8, 10)]


def test_a_folder_of_another_study_is_left_alone(tmp_path):
    tp.monte_carlo(off, "3rrr", 2, workers=0, out=tmp_path / "kept")
    for other in ({"seed": 1}, {"grid": {"n": [1]}}):
        with refused(r"holds another study: (seed|grid) "):
            tp.monte_carlo(off, "3rrr", 2, workers=0, out=tmp_path / "kept", **other)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").touch()
    with refused("must be empty, or hold this study"):
        tp.monte_carlo(off, "3rrr", 2, workers=0, out=tmp_path / "mine")


def test_a_process_that_dies_loses_nothing(alone, tmp_path, monkeypatch):
    monkeypatch.setenv("TRUEPOSE_TEST_MARK", str(tmp_path / "mark"))
    found = tp.monte_carlo(dies_once, ["3rrr", "h4"], COUNT, seed=3, workers=2, chunk=2)
    assert (tmp_path / "mark").exists() and same(alone, found)


def test_what_a_robot_refuses_is_told_and_what_fails_is_named():
    def far(case):
        return {"q": case.true.ikm(case.robot.home + 10)[0]}

    found = tp.monte_carlo(far, "3rrr", 2, workers=0)
    assert found.failed.all() and "unreachable" in found.columns["error"][0]
    assert found.table().rows == [["3rrr", "–", "2", "2", "", "", ""]]
    for wrong, said in (
        (lambda case: {"ratio": 1 / 0}, r"case 0 \(robot 3rrr, number 0\): ZeroDivisionError"),
        (lambda case: 3, "answer 3: must be a mapping"),
        (lambda case: {"x": [1]}, r"x = \[1\]: must be a number"),
        (lambda case: {"number": 1}, "'number' is the name of another column"),
        (lambda case: {"case": 1}, "'case' is the name of another column"),
    ):
        with refused(said):
            tp.monte_carlo(wrong, "3rrr", 1, workers=0)


@pytest.mark.parametrize("count", [1, 2])
def test_on_a_cluster_a_worker_that_is_killed_loses_nothing(alone, tmp_path, count):
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with distributed.LocalCluster(
        n_workers=count, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path)
    ) as cluster:
        killed = []

        def kill(done, total):
            if done == 2 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], 9)

        options = {"seed": 3, "chunk": 1, "cluster": cluster, "progress": kill}
        found = tp.monte_carlo(slow, ["3rrr", "h4"], COUNT, **options)
        assert killed and same(alone, found)


def test_a_cluster_of_other_versions_is_refused(monkeypatch):
    class Client:
        def __init__(self, found):
            self.found = found

        def run(self, _):
            return self.found

    old = workers.versions() | {"numpy": "1.0"}
    with refused(r"worker tcp://a has numpy 1\.0, here is"):
        dask_cluster.require_same(Client({"tcp://a": old}))
    with refused("no workers"):
        dask_cluster.require_same(Client({}))


def test_no_cluster_where_there_is_none_is_one_line(refusal, monkeypatch):
    pytest.importorskip("distributed", reason="dask is not installed")
    monkeypatch.setattr(dask_cluster, "PATIENCE", 0.5)
    assert "--cluster tcp://127.0.0.1:9: no scheduler responds there" in refusal(
        "monte-carlo", "rest", "3rrr", "--count", 2, "--cluster", "tcp://127.0.0.1:9"
    )


def test_the_command_asks_ready_questions_and_those_of_a_file(run, refusal, tmp_path):
    status, out, errors = run("monte-carlo", "calibration", "h4", "--count", 2, "--workers", 0)
    assert status == 0 and "calibrated_mm" in out and "bound_deg" in out, errors
    script = tmp_path / "mine.py"
    script.write_text(
        "def rods(case):\n    rod = case.true.parameters['chain1.rod'].value\n"
        "    return {'rod': case.values.get('n', 1) * rod}\n"
    )
    words = ("monte-carlo", f"{script}:rods", "3rrr", "--count", 4, "--workers", 2, "--chunk", 2)
    status, out, errors = run(*words, "-o", tmp_path / "kept", "--grid", "n=1,2")
    assert status == 0 and "3rrr   2  rod" in out and "Kept in" in out, errors
    for wrong, said in (
        ("nothing", "function 'nothing'"),
        (f"{script}:rod", "did you mean 'rods'"),
        (f"{tmp_path / 'no.py'}:rods", "cannot be read"),
    ):
        assert said in refusal("monte-carlo", wrong, "3rrr")


def ended(pid: int) -> bool:
    """Whether a process runs no more; one that nobody waited for is no process of ours."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except FileNotFoundError:
        return True


def waited(true, seconds=120.0):
    """Wait until something holds; return whether it does."""
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


SLOW = """
import os, time
from pathlib import Path

def slow(case):
    Path(str(os.getpid())).touch()
    time.sleep(600)
    return {"n": case.number}
"""


@pytest.fixture
def endless(tmp_path):
    """Start a study, in a process group of its own, that takes an hour; wait until it works."""
    (tmp_path / "mine.py").write_text(SLOW)
    begun = []

    def begin(*words, workers):
        study = [
            sys.executable,
            "-m",
            "truepose.commands.cli",
            "monte-carlo",
            "mine.py:slow",
            "3rrr",
        ]
        # A launcher of the tests may ignore the signal, and a child would inherit that.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        study = subprocess.Popen(
            [*study, *words], cwd=tmp_path, stderr=subprocess.PIPE, start_new_session=True
        )
        signal.signal(signal.SIGINT, before)
        begun.append(study)
        assert waited(lambda: len(pids()) >= workers), study.poll()
        return study

    def pids():
        return [int(path.name) for path in tmp_path.iterdir() if path.name.isdigit()]

    begin.pids = pids
    yield begin
    for study in begun:
        study.kill()
        study.wait()
        study.stderr.close()
    for pid in pids():
        if not ended(pid):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_workers_end_with_a_study_that_is_killed(endless, number):
    study = endless("--workers", "2", "--chunk", "1", workers=2)
    study.send_signal(number)
    study.wait(120)
    assert waited(lambda: all(map(ended, endless.pids())))


def test_ctrl_c_ends_a_study_in_one_line_with_its_workers(endless):
    """A terminal sends the signal to all its processes."""
    study = endless("--workers", "2", "--chunk", "1", workers=2)
    os.killpg(study.pid, signal.SIGINT)
    assert study.wait(120) == 130
    assert study.stderr.read() == b"truepose: interrupted\n"
    assert all(map(ended, endless.pids()))


def test_ctrl_c_ends_a_study_on_a_cluster_in_one_line(endless, tmp_path, monkeypatch):
    """The command ends at once; the cluster keeps nothing of it to do."""
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    monkeypatch.chdir(tmp_path)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path)
    ) as cluster:
        study = endless("--chunk", "1", "--cluster", cluster.scheduler_address, workers=2)
        os.killpg(study.pid, signal.SIGINT)
        assert study.wait(120) == 130
        assert study.stderr.read() == b"truepose: interrupted\n"
        assert waited(lambda: not cluster.scheduler.tasks)


def test_calibrations_of_sampled_robots_keep_their_bound():
    """Par4's rods are in pairs: readings of one level, calibrated at the other, exceed it."""
    par4 = tp.load("par4").with_sensors("theta", "z_telemeter")
    found = tp.monte_carlo("calibration", par4, 64, workers=0).columns
    error, bound = (np.sqrt(np.mean(found[f"{of}_mm"] ** 2)) for of in ("calibrated", "bound"))
    assert 0.85 < error / bound < 1.15
