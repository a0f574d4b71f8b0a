"""The paper on one screen: Table 3, claims with their verdicts, and what other sensors give."""

from collections.abc import Collection
from dataclasses import replace

from rich.cells import cell_len

from truepose.show import Table
from truepose.show.terminal import printable
from truepose_paper import claims, tables
from truepose_paper.reproduce import Reproduction


def lines(result: Reproduction) -> list[str]:
    """Return 37 lines of 80 columns."""
    judged = claims.claims(result).columns(0, 1, 2, 3)
    header = ["claim", "printed", "found (± repeated runs)", "verdict"]
    return [
        *_table3(result),
        "Twin: fitted to Table 3. Robots: median [5, 95 %], assumed dimensions [1]; their",
        "encoder measures all of θ, the paper's missed 0.45° [2]. Reasons [1–3]: report.",
        *compact(replace(judged, header=header), left=range(4)),
        *compact(tables.sensors(result), left=(0, 5)),
    ]


def _table3(result: Reproduction) -> list[str]:
    table = tables.table3(result)
    names = ["paper", "twin", f"{len(result.experiment.truths)} robots"]
    rows = [[cell.replace(", ", ",") for cell in row] for row in table.rows]
    found = compact(Table("", "", ["(mm, °)", *names, *names], rows))
    usual, redundant = (found[0].index(" paper", start) for start in (0, found[0].index("twin")))
    first = "Table 3:".ljust(usual) + " usual control, estimated − measured"
    return [first.ljust(redundant) + " redundant control (TEJ)", *found]


def compact(table: Table, left: Collection[int] = (0,)) -> list[str]:
    """Return header and rows without title and rules, one blank between columns.

    The columns `left` begin at the left, the others end at the right.
    """
    columns: list[list[str]] = []
    for k, (name, *cells) in enumerate(zip(table.header, *table.rows, strict=True)):
        texts = [*map(printable, (name, *cells))]
        width = max(map(cell_len, texts))
        blanks = [" " * (width - cell_len(text)) for text in texts]
        pairs = zip(texts, blanks, strict=True)
        columns.append([text + blank if k in left else blank + text for text, blank in pairs])
    return [" ".join(row).rstrip() for row in zip(*columns, strict=True)]
