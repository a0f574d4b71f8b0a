"""Compilers, CMake and built programs for tests."""

import os
import shutil
import subprocess
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

BUILTINS = "/usr/lib/llvm-22/lib/clang/22/lib/wasi/libclang_rt.builtins-wasm32.a"
#: Skips a test where there is no compiler for WebAssembly.
for_wasm = pytest.mark.skipif(
    not all(map(shutil.which, ("make", "clang++-22", "wasm-ld-22")))
    or not Path("/usr/include/wasm32-wasi/c++/v1").exists()
    or not Path(BUILTINS).exists(),
    reason="no compiler for wasm32 (Debian: clang-22 lld-22 wasi-libc libc++-22-dev-wasm32 "
    "libclang-rt-22-dev-wasm32)",
)


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
