"""The workbench's server: port, viser, and access."""

import socket
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from truepose.exceptions import InputError
from truepose.robot import Robot
from truepose_workbench import tabs
from truepose_workbench.design_tab import DesignTab
from truepose_workbench.log_tab import LogTab
from truepose_workbench.motion_tab import MotionTab
from truepose_workbench.page import Page
from truepose_workbench.state import State, begin


def require_free(host: str, port: int) -> None:
    """Raise InputError if the port is in use, or the host is not an address of this machine.

    viser itself would use the next free port, which differs from the printed address.
    """
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except OSError as error:
            why = error.strerror or error
            raise InputError(f"--port {port}: {host}:{port}: {why}; choose another") from None


def own_address() -> str | None:
    """Return this machine's address on its network, or None."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing; the system only selects a route
        except OSError:
            return None
        return str(probe.getsockname()[0])


def open_page(
    subject: Robot | State,
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    log: Path | None = None,
    dark: bool = False,
    prices: Mapping[str, float] | None = None,
) -> Page:
    """Serve the page of a robot, or of a state, until its `stop` is called.

    Prices are of sensors, by name; by default those of the robot file.

    InputError: the port is in use, or the log is invalid.
    """
    require_free(host, port)
    shown: dict[str, Any] = {"Design": partial(DesignTab, prices=prices)}
    shown |= {"Pose": tabs.PoseTab, "Errors": tabs.ErrorsTab}
    shown |= {"Log": LogTab, "Motion": MotionTab, "View": tabs.ViewTab}
    page = Page(subject if isinstance(subject, State) else begin(subject), host, port, shown, dark)
    try:
        if log is not None:
            with page.lock:
                page.tabs[3].open(log)
                page.show()
    except BaseException:
        page.stop()
        raise
    return page


def serve(page: Page) -> None:
    """Serve until interrupted."""
    try:
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        return
    finally:
        page.stop()
