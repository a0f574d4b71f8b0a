"""Completeness of the documentation: keys, commands, names; no dead link, nothing remote."""

import importlib.util
import inspect
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import truepose as tp
from absolute_links import absolute
from plain_english import banned, questions
from truepose.commands.cli import app
from truepose.robotfile.reading import SHORTHAND
from truepose.robotfile.schema import (
    Bar,
    CalibrationSection,
    Chain,
    Compliance,
    PassiveAxis,
    Pattern,
    Platform,
    Prices,
    PriceStep,
    RobotFile,
    Tolerance,
    Workspace,
)
from truepose.robotfile.sensors import SENSORS

SITE = Path(__file__).parents[2] / "docs" / "site"
ROOT = SITE.parents[1]
TABLES = (
    RobotFile,
    Chain,
    Bar,
    PassiveAxis,
    Platform,
    Workspace,
    Pattern,
    Compliance,
    Tolerance,
    PriceStep,
    Prices,
    CalibrationSection,
)


@pytest.fixture(scope="module")
def site():
    """The site's modules, as `python docs/site/make.py` has them."""
    sys.path.insert(0, str(SITE))
    yield {name: importlib.import_module(name) for name in ("make", "generate")}
    sys.path.remove(str(SITE))


@pytest.fixture(scope="module")
def reference(site) -> str:
    return site["generate"].robot_file()


def section(reference: str, anchor: str) -> str:
    """What the reference says of one table."""
    return reference.split(f"(key-{anchor})=")[1].split("\n(key-", maxsplit=1)[0]


@pytest.mark.parametrize("model", TABLES, ids=lambda model: model.__name__)
def test_the_reference_has_every_key_of_a_table(reference, model):
    told = section(reference, "top-level" if model is RobotFile else model.__name__.lower())
    for key, field in model.model_fields.items():
        (row,) = re.findall(rf"^\| `{key}` \|.*$", told, flags=re.MULTILINE)
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]
        assert all(cells), f"{key}: value, default and meaning are told"
        assert ("needed" in cells[2]) == field.is_required(), key


@pytest.mark.parametrize("kind", SENSORS)
def test_the_reference_has_every_key_of_a_sensor(reference, kind):
    model = SENSORS[kind]
    told = section(reference, "sensor") + section(reference, model.__name__.lower())
    assert f"`{kind}`" in told
    for key in model.model_fields:
        assert len(re.findall(rf"^\| `{key}` \|", told, flags=re.MULTILINE)) == 1, key


def test_the_reference_has_units_bounds_and_shorthand(reference):
    chain = section(reference, "chain")
    assert "| `arm` | number, m; > 0 | – |" in chain
    assert "| `eccentricity` | four numbers, rad; each > -0.1 and < 0.1 | `[0, 0, 0, 0]` |" in chain
    assert '| `actuator` | `"revolute"`, `"prismatic"`, `"telescopic"` | **needed** |' in chain
    assert all(f"| `{key}` |" in section(reference, "top-level") for key in SHORTHAND)


def commands(group, name: str):
    """Every command below a group: its full name, and what it takes."""
    yield name, group.params
    for sub in getattr(group, "commands", {}).values():
        yield from commands(sub, f"{name} {sub.name}")


@pytest.mark.parametrize("name, params", list(commands(typer.main.get_command(app), "truepose")))
def test_the_reference_has_every_command_and_option(site, name, params):
    text = f"# `truepose`\n{site['generate'].commands()}"
    told = re.split(rf"^#+ `{name}`$", text, flags=re.MULTILINE)[1].split("\n## ")[0]
    for param in params:
        for word in param.opts if param.param_type_name == "option" else [param.name]:
            assert re.search(rf"[`\s,]{word}[`\s,]", told), word


def test_the_reference_has_every_public_name(site):
    index, pages = site["generate"].python()
    first, told = next(iter(pages.values())), "".join(pages.values())
    assert re.findall(r"^## `([\w.]+)`$", first, flags=re.MULTILINE)[0] == "load"
    names = re.findall(r"^## `([\w.]+)`$", told, flags=re.MULTILINE)
    assert all(f"`{name}`" in index for name in names)
    modules = {name for name in tp.__all__ if inspect.ismodule(getattr(tp, name))}
    inner = {f"{room}.{name}" for room in modules for name in getattr(tp, room).__all__}
    assert set(names) == {*tp.__all__} - modules | inner
    for name in names:
        *room, last = name.split(".")
        where = ".".join(["truepose", *room])
        assert re.search(rf"currentmodule:: {where}\n\n.. auto\w+:: {last}\n", told), name


