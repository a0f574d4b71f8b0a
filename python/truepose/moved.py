"""Modules, commands and arguments of 0.5 that have another place since 0.6; gone with 0.7."""

import functools
import sys
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, ParamSpec, TypeVar

from truepose.exceptions import InputError

P = ParamSpec("P")
T = TypeVar("T")

#: Package of each command that is in one; a point separates groups.
COMMANDS = {
    "export.json": "printers",
    "export.linuxcnc": "linuxcnc",
    "export.mjcf": "mujoco",
    "import": "mujoco",
    "klipper": "printers",
    "life": "life",
    "maslow": "sleds",
    "reproduce": "paper",
    "start-test": "safety",
    "view": "mujoco",
    "workbench": "workbench",
}
#: Package of each function of a study that moved.
STUDIES = {"life": "life"}
#: New name of each module that moved.
MODULES = {
    "truepose.control.adaptive": "truepose.calibration.online",
    "truepose.control.changes": "truepose.calibration.changes",
    "truepose.control.evidence": "truepose.calibration.changes",
    "truepose.control.memory": "truepose.calibration.online",
    "truepose.control.safety": "truepose_safety.shell",
    "truepose.deploy.json_export": "truepose_printers.robot_json",
    "truepose.faults.parity": "truepose.calibration.parity",
    "truepose.integrations.importers": "truepose_mujoco.importers",
    "truepose.integrations.klipper": "truepose_printers",
    "truepose.integrations.linuxcnc": "truepose_linuxcnc",
    "truepose.integrations.mujoco": "truepose_mujoco",
    "truepose.integrations.maslow": "truepose_sleds",
    "truepose.integrations.workbench": "truepose_workbench",
    "truepose.paper": "truepose_paper",
    "truepose.simulation.start_test": "truepose_safety.start_test",
    "truepose.studies.life": "truepose_life.cycle",
    "truepose.studies.life_bound": "truepose_life.bound",
    "truepose.studies.life_events": "truepose_life.events",
    "truepose.studies.life_rates": "truepose_life.rates",
    "truepose.studies.life_report": "truepose_life.report",
}
#: New name of each name of a module that moved.
NAMES = {
    "truepose.control": {
        "AdaptiveCalibrator": "truepose.OnlineCalibrator(robot, follow=True)",
        "SafetyShell": "truepose_safety.SafetyShell",
    },
    "truepose.simulation": {
        "StartTest": "truepose_safety.StartTest",
        "start_test": "truepose_safety.start_test",
    },
}


def where(what: str, package: str) -> str:
    """Return the message that something is in a package that is not installed."""
    return (
        f"{what} is in the package truepose-{package}: in a checkout of truepose, pip install "
        f"packages/{package}"
    )


def answer(name: str, package: str) -> Callable[[], None]:
    """Return a command that states the package in which the command is."""

    def command() -> None:
        raise InputError(where(f"truepose {name.replace('.', ' ')}", package))

    return command


def _refuse(gone: dict[str, str], given: dict[str, Any]) -> None:
    for name in gone.keys() & given.keys():
        raise InputError(f"{name}: is not an argument since 0.6; use {gone[name]}")


def without(**gone: str) -> Callable[[type[T]], type[T]]:
    """Refuse arguments of a class of 0.5; `gone` has the new place of each."""

    def decorate(made: type[T]) -> type[T]:
        init = made.__init__

        @functools.wraps(init)
        def refuse(self: T, *args: Any, **given: Any) -> None:
            _refuse(gone, given)
            init(self, *args, **given)

        setattr(made, "__init__", refuse)  # noqa: B010 – mypy refuses the plain assignment
        return made

    return decorate


def grouped(
    group: type, argument: str = "options", /, **gone: str
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Accept arguments of 0.5 that are fields of an argument's group now, with a warning.

    `gone` has the new place of each other argument of 0.5; these raise InputError.
    """
    names = {each.name for each in fields(group)}

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*args: Any, **given: Any) -> T:
            _refuse(gone, given)
            if older := {name: given.pop(name) for name in sorted(names & given.keys())}:
                said = f"{', '.join(older)}: since 0.6 in {argument}={group.__name__}(…)"
                warnings.warn(said, DeprecationWarning, stacklevel=2)
                given[argument] = replace(given.get(argument, group()), **older)
            return function(*args, **given)

        return call

    return decorate


class _Moved:
    """Answers imports that no other finder has answered."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        if new := MODULES.get(name):
            raise ModuleNotFoundError(_now(name, new), name=name)


def _now(name: str, new: str) -> str:
    package = new.partition(".")[0].replace("_", "-")
    return f"{name} is {new} now, in the package {package}"


def answer_imports() -> None:
    """Let imports of modules and names that moved fail with their new name."""
    sys.meta_path.append(_Moved())
    for module in NAMES:
        vars(sys.modules[module])["__getattr__"] = functools.partial(_absent, module)


def _absent(module: str, name: str) -> None:
    """Raise the error of a name that a module does not have."""
    if new := NAMES[module].get(name):
        raise AttributeError(_now(f"{module}.{name}", new))
    raise AttributeError(f"module {module!r} has no attribute {name!r}")
