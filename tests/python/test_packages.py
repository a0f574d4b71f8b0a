"""Packages beside the core: one version, and what 0.5 had in the core states where it is."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import truepose as tp
from truepose import moved
from truepose.exceptions import InputError

ROOT = Path(__file__).parents[2]
CORE = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = {
    file.parent.name: tomllib.loads(file.read_text())["project"]
    for file in sorted(ROOT.glob("packages/*/pyproject.toml"))
}


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_has_the_version_of_the_core_that_it_needs(name):
    package = PACKAGES[name]
    assert package["name"] == f"truepose-{name}"
    assert package["version"] == CORE["version"]
    assert f"truepose=={CORE['version']}" in package["dependencies"]


def test_every_command_that_moved_is_in_its_package():
    for command, package in moved.COMMANDS.items():
        assert command in PACKAGES[package]["entry-points"]["truepose.commands"]


@pytest.mark.parametrize(("command", "package"), moved.COMMANDS.items())
def test_a_command_of_a_package_that_is_not_installed_states_how_to_install_it(command, package):
    app = typer.Typer()
    app.command()(moved.answer(moved.where(f"truepose {command}", package)))
    said = CliRunner().invoke(app).exception
    assert isinstance(said, InputError)
    assert f"pip install packages/{package}" in str(said)


@pytest.mark.parametrize(("old", "new"), moved.MODULES.items())
def test_a_module_that_moved_states_where_to(old, new):
    with pytest.raises(ModuleNotFoundError, match=new):
        importlib.import_module(f"{old}.any")


def test_an_argument_that_moved_states_where_to():
    with pytest.raises(InputError, match=r"carry: is not an argument since 0.6; use forces="):
        tp.FaultMonitor(carry=True)


@pytest.mark.parametrize("module", moved.NAMES)
def test_a_name_that_moved_states_where_to(module):
    said = {old: f"{module}.{old} is {new} now" for old, new in moved.NAMES[module].items()}
    of = tp.load("delta") if module == "truepose.Robot" else importlib.import_module(module)
    for name, words in (said | {"any": f"{module} has no attribute 'any'"}).items():
        with pytest.raises(AttributeError, match=re.escape(words)):
            getattr(of, name)
