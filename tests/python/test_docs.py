"""Completeness of the documentation: keys, commands, names; no dead link, nothing remote."""

import importlib.util
import inspect
import re
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
    root = SITE.parents[1]
    beside = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "*/README.md", "robots/*/README.md")
    return sorted({*root.glob("docs/**/*.md"), *(page for at in beside for page in root.glob(at))})


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
