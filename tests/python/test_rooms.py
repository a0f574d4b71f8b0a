"""The rooms of the package: imports, public names, and the core without each integration."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import truepose as tp
from truepose.plugins import plugins

ROOT = Path(tp.__file__).parent


def test_the_api_works_once_every_module_is_imported(h4):
    for module in pkgutil.walk_packages(tp.__path__, "truepose."):
        importlib.import_module(module.name)
    assert "h4" in tp.list_robots()
    robot = h4
    truth = robot.sample(1)
    run = tp.simulate(robot, truth, tp.Controller(law="tej"), effects=tp.Effects.none())
    assert run.status == "ok"
    poses = [robot.home, tp.steady_state(robot, truth, robot.home)]
    assert tp.accuracy(robot, poses).shape == (2, 4, 4)
    assert tp.calibrate(robot, truth.extended_positions([run.x[0], run.x[-1]])).robot.n == 4
    assert len(robot.assembly_modes(robot.ikm(robot.home), starts=50)) >= 1


INTEGRATIONS = sorted(path.parent.name for path in (ROOT / "integrations").glob("*/__init__.py"))
#: Every module of the core is imported, and the core is used.
CORE = """
import importlib, pkgutil
import truepose as tp
from truepose.plugins import plugins
from truepose import logs
from truepose.commands import cli
for module in pkgutil.walk_packages(tp.__path__, "truepose."):
    if not module.name.startswith("truepose.integrations"):
        importlib.import_module(module.name)
h4 = tp.load("h4")
run = tp.simulate(h4, h4.sample(1))
logs.write(run, "run.csv")
assert logs.read(h4, "run.csv").readings.shape == run.q_e.shape
cli.app(["info", "h4"], standalone_mode=False)
print(tp.__file__)
"""


@pytest.mark.parametrize("removed", [*INTEGRATIONS, "every one"])
def test_the_core_works_without_an_integration(removed, tmp_path):
    package = tmp_path / "truepose"
    shutil.copytree(ROOT, package, ignore=shutil.ignore_patterns("_data", "_core*", "__pycache__"))
    for name in ("_data", next(ROOT.glob("_core*.so")).name):
        (package / name).symlink_to(ROOT / name)
    folder = package / "integrations"
    shutil.rmtree(folder if removed == "every one" else folder / removed)
    info = tmp_path / "truepose-0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: truepose\nVersion: {tp.__version__}\n")
    gone = "integrations." + "" if removed == "every one" else f"integrations.{removed}."
    with (info / "entry_points.txt").open("w") as file:
        for group in ("commands", "log_formats", "clusters"):
            kept = (p for p in plugins(group).values() if gone not in p.value)
            file.write(f"[truepose.{group}]\n" + "".join(f"{p.name} = {p.value}\n" for p in kept))
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    out = subprocess.run(
        [sys.executable, "-c", CORE],
        capture_output=True, text=True, cwd=tmp_path, env=environment, check=False,
    )  # fmt: skip
    assert out.returncode == 0, out.stderr[-2000:]
    assert out.stdout.split()[-1] == str(package / "__init__.py")
