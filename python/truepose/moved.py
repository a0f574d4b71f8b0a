"""Modules and commands of 0.5 that are in packages of their own since 0.6; gone with 0.7."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

from truepose.exceptions import InputError

#: Package of each command that moved; a point separates groups.
COMMANDS = {"export.mjcf": "mujoco", "import": "mujoco", "maslow": "sleds", "view": "mujoco"}
#: New name of each module that moved.
MODULES = {
    "truepose.integrations.importers": "truepose_mujoco.importers",
    "truepose.integrations.maslow": "truepose_sleds",
    "truepose.integrations.mujoco": "truepose_mujoco",
}


def answer(name: str, package: str) -> Callable[[], None]:
    """Return a command that states the package in which the command is."""

    def command() -> None:
        raise InputError(
            f"truepose {name.replace('.', ' ')} is in the package truepose-{package}: in a "
            f"checkout of truepose, pip install packages/{package}"
        )

    return command


class _Moved(MetaPathFinder):
    """Answers imports that no other finder has answered."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name in MODULES:
            new = MODULES[name]
            package = new.partition(".")[0].replace("_", "-")
            raise ModuleNotFoundError(f"{name} is {new} now, in the package {package}", name=name)
        return None


def answer_imports() -> None:
    """Let imports of modules that moved fail with their new name."""
    sys.meta_path.append(_Moved())