def pages() -> list[Path]:
    beside = ("*.md", "*/README.md", "robots/*/README.md", "reference/*/README.md")
    return sorted({*ROOT.glob("docs/**/*.md"), *(page for at in beside for page in ROOT.glob(at))})


@pytest.mark.parametrize("page", pages(), ids=lambda page: "/".join(page.parts[-2:]))
def test_no_link_between_files_is_dead(site, page):
    for link in site["make"].LINK.finditer(page.read_text(encoding="utf-8")):
        if "://" not in link[2]:
            assert (page.parent / link[2]).exists(), f"{page.name}: {link[0]}"


def test_links_between_files_become_links_between_pages(site, tmp_path):
    make, asked = site["make"], []
    source = make.DOCS / "x.md"
    text = "[a](model.md#two-levels) [c](no.md) "
    text += "[![b](../robots/h4/picture.png)](../robots/h4/README.md)"
    moved = make.relinked(text, source, "cpp/x.md", lambda file: asked.append(file) or "files/it")
    assert moved == "[a](../model.md#two-levels) [c](no.md) [![b](../files/it)](../robots/h4.md)"
    assert [file.name for file in asked] == ["picture.png"]


@pytest.mark.parametrize(
    "remote",
    [
        '<script src="https://example.org/mathjax.js"></script>',
        '<link rel="stylesheet" href="//example.org/font.css">',
        '<img src="http://example.org/picture.png">',
        "<style>@font-face { src: url(https://example.org/font.woff2) }</style>",
    ],
)
def test_what_a_page_loads_from_elsewhere_is_found(site, tmp_path, remote):
    page = tmp_path / "page.html"
    page.write_text('<a href="https://example.org">a link</a><img src="here.png">')
    assert not site["make"].from_network(tmp_path)
    page.write_text(remote)
    assert len(site["make"].from_network(tmp_path)) == 1


