"""Pictures of the page without installation: docs/pictures/page-printer.png and page-robot.png.

Run as ``python packages/printers/tools/page_pictures.py`` after ``make page``; needs playwright,
Pillow and Debian's chromium.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "build/page/truepose.html"
PRINTER = ROOT / "packages/printers/tests/data/phnxdrgn536.cfg"


def save(name: str, shot: bytes) -> None:
    """Write a picture in 256 colours, which keeps it small."""
    picture = Image.open(io.BytesIO(shot)).convert("RGB").quantize(256)
    picture.save(ROOT / "docs/pictures" / name, optimize=True)


def main() -> None:
    """Take both pictures."""
    with sync_playwright() as driver:
        flags = ["--no-sandbox"]
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        seen = browser.new_page(viewport={"width": 1000, "height": 900})
        seen.goto(PAGE.as_uri())
        seen.evaluate("truepose.ready")
        seen.get_by_role("button", name="Simulate a log and calibrate").click()
        save("page-robot.png", seen.locator("section").nth(1).screenshot())
        seen.set_input_files("#file", PRINTER)
        seen.locator("#results > article").first.wait_for()
        save("page-printer.png", seen.locator("#results > article").first.screenshot())
        browser.close()


if __name__ == "__main__":
    main()
