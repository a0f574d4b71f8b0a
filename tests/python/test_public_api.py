"""The public API: names, docstrings, import cost."""

import copy
import inspect
import operator
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import truepose as tp


def public_names() -> list[str]:
    """Names at the top, and those of the public submodules."""
    modules = [name for name in tp.__all__ if inspect.ismodule(getattr(tp, name))]
    return [
        *tp.__all__,
        *(f"{room}.{name}" for room in modules for name in getattr(tp, room).__all__),
    ]


@pytest.mark.parametrize("name", public_names())
def test_every_public_name_exists_and_says_what_it_is(name):
    assert inspect.getdoc(operator.attrgetter(name)(tp))


def test_no_function_and_module_share_a_word():
    functions = {
        name for name in public_names() if inspect.isfunction(operator.attrgetter(name)(tp))
    }
    rooms = {path.stem for path in Path(tp.__file__).parent.iterdir()}
    assert {name.rpartition(".")[2] for name in functions}.isdisjoint(rooms)


HELP = "from truepose.commands import cli; cli.app({}, standalone_mode=False)".format


@pytest.mark.parametrize(
    ("code", "unused"),
    [
        ("", "matplotlib mujoco dask rich typer jinja2 scipy ruckig"),
        (HELP(["--help"]), "matplotlib mujoco dask scipy"),
        (HELP(["calibrate", "--help"]), "matplotlib mujoco dask scipy"),
    ],
    ids=["import", "help", "help of a command"],
)
def test_what_is_not_needed_is_not_imported(code, unused):
    code = f"import sys, truepose; {code}\nprint({set(unused.split())} & set(sys.modules))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[-1] == "set()"


def test_a_robot_introduces_itself(h4):
    assert repr(h4) == "<truepose.Robot h4: schoenflies, n=4, theta>"
    assert [name for name, _ in h4.coordinates] == ["x", "y", "z", "theta"]
    assert [unit for _, unit in h4.coordinates] == ["m", "m", "m", "rad"]


def test_errors_can_be_caught_together_and_apart(h4):
    for error in (tp.RobotFileError, tp.PoseError, tp.InputError):
        assert issubclass(error, tp.TrueposeError)
    assert issubclass(tp.InputError, ValueError)
    with pytest.raises(tp.TrueposeError):
        h4.ikm([0, 0, -2, 0])


def test_dir_shows_the_api_alone():
    assert set(dir(tp)) == {*tp.__all__, "__version__"}


def test_types_are_told():
    """Of the package by its sources, of the core by the stub that is built with it."""
    folder = Path(tp.__file__).parent
    assert (folder / "py.typed").is_file()
    if not (folder.parents[1] / "pyproject.toml").is_file():  # installed, not the sources
        assert "class Robot:" in (folder / "_core.pyi").read_text(encoding="utf-8")


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))])
def test_copies_answer_bit_for_bit(copied, h4, truth, table2):
    readings = truth.extended_positions(table2[::9])
    fit, online = tp.calibrate(h4, readings), tp.OnlineCalibrator(h4)
    online.observe(readings[:35])  # no whole number of rounds
    assert copied(fit.robot) == fit.robot and copied(fit).chi2.tobytes() == fit.chi2.tobytes()
    poses = [robot.estimate(readings).x for robot in (fit.robot, copied(fit.robot))]
    assert poses[0].tobytes() == poses[1].tobytes()
    same = copied(online)
    for each in (online, same):
        each.observe(readings[35:])
    assert same.covariance.tobytes() == online.covariance.tobytes()
    controller = tp.Controller(law="estimated")
    runs = [
        tp.simulate(h4, truth, c, run=tp.simulation.Run(duration=0.1, hold=0))
        for c in (controller, copied(controller))
    ]
    assert runs[0].x.tobytes() == copied(runs[1]).x.tobytes()