def shell(page: Path) -> list[str]:
    """Return the lines of a page's shell commands: indented, or in a block of sh."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = re.findall(r"^ {4}(\S.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    for block in re.findall(r"^```sh\n(.*?)^```", text, flags=re.M | re.S):
        lines += block.splitlines()
    return [line for line in lines if re.match(r"(truepose|make|cd|python3?|PYTHONPATH\S+) ", line)]


#: Commands of truepose that are run elsewhere, or that no test can run.
ELSEWHERE = {
    r"\btruepose workbench": "a server: integrations/workbench",
    r"\btruepose reproduce": "minutes: a stage of .ci/run",
    r"--install-completion": "changes the user's shell",
    r"--cluster tcp": "needs a cluster: test_study.py",
    r"…": "not written out",
}


@pytest.mark.parametrize(
    "page",
    [page for page in pages() if any(line.startswith("truepose ") for line in shell(page))],
    ids=lambda page: page.stem if page.stem != "README" else page.parent.name,
)
def test_commands_of_a_page_run_in_their_order(page, run, plain_page, tmp_path):
    for folder in ROOT.iterdir():  # paths from the repository's root
        if folder.is_dir() and not folder.name.startswith((".", "build")):
            (tmp_path / folder.name).symlink_to(folder)
    for line in shell(page):
        words = shlex.split(line, comments=True)
        if words[0] != "truepose" or any(re.search(each, line) for each in ELSEWHERE):
            continue
        if words[1] == "monte-carlo":
            words += ["--count", "1"]
        status, _, said = run(*words[1:])
        if "exists; --force" in said:  # another way to the same file
            status, _, said = run(*words[1:], "--force")
        missing = re.search(r"(\S+): cannot be read: No such file", said)  # the reader's own
        shown = said.removeprefix("truepose: error: ")[:60] in page.read_text(encoding="utf-8")
        given = missing is not None and missing[1] in " ".join(words)
        assert status == 0 or given or shown, f"{line}\n{said}"


def test_every_command_that_is_run_elsewhere_is_on_a_page():
    every = [line for page in pages() for line in shell(page)]
    assert all(any(re.search(each, line) for line in every) for each in ELSEWHERE)


#: Documented targets of make that no stage of .ci/run makes: tests that do the same, or why none.
TARGETS = {
    "reference": "tests/python/test_reference.py",
    "dev": "tests/python/test_make_dev.py",
    "page": "tests/python/deployments/test_page.py",
    "report": "minutes of statistics beside reproduce",
    "twin": "ten searches, minutes",
    "bench": "times on this machine",
    "bench-peers": "times on this machine",
    "wheel": "a release",
    "coverage": "minutes; a report",
    "coverage-python": "minutes; a report",
    "random-mutants": "minutes; drawn at random",
}


def test_every_documented_target_of_make_is_made_in_ci_or_has_a_reason():
    makefile, ci = ((ROOT / name).read_text(encoding="utf-8") for name in ("Makefile", ".ci/run"))
    made = set(re.findall(r'="make ([a-z-]+)', ci))
    for target in list(made):
        made |= set(re.search(rf"^{target}:(.*)$", makefile, re.M)[1].split())
    documented = set()
    for page in pages():
        text = "\n".join(shell(page) + re.findall(r"`(make [^`]*)`", page.read_text("utf-8")))
        for words in re.findall(r"\bmake((?: [a-z-]+)+)", re.sub(r" #.*", "", text)):
            documented |= set(words.split()) - {"-"}
    declared = set(re.findall(r"^([a-z-]+):", makefile, re.M))
    assert documented <= declared
    assert documented - made == set(TARGETS)
    files = [where for where in TARGETS.values() if where.endswith(".py")]
    assert all((ROOT / where).is_file() for where in files)


def scripts() -> dict[str, str]:
    """Return the documented Python scripts and modules with options, and those that pages give."""
    found: dict[str, str] = {}
    for page in pages():
        for line in shell(page):
            of = re.search(r"\bpython (-m pkm\.\w+|\S+\.py)(.*?)(?: #|$)", line)
            if of and (of[1].startswith("-m") or "argparse" in (ROOT / of[1]).read_text("utf-8")):
                found[of[1]] = found.get(of[1], "") + of[2]
    return found


@pytest.mark.parametrize("script", scripts())
def test_a_documented_script_has_the_options_of_its_pages(script):
    ran = subprocess.run(
        [sys.executable, *script.split(), "--help"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(["pkm-calibration", *sys.path])},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    for option in re.findall(r"(?<=\s)--[a-z-]+", scripts()[script]):
        assert option in ran.stdout


needs_sphinx = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("sphinx", "myst_nb", "furo", "breathe", "numpydoc"))),
    reason='needs pip install "truepose[docs]"; `make docs` makes the same checks',
)


@needs_sphinx
def test_the_site_is_built_without_a_warning_and_needs_no_network(site, tmp_path):
    built = tmp_path / "site"  # Sphinx warns of a page in no table of contents and of a dead anchor
    assert site["make"].main(str(built), str(tmp_path / "staged"), cpp=False) == 0
    assert not site["make"].from_network(built)
    names = {page.stem for page in (SITE.parents[1] / "docs").glob("*.md")}
    assert names <= {page.stem for page in built.glob("*.html")}
    equations = (built / "ten-minutes.html").read_text(encoding="utf-8")
    assert equations.count('<div class="equation"><svg') > 5


def test_on_a_package_index_the_readme_has_absolute_links_to_files_that_exist():
    text = (SITE.parents[1] / "README.md").read_text(encoding="utf-8")
    page = absolute(text, "https://host/truepose", "v1")
    links = re.findall(r"\]\(([^)\s]+)\)", page)
    own = [link for link in links if link.startswith("https://host/truepose/")]
    assert own and all(link.startswith(("https://", "#")) for link in links)
    for link in own:
        path = re.sub(r"https://host/truepose/(raw|blob)/v1/|#.*", "", link)
        assert (SITE.parents[1] / path).exists(), link


def test_headings_and_module_lines_state_their_subject():
    assert questions("# Why?\n\n## How\n", "md") == [1]
    assert questions('"""Does it work?"""\n', "py") == questions("// Why? So.\n", "hpp") == [1]
    assert questions('"""What works."""\nwhy = "?"\n', "py") == []


def test_banned_expressions_are_found_as_whole_words_but_not_in_a_pages_code():
    assert banned("A reading lies.\nHe applies `lies`, of what\n") == [(1, "lies"), (2, "of what")]
