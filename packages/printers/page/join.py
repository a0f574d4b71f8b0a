"""Join page.html, its style, its scripts, a robot and the core to one file.

Run as ``python join.py page.wasm truepose.html``; truepose must be importable.
"""

import base64
import gzip
import sys
from importlib.metadata import version
from pathlib import Path

import truepose

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "src"))

from truepose_printers.robot_json import to_json  # noqa: E402 – of this checkout


def text(name: str) -> str:
    """Read a part of the page."""
    return (HERE / name).read_text(encoding="utf-8")


def main() -> None:
    """Write the page."""
    h4 = truepose.load("h4").with_sensors("theta", "z_telemeter")
    wasm = gzip.compress(Path(sys.argv[1]).read_bytes(), 9, mtime=0)
    parts = {
        "/*page.css*/": text("page.css"),
        "/*scripts*/": "".join(
            map(text, ("core.js", "show.js", "robot.js", "printer.js", "page.js"))
        ),
        "<!--version-->": version("truepose"),
        "<!--h4-->": to_json(h4).replace("<", "\\u003c"),
        "<!--wasm-->": base64.b64encode(wasm).decode(),
    }
    page = text("page.html")
    for mark, part in parts.items():
        assert page.count(mark) == 1, mark
        page = page.replace(mark, part)
    Path(sys.argv[2]).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
