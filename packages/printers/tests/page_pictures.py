"""Pictures of the page without installation: docs/pictures/page-printer.png and page-robot.png.

Run as ``python packages/printers/tests/page_pictures.py`` after ``make page``; needs playwright,
Pillow and Debian's chromium.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[3]


def main() -> None:
    """Take both pictures, in 256 colours, which keeps them small."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        seen = browser.new_page(viewport={"width": 1000, "height": 900})
        seen.goto((ROOT / "build/page/truepose.html").as_uri())
        seen.evaluate("truepose.ready")
        seen.get_by_role("button", name="Simulate a log and calibrate").click()
        seen.set_input_files("#file", ROOT / "packages/printers/tests/data/danorder-v400.cfg")
        for name, place in (("robot", "section:has(#robot)"), ("printer", "#results > article")):
            shot = Image.open(io.BytesIO(seen.locator(place).screenshot()))
            shot.convert("RGB").quantize(256).save(
                ROOT / f"docs/pictures/page-{name}.png", optimize=True
            )
        browser.close()


if __name__ == "__main__":
    main()
