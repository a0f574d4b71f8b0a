"""Tables of results: each printed number is in the CSV that the page names."""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
#: A table and the files with its numbers: `<!-- results/NAME.csv -->` on the line before.
MARKED = re.compile(r"^<!-- ((?:\S+\.(?:csv|json) )+)-->\n+((?:\|.*\n)+)", re.MULTILINE)
#: A number: not part of a name ("q1", "H4"), thousands apart by blanks, no sign in a range.
NUMBER = re.compile(
    r"(?<![\w.^])(?<!\w-)(-?)(\d{1,3}(?:[ \u00a0\u202f]\d{3})+|\d+)(\.\d+)?(e-?\d+)?"
)
#: First line of a result that no command of this repository makes.
ELSEWHERE = "measured outside this repository"


@dataclass(frozen=True)
class Printed:
    """A number as it is printed."""

    value: float
    half: float  #: half a unit of its last digit

    def of(self, value: float) -> bool:
        """Return whether the value is printed so."""
        return abs(self.value - value) <= self.half * (1 + 1e-6)


def numbers(text: str) -> list[Printed]:
    """Return the numbers of a cell."""
    found = []
    for sign, whole, part, power in NUMBER.findall(text.replace("−", "-").replace("*", "")):
        digits = re.sub(r"\D", "", whole)
        value = float(sign + digits + part + power)
        half = 0.5 * 10.0 ** (int(power[1:] or 0) - max(len(part) - 1, 0))
        found.append(Printed(value, half))
    return found


def cells(line: str) -> list[str]:
    """Return the cells of a row in Markdown."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))]


def missing(table: str, rows: list[list[str]]) -> list[str]:
    """Return what a Markdown table prints and the rows of its CSV do not have.

    The head and first cells name premises. A row that the CSV has by the same first cell is
    compared with the CSV's rows of this name alone.
    """
    named: dict[str, list[float]] = {}
    for row in rows:
        named.setdefault(row[0].strip(), []).extend(n.value for cell in row for n in numbers(cell))
    every = [value for values in named.values() for value in values]
    lost = []
    for line in table.splitlines()[2:]:
        label, *others = cells(line)
        known = (label and named.get(label)) or every
        for cell in others:
            lost += [f"{label}: {cell}" for n in numbers(cell) if not any(map(n.of, known))]
    return lost


def pages() -> list[Path]:
    found = {ROOT / "README.md", *ROOT.glob("docs/**/*.md")}
    return sorted(
        {
            *found,
            *(
                page
                for at in (
                    "packages/*",
                    "packages/*/docs",
                    "robots/*",
                    "benchmarks",
                    "benchmarks/*",
                )
                for page in ROOT.glob(f"{at}/*.md")
            ),
        }
    )


def marked() -> list[tuple[Path, str, str]]:
    """Return the page, file and text of each table with a file."""
    return [
        (page, file, table)
        for page in pages()
        for file, table in MARKED.findall(page.read_text("utf-8") + "\n")
    ]


def read(file: str) -> tuple[str, list[list[str]]]:
    """Return the first line and rows of a file, named from docs/ or from the repository."""
    path = next(at for at in (ROOT / "docs" / file, ROOT / file) if at.exists())
    if path.suffix == ".json":  # instruction counts by compiler
        (counts,) = json.loads(path.read_text("utf-8")).values()
        return "", [[name, *map(str, each.values())] for name, each in counts.items()]
    lines = path.read_text("utf-8").splitlines()
    return lines[0], [row for row in csv.reader(x for x in lines if not x.startswith("#")) if row]


@pytest.mark.parametrize(
    ("page", "file", "table"), marked(), ids=lambda x: x.stem if isinstance(x, Path) else x[:30]
)
def test_a_table_prints_what_its_file_has(page, file, table):
    files = [read(each)[1] for each in file.split()]
    rows = files[0] if len(files) == 1 else [["", *row] for each in files for row in each]
    assert not missing(table, rows), f"{page.name}, {file}"


@pytest.mark.parametrize("file", sorted(RESULTS.glob("*.csv")), ids=lambda file: file.stem)
def test_a_result_names_the_command_that_made_it(run, file):
    first = read(f"results/{file.name}")[0]
    command, *premises = first.removeprefix("# ").split("; ")
    assert first.startswith("# ") and premises, first
    scripts = re.findall(r"[\w./-]+\.(?:py|c)\b", command)
    makes = re.findall(r"\bmake (?:-C (\S+) ?)?([a-z][a-z-]*)?", command)
    commands = re.findall(r"^truepose ([a-z-]+)", command)
    assert scripts or makes or commands or command == ELSEWHERE, first
    for script in scripts:
        assert (ROOT / script).exists(), script
    for folder, target in makes:
        targets = (ROOT / folder / "Makefile").read_text("utf-8")
        assert not target or re.search(rf"^{target}:|^\.PHONY:.* {target}\b", targets, re.M), target
    for name in commands:
        status, _, said = run(name, "--help")
        assert status == 0 or "pip install" in said, said  # a package's


@pytest.mark.parametrize("file", sorted(RESULTS.glob("*.csv")), ids=lambda file: file.stem)
def test_a_result_is_on_a_page(file):
    assert any(f"results/{file.name}" in page.read_text("utf-8") for page in pages())


def test_the_counts_of_control_cycles_are_those_of_the_list():
    (counts,) = json.loads((ROOT / "benchmarks" / "instructions.json").read_text("utf-8")).values()
    for cycle, *shown in read("results/cycle.csv")[1][1:]:
        robots, _, law = ("H4: " + cycle if ": " not in cycle else cycle).partition(": ")
        name = f"{robots.removeprefix('five ')} at work, {{}} {law}".replace(
            "fault monitor", "monitored"
        )
        found = [
            counts[name.format(level)][k]
            for level in ("ideal", "full")
            for k in ("median", "worst")
        ]
        expected = [f"{n / unit:.1f}" for unit in (1e3, 17e3) for n in found]
        assert shown == expected, cycle


@pytest.mark.parametrize(
    ("printed", "lost"),
    [
        ("| a | 1.06 [1.01, 1.11] | 9.0× | −3 % |", 0),
        ("| a | 1.07 | |", 1),  # 1.061 is 1.06
        ("| a | 1.1 | 1 605 150 |", 0),
        ("| b | 1.06 |", 1),  # a's
        ("| c | 1.06 to 9 | q1, H4, 7-UPS |", 1),  # of all rows: no 7
        ("| a | 4.9e-11 | **2** ± 0.5 |", 3),
    ],
)
def test_numbers_of_a_row(printed, lost):
    rows = [["", "mm"], ["a", "1.061 [1.01; 1.11]", "9", "-3", "1605150"], ["b", "5", "6.1"]]
    assert len(missing(f"| | mm |\n|---|---|\n{printed}\n", rows)) == lost
