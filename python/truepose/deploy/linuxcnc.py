"""What do LinuxCNC's components need of a robot? One table, and a configuration that uses it."""

from __future__ import annotations

import struct

import numpy as np

from truepose import _core
from truepose.exceptions import InputError
from truepose.robot.knowledge import knowledge
from truepose.robot.robot import Robot
from truepose.simulation.controller import Controller
from truepose.simulation.watch import Watch

#: Uncertain parameters that the components hold at most (deploy/linuxcnc/table.h).
_PARAMETERS = 256


def to_table(robot: Robot, controller: Controller, watch: Watch) -> bytes:
    """Return a robot as deploy/linuxcnc/table.h reads it: the C interface's structs, by name.

    It serves the kind of machine that it was written on; another refuses it.

    Parameters
    ----------
    robot : Robot
        As the controller believes it to be: as drawn, or calibrated.
    controller : Controller
        Whose period and gains the watch is to know.
    watch : Watch

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.deploy.linuxcnc import to_table
    >>> table = to_table(tp.load("five-bar"), tp.Controller(law="joint"), tp.Watch())
    >>> table[:12]
    b'trueposerobt'
    """
    blocks = {b"robt": _core.c_description_bytes(robot.core)}
    if robot.r:
        column, root, sigma = _core.c_knowledge(knowledge(robot).core)
        if len(column) > _PARAMETERS:
            raise InputError(
                f"{robot.name}: {len(column)} uncertain parameters; LinuxCNC's components hold "
                f"{_PARAMETERS}: choose fewer sensors (--sensors)"
            )
        blocks |= {
            b"fine": _core.c_description_bytes(robot.finest.core),
            b"wtch": _core.c_watch_bytes(watch.guarding(robot, controller)),
            b"sigm": np.asarray(sigma, dtype=float).tobytes(),
            b"colm": np.asarray(column, dtype=np.int32).tobytes(),
            b"root": np.asarray(root, dtype=float).tobytes(),
        }
    rows = [name + struct.pack("=I", len(block)) + block for name, block in blocks.items()]
    return b"truepose" + b"".join(rows)
