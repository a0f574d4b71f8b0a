"""`truepose linuxcnc`: hands geometry over to a running LinuxCNC."""

import contextlib
import ctypes
import signal
import time
from typing import Annotated

from typer import Option

from truepose.commands.options import RobotName, SensorsOption, load_with
from truepose.control.controller import Controller
from truepose.exceptions import InputError, TrueposeError
from truepose.faults.monitor import FaultMonitor
from truepose.robotfile import path_of
from truepose.show.terminal import say
from truepose_linuxcnc.configuration import to_table

#: s between two looks at the file, longer than the pause that separates tables
#: (hal/exchange_core.c); s between two looks at a full port.
_LOOKS, _FULL = 2.0, 0.01
_OUT = 32  # HAL_OUT


def command(
    robot: RobotName,
    sensors: SensorsOption = None,
    name: Annotated[str, Option(help="Name of the HAL component.")] = "truepose_geometry",
) -> None:
    """Hand a robot file's geometry over to a running LinuxCNC, again whenever the file changes.

    A HAL component with one pin, a port, for the pin geometry of truepose_tej.

    Example: **truepose linuxcnc followed.toml**
    """
    path, port, sent = path_of(robot), _Port(name), 0
    if not path.exists():
        say(f"truepose: {path}: no such file yet", err=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # of LinuxCNC's end
    with contextlib.suppress(KeyboardInterrupt), port:
        while True:
            with contextlib.suppress(OSError):
                changed = path.stat().st_mtime_ns
                if changed != sent:
                    sent = changed
                    _send(port, robot, sensors)
            time.sleep(_LOOKS)


def _send(port: "_Port", robot: str, sensors: str | None) -> None:
    """Send a file's geometry; print why it cannot be sent."""
    try:
        table = to_table(load_with(robot, sensors), Controller(), FaultMonitor())
    except TrueposeError as error:
        say(f"truepose: {error}: the last good geometry stays in use", err=True)
        return
    port.write(table)
    say(f"truepose: {robot}: {len(table)} bytes sent")


class _Port:
    """HAL component with an output pin for bytes."""

    def __init__(self, name: str) -> None:
        try:
            self._hal = ctypes.CDLL("liblinuxcnchal.so.0")
        except OSError:
            raise InputError("LinuxCNC is not installed (Debian: linuxcnc-uspace)") from None
        self._hal.hal_malloc.restype = ctypes.c_void_p
        self._hal.hal_port_write.restype = ctypes.c_bool
        self._id = self._hal.hal_init(name.encode())
        if self._id < 0:
            raise InputError(f"--name {name}: no LinuxCNC runs here, or the name is in use")
        handle = ctypes.POINTER(ctypes.c_int)
        place = self._hal.hal_malloc(ctypes.sizeof(handle))
        self._port = ctypes.cast(place, ctypes.POINTER(handle))
        self._hal.hal_pin_port_new(f"{name}.out".encode(), _OUT, self._port, self._id)
        self._hal.hal_ready(self._id)

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None:
        self._hal.hal_exit(self._id)

    def write(self, data: bytes) -> None:
        """Write bytes as the reader takes them."""
        while data:
            port = self._port[0][0]  # 0: not connected
            some = min(self._hal.hal_port_writable(port) if port else 0, len(data))
            if some and self._hal.hal_port_write(port, data[:some], some):
                data = data[some:]
            else:
                time.sleep(_FULL)
