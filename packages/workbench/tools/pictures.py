"""Pictures of the workbench: docs/pictures/workbench.png, -phone.png, and the animation .webp.

Run as ``python packages/workbench/tools/pictures.py [FOLDER]``; needs playwright, Pillow and
Debian's chromium (or another, named by CHROMIUM). Actions of a user are simulated on the page.
"""

import io
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Page as Seen
from playwright.sync_api import sync_playwright

from truepose.robot import load
from truepose.robot.frames import frames
from truepose_workbench import serve
from truepose_workbench.state import Terms, begin, demonstration

PICTURES = Path(*sys.argv[1:] or [Path(__file__).parents[3] / "docs/pictures"])
PORT = 8199
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
WIDE, PHONE = {"width": 1400, "height": 900}, {"width": 390, "height": 844}
FILM = {"width": 1000, "height": 640}
#: As in docs/choose-sensors.md.
PRICES = {"theta": 90, "z_telemeter": 400, "wire1": 250, "wire2": 250, "wire3": 250}
PRICES |= {"pivot1": 40, "pivot2": 40, "reference_pose": 120, "self_calibration": 60}
MOST = 3_000_000  #: bytes of an animation
PATIENCE = 120_000  #: ms; a browser without a graphics card is slow


def looked_at(browser: Any, size: dict, address: str) -> Seen:
    """Open the page without viser's note on the graphics card."""
    seen = browser.new_page(viewport=size)
    seen.set_default_timeout(PATIENCE)
    seen.goto(address)
    seen.wait_for_selector("text=steady state")
    seen.add_style_tag(content=".mantine-Notifications-root { display: none !important }")
    settled(seen, 15)
    return seen


def settled(seen: Seen, count: int = 8) -> None:
    """Wait until the browser, which may be slow, has drawn `count` more frames."""
    seen.wait_for_timeout(250)
    seen.evaluate(
        "count => new Promise(done => { const one = () => count-- > 0 ? "
        "requestAnimationFrame(one) : done(); one(); })",
        count,
    )


class Film:
    """Frames of the view, in order."""

    def __init__(self, seen: Seen):
        self.seen, self.frames, self.times = seen, [], []

    def take(self, milliseconds: int = 140, frames: int = 4) -> None:
        """Add the present view, shown for this time."""
        settled(self.seen, frames)
        shot = Image.open(io.BytesIO(self.seen.screenshot(timeout=PATIENCE)))
        self.frames.append(shot.convert("RGB"))
        self.times.append(milliseconds)

    def save(self, path: Path) -> None:
        """Write at the best quality within `MOST` bytes."""
        for quality in (80, 65, 50, 35, 20):
            self.frames[0].save(
                path,
                save_all=True,
                append_images=self.frames[1:],
                duration=self.times,
                loop=0,
                quality=quality,
                method=4,
            )
            if path.stat().st_size <= MOST:
                return
        raise SystemExit(f"{path}: {path.stat().st_size} bytes: take fewer frames")


def film(page: Any, seen: Seen) -> None:
    """Drag a robot with one rod 3 mm too long, then calibrate it."""
    robot, shown, start = page.state.drawn, Film(seen), page.state.x_d

    def circle() -> None:
        for turn in np.linspace(0, 2 * np.pi, 13):
            along, up = np.sin(turn), np.cos(turn)
            with page.doing():
                x = np.add(start, [0.08 * along, -0.08 * up, 0, 0.3 * along])
                page.drag(frames(robot, x), True)
            shown.take()

    shown.take(2000)
    circle()
    with page.doing():
        page.state = page.state.sent(start)
    shown.take(1200, 8)
    with page.doing():
        page.calibrate()
    shown.take(2500, 10)
    circle()
    shown.take(3000)
    shown.save(PICTURES / "workbench.webp")


def decide(page: Any, seen: Seen) -> None:
    """Choose sensors for 800, for robots that are referenced and calibrated on 20 planned poses."""
    design = page.tabs[0]
    with page.doing():
        page.map = "position error"
        page.state = replace(page.state, terms=Terms(20, True))
        design._budget.value = 800.0
        design._choose(800.0)
    settled(seen, 15)
    with page.doing():
        design._ask_plan()
    while design._plan is None:
        settled(seen)
    settled(seen, 15)


def main() -> None:
    """Take all pictures."""
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        for name, size, dark in (
            ("workbench.png", WIDE, False),
            ("workbench-phone.png", PHONE, True),
            ("workbench.webp", FILM, False),
        ):
            sampled = begin(load("h4")).with_drawn_errors(1)
            subject = demonstration() if name.endswith(".webp") else sampled
            page = serve.open_page(subject, port=PORT, dark=dark, prices=PRICES)
            seen = looked_at(browser, size, page.address("127.0.0.1"))
            if name.endswith(".webp"):
                film(page, seen)
            else:
                decide(page, seen)
                shot = Image.open(io.BytesIO(seen.screenshot(timeout=PATIENCE)))
                shot.convert("RGB").save(PICTURES / name, optimize=True)
            seen.close()
            page.stop()
        browser.close()


if __name__ == "__main__":
    main()
