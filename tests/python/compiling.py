"""Compilers, CMake and built programs for tests."""

import os
import subprocess
from importlib.machinery import PathFinder
from pathlib import Path


def told(*command, cwd=None, env=None) -> str:
    """Return what a command says, or fail with all that it says."""
    ran = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=os.environ | (env or {}),
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def wheels_eigen() -> Path:
    """Return the prefix of the Eigen that comes as a wheel."""
    return Path(PathFinder.find_spec("cmeel").origin).parents[1] / "cmeel.prefix"
