"""Documentation: its commands run, its links work, its pages load nothing remote."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from absolute_links import absolute
from truepose.robotfile.reading import SHORTHAND

SITE = Path(__file__).parents[2] / "docs" / "site"
ROOT = SITE.parents[1]


@pytest.fixture(scope="module")
def site():
    """The site's modules, as `python docs/site/make.py` has them."""
    sys.path.insert(0, str(SITE))
    yield {name: importlib.import_module(name) for name in ("make", "generate")}
    sys.path.remove(str(SITE))


def test_the_reference_has_every_shorthand(site):
    assert all(f"| `{key}` |" in site["generate"].robot_file() for key in SHORTHAND)


def test_the_generated_pages_are_those_of_the_code(site):
    assert not site["generate"].stale(), "run python docs/site/generate.py"


def test_the_c_reference_has_every_function_and_type(site):
    page = site["generate"].c_reference()
    for header in site["generate"].C_HEADERS:
        text = (ROOT / header).read_text(encoding="utf-8")
        names = re.findall(r"TRUEPOSE_API[^;(]*?(truepose_\w+)\(|^\} (truepose_\w+);", text, re.M)
        lost = [name for found in names for name in found if name not in page]
        assert names and not lost


def pages() -> list[Path]:
    beside = ("*.md", "*/README.md", "robots/*/README.md", "benchmarks/**/README.md")
    return sorted({*ROOT.glob("docs/**/*.md"), *(page for at in beside for page in ROOT.glob(at))})


@pytest.mark.parametrize("page", pages(), ids=lambda page: "/".join(page.parts[-2:]))
def test_no_link_between_files_is_dead(site, page):
    for link in site["make"].LINK.finditer(page.read_text(encoding="utf-8")):
        if "://" not in link[2]:
            assert (page.parent / link[2]).exists(), f"{page.name}: {link[0]}"


def test_links_between_files_become_links_between_pages(site, tmp_path):
    make, asked = site["make"], []
    source = make.DOCS / "x.md"
    text = "[a](model.md#two-levels) [c](no.md) [d](../robots/) "
    text += "[![b](../robots/h4/picture.png)](../robots/h4/README.md)"
    moved = make.relinked(text, source, "cpp/x.md", lambda file: asked.append(file) or "files/it")
    assert moved == "[a](../model.md#two-levels) [c](no.md) d [![b](../files/it)](../robots/h4.md)"
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
    r"\btruepose klipper": "packages/printers",
    r"\btruepose workbench": "a server: packages/workbench",
    r"\btruepose reproduce": "minutes: packages/paper",
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


def test_every_documented_target_of_make_exists():
    for page in (page for page in pages() if page.name != "CHANGELOG.md"):  # of today
        text = "\n".join(shell(page) + re.findall(r"`(make [^`]*)`", page.read_text("utf-8")))
        for words in re.findall(r"\bmake((?: [a-z-]+)+)", re.sub(r" #.*", "", text)):
            targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M)
            assert {*words.split()} <= {*targets, "-"}, page.name


def scripts() -> dict[str, str]:
    """Return the documented Python scripts and modules with options, and those that pages give.

    Without those of packages, and without the generator of pkm-calibration, which needs MuJoCo.
    """
    found: dict[str, str] = {}
    for page in pages():
        for line in shell(page):
            of = re.search(r"\bpython (-m pkm\.\w+|\S+\.py)(.*?)(?: #|$)", line)
            if of and re.match(r"packages/|-m pkm\.generate", of[1]):
                continue
            if of and (
                of[1].startswith("-m")
                or re.search(r"argparse|\barguments\(", (ROOT / of[1]).read_text("utf-8"))
            ):
                found[of[1]] = found.get(of[1], "") + of[2]
    return found


@pytest.mark.parametrize("script", scripts())
def test_a_documented_script_has_the_options_of_its_pages(script):
    ran = subprocess.run(
        [sys.executable, *script.split(), "--help"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(["benchmarks/pkm-calibration", *sys.path])},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    for option in re.findall(r"(?<=\s)--[a-z-]+", scripts()[script]):
        assert option in ran.stdout


needs_sphinx = pytest.mark.skipif(
    not all(
        map(importlib.util.find_spec, ("sphinx", "myst_parser", "furo", "breathe", "numpydoc"))
    ),
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
    assert '<div class="equation"><svg' in equations


def test_on_a_package_index_the_readme_has_absolute_links_to_files_that_exist():
    text = (SITE.parents[1] / "README.md").read_text(encoding="utf-8")
    page = absolute(text, "https://host/truepose", "v1")
    links = re.findall(r"\]\(([^)\s]+)\)", page)
    own = [link for link in links if link.startswith("https://host/truepose/")]
    assert own and all(link.startswith(("https://", "#")) for link in links)
    for link in own:
        path = re.sub(r"https://host/truepose/(raw|blob)/v1/|#.*", "", link)
        assert (SITE.parents[1] / path).exists(), link
