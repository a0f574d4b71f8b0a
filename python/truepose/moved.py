"""Modules, commands and arguments of 0.5 that have another place since 0.6; gone with 0.7."""

import difflib
import functools
import sys
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from types import ModuleType
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
#: New name of each command that was renamed.
RENAMED = {"robots": "list", "study": "monte-carlo"}
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
#: New name of each name of a module that moved, and of names that are usual elsewhere.
NAMES = {
    "truepose": {
        "Fit": "truepose.calibration.Calibration",
        "Influence": "truepose.calibration.NuisanceParameter",
        "Loads": "truepose.calibration.Payloads",
        "Margins": "truepose.control.StabilityMargins",
        "OnlineCalibration": "truepose.OnlineCalibrator",
        "Watch": "truepose.FaultMonitor",
        "fault_limits": "truepose.faults.detectability",
        "margins": "truepose.control.stability_margins",
        "place": "truepose.design.place_sensors",
        "plan": "truepose.plan_poses",
        "robots": "truepose.list_robots",
        "settle": "truepose.steady_state",
        "load_robot": "truepose.load",
        "study": "truepose.monte_carlo",
    },
    "truepose.Robot": {
        "J": "jacobian(x)",
        "dof": "n",
        "extended": "extended_positions",
        "finest": "at_highest_level",
        "finest_level": "highest_level",
        "forward_kinematics": "fkm",
        "inverse_kinematics": "ikm",
        "leakage": "cross_sensitivity",
        "linearise": "linearize",
        "parasitic": "residual_motion",
        "tension": "rod_forces",
        "unquantised": "without_quantization",
        "with_load": "with_payload",
    },
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


def answer(said: str) -> Callable[[], None]:
    """Return a command that states its new name or package."""

    def command() -> None:
        raise InputError(said)

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
    there = f", in the package {package}" if package.startswith("truepose-") else ""
    return f"{name} is {new} now{there}"


def answer_imports() -> None:
    """Let imports of modules that moved fail with their new name."""
    sys.meta_path.append(_Moved())


def answers(module: str) -> Callable[[str], None]:
    """Return a module's `__getattr__`."""

    def refuse(name: str) -> None:
        raise AttributeError(absent(module, name))

    return refuse


def absent(module: str, name: str) -> str:
    """Return the message that a module has no such name, with the place that has it."""
    if name not in NAMES[module] and name[:1] != "_":
        package = sys.modules["truepose"]
        parts = {part: getattr(package, part) for part in package.__all__}
        for part, of in parts.items():
            if isinstance(of, ModuleType) and name in dir(of):
                return _now(f"{module}.{name}", f"truepose.{part}.{name}")
    return no_attribute(module, name, dir(sys.modules[module]))


def no_attribute(of: str, name: str, known: list[str]) -> str:
    """Return the message that a module or class has no such attribute, with its new name."""
    if new := NAMES.get(of, {}).get(name):
        return _now(f"{of}.{name}", new)
    near = difflib.get_close_matches(name, [each for each in known if each[0] != "_"], 1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"{of} has no attribute '{name}'{hint}"
