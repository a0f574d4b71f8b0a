"""Table of reference results: `python benchmarks/reference/run.py [FOLDER …]`, `make reference`.

Every folder beside this file has a `check.py` whose `rows()` compares printed figures with
truepose's. The exit status is 1 if a verdict failed.
"""

import runpy
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rows import Row

HERE = Path(__file__).parent
#: Colours of the verdicts.
STYLE = {"reproduced": "green", "explained": "cyan", "open": "yellow", "FAILED": "bold red"}


def folders() -> list[str]:
    """Return the names of all references."""
    return sorted(path.parent.name for path in HERE.glob("*/check.py"))


def check(folder: str) -> list[Row]:
    """Return the rows of one reference."""
    path = HERE / folder / "check.py"
    if not path.is_file():
        raise SystemExit(f"{folder}: no such reference; there are {', '.join(folders())}")
    return runpy.run_path(str(path))["rows"]()


def main(names: Sequence[str] = ()) -> int:
    """Print the table; return 1 if a verdict failed."""
    shown = Table("reference", "quantity", "unit", *("source", "truepose", "tolerance"), "verdict")
    failed, reasons = 0, []
    for name in names or folders():
        for k, row in enumerate(check(name)):
            figures = (f"{v:.9g}" for v in (row.printed, row.computed, row.tolerance))
            verdict, mark = row.verdict, ""
            if verdict in ("explained", "open"):
                reasons.append(row.explained)
                mark = f" [{len(reasons)}]"
            failed += verdict == "FAILED"
            shown.add_row(
                "" if k else name, row.quantity, row.unit, *figures, f"{verdict}{mark}",
                style=STYLE[verdict], end_section=False,
            )  # fmt: skip
        shown.add_section()
    console = Console(width=None if sys.stdout.isatty() else 150)
    console.print(shown)
    for k, reason in enumerate(reasons, 1):
        console.print(f"[{k}] {reason}", markup=False, highlight=False)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
