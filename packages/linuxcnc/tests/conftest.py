"""LinuxCNC's modules in this process, ours built, with a stub of HAL."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

PACKAGE = Path(__file__).parents[1]
ROOT = PACKAGE.parents[1]
#: Folder of LinuxCNC's own modules.
MODULES = Path("/usr/lib/linuxcnc/modules")
AXES = "xyzabcuvw"


class Pose(ctypes.Structure):
    _fields_ = [(letter, ctypes.c_double) for letter in AXES]


class Module:
    """A module of LinuxCNC in this process."""

    def __init__(self, hal, path, **parameters):
        self.hal, self.at = hal, {}
        self.library = ctypes.CDLL(str(path))
        self.parameters = {name: value.encode() for name, value in parameters.items()}
        for name, value in self.parameters.items():
            address = ctypes.c_void_p.in_dll(self.library, f"rtapi_info_address_{name}").value
            ctypes.cast(address, ctypes.POINTER(ctypes.c_char_p))[0] = value
        self.refused = self.library.rtapi_app_main() != 0
        self.flags = (ctypes.c_ulong * 4)()

    def knows(self, *names):
        """Find pins now: a module that is loaded later may have the same."""
        for name in names:
            self.at[name] = self.hal.stub_pin(name.encode())
            assert self.at[name], name
        return self

    def pin(self, name, kind=ctypes.c_double):
        return ctypes.cast(self.at[name], ctypes.POINTER(kind))

    def inverse(self, x):
        joints = (ctypes.c_double * 16)()
        pose = Pose(*x)
        failed = self.library.kinematicsInverse(ctypes.byref(pose), joints, self.flags, self.flags)
        return failed, np.array(joints[:9])

    def forward(self, joints, guess=()):
        pose = Pose(*guess)
        failed = self.library.kinematicsForward(
            (ctypes.c_double * 16)(*joints), ctypes.byref(pose), self.flags, self.flags
        )
        return failed, np.array([getattr(pose, letter) for letter in AXES])


@pytest.fixture(scope="session")
def components(tmp_path_factory) -> Path:
    """Return a folder with the components, built from hal/ against the C libraries."""
    built, include = ROOT / "build/safety/library", ROOT / "include"
    libraries = built / "libtruepose_safety.a", built / "core/libtruepose.a"
    if shutil.which("halcompile") is None:
        pytest.skip("LinuxCNC is not installed (Debian: linuxcnc-uspace linuxcnc-uspace-dev)")
    if not libraries[0].exists():
        pytest.skip("libtruepose_safety.a is not built: `make -C packages/linuxcnc test` builds it")
    work = tmp_path_factory.mktemp("components")
    for source in (PACKAGE / "hal").glob("*"):
        if source.suffix in (".c", ".h") or source.name == "Makefile":
            shutil.copy(source, work)
    places = [f"LIBRARY={libraries[0]} {libraries[1]}"]
    places += [f"INCLUDE={include} {ROOT / 'packages/safety/include'}"]
    subprocess.run(["make", "-s", "-C", work, *places], check=True)
    return work


@pytest.fixture(scope="session")
def hal(tmp_path_factory):
    """Return a library with the functions of LinuxCNC's HAL (stub_hal.c)."""
    library = tmp_path_factory.mktemp("hal") / "libhal.so"
    source = PACKAGE / "tests/stub_hal.c"
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


@pytest.fixture
def stock(hal):
    """Load a module of LinuxCNC's own."""
    if not MODULES.exists():
        pytest.skip("LinuxCNC is not installed (Debian: linuxcnc-uspace)")
    return lambda name: Module(hal, MODULES / f"{name}.so")
