"""LinuxCNC's components, built, and loaded into this process with a stub of its HAL."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from linuxcnc_modules import Module


@pytest.fixture(scope="session")
def components(tmp_path_factory) -> Path:
    """Return a folder with LinuxCNC's components, built; `make linuxcnc` makes what they link."""
    root = Path(__file__).parents[4]
    library = Path(os.environ.get("TRUEPOSE_LIBRARY", root / "build/library/libtruepose.a"))
    if shutil.which("halcompile") is None:
        pytest.skip("LinuxCNC is not installed (Debian: linuxcnc-uspace linuxcnc-uspace-dev)")
    if not library.exists():
        pytest.skip("libtruepose.a is not built: `make linuxcnc` builds it, and runs this")
    work = tmp_path_factory.mktemp("components")
    for source in (root / "deploy/linuxcnc").glob("*"):
        if source.suffix in (".c", ".h") or source.name == "Makefile":
            shutil.copy(source, work)
    places = [f"LIBRARY={library.resolve()}", f"INCLUDE={root / 'include'}"]
    subprocess.run(["make", "-s", "-C", work, *places], check=True)
    return work


@pytest.fixture(scope="session")
def hal(tmp_path_factory):
    """Return what stands for LinuxCNC's HAL (tests/linuxcnc/stub_hal.c)."""
    library = tmp_path_factory.mktemp("hal") / "libhal.so"
    source = Path(__file__).parents[3] / "linuxcnc/stub_hal.c"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    hal = ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    hal.stub_pin.restype = ctypes.c_void_p
    return hal


@pytest.fixture
def ours(hal, tmp_path, components):
    """Load a module of ours anew: one that is loaded twice from one file is the same one."""

    def load(name="truepose_kins", **parameters):
        copy = tmp_path / f"{name}{len(list(tmp_path.iterdir()))}.so"
        shutil.copy(components / f"{name}.so", copy)
        return Module(hal, copy, **parameters)

    return load
