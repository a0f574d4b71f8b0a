"""LinuxCNC's modules without LinuxCNC. In this process, with a stub of HAL."""

import ctypes

import numpy as np

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
