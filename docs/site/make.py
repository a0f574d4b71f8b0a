"""Build of the site from docs/. `python docs/site/make.py [FOLDER]`; `make docs` calls it.

The pages are staged in build/site: those of docs/, those that live beside what they describe
(benchmarks, examples, reference results, robots, packages, changes), and references in full of
Python and C++. Links between files become links between pages, the table of docs/index.md the
table of contents. Then Sphinx runs, whose warnings are errors, and a check that the pages load
nothing from the network.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from os.path import relpath
from pathlib import Path
from textwrap import dedent

import generate

ROOT = Path(__file__).parents[2]
DOCS, SITE = ROOT / "docs", ROOT / "docs" / "site"

#: A Markdown link or image to a file: text, path, anchor.
LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\[\]]*\])*\])\(([^()\s#:]+)(#[^()\s]*)?\)")


#: Pages under another one in the table of contents.
UNDER = {
    "cli.md": "packages/*/readme",
    "contributing.md": "security",
    "cpp.md": "cpp-reference",
    "python.md": "python/*",
    "reference-results.md": "references/*",
    "robots.md": "robots/*",
}
#: Tables of their own style, by their headings.
STYLES = {"| key | value | default |": "{.keys}", "| picture | robot |": "{.robots}"}
#: An indented block, and the first line of one with shell commands.
INDENTED = re.compile(r"(?<=\n\n)(?: {4}.*\n+)+")
COMMAND = re.compile(
    r" {4}(?:truepose|make|cd|python3?|pip|git|export|cmake|cp) |[A-Z_]+=| {4}\.venv/"
)

#: A doctest that ends with an empty line, as doctest wants it and a page does not.
ENDED = re.compile(r"(^( *)```python\n(?:(?!```).)*?)\n+\2```$", re.DOTALL | re.MULTILINE)


def pages() -> dict[Path, str]:
    """Every page's source, and where in the site it stands."""
    beside = {
        "README.md": "index.md",
        "CHANGELOG.md": "changelog.md",
        "CONTRIBUTING.md": "contributing.md",
        "SECURITY.md": "security.md",
        "benchmarks/README.md": "benchmarks.md",
        "examples/README.md": "examples.md",
        "benchmarks/pkm-calibration/README.md": "pkm-calibration.md",
        "benchmarks/reference/README.md": "reference-results.md",
    }
    found = {ROOT / source: target for source, target in beside.items()}
    found |= {
        robot: f"robots/{robot.parent.name}.md"
        for robot in sorted((ROOT / "robots").glob("*/README.md"))
    }
    found |= {
        page: f"references/{page.parent.name}.md"
        for page in sorted((ROOT / "benchmarks" / "reference").glob("*/README.md"))
    }
    found |= {page: f"packages/{page.name}" for page in sorted(ROOT.glob("packages/*/docs/*.md"))}
    found |= {
        page: f"packages/{page.parent.name}/readme.md"
        for page in sorted(ROOT.glob("packages/*/README.md"))
    }
    own = sorted([*DOCS.glob("*.md"), *DOCS.glob("guides/*.md")])
    return found | {page: page.relative_to(DOCS).as_posix() for page in own}


def relinked(text: str, source: Path, target: str, copy: Callable[[Path], str]) -> str:
    """Make links between files links between pages.

    `copy` says where a file that is no page stands in the site. A link to a folder becomes its
    text. A link that leads nowhere stays as it is, for Sphinx to report.
    """
    known = pages()

    def moved(link: re.Match) -> str:
        to = (source.parent / link[2]).resolve()
        text = link[1][0] + LINK.sub(moved, link[1][1:])  # an image may be the text of a link
        if to.is_dir() and not (to / "README.md").is_file():
            return text[1:-1]  # a folder is no page
        to = to / "README.md" if to.is_dir() else to
        if not to.is_file() or not to.is_relative_to(ROOT):
            return text + link[0][len(link[1]) :]
        there = known.get(to) or copy(to)
        return f"{text}({relpath(there, Path(target).parent)}{link[3] or ''})"

    return LINK.sub(moved, text)


def contents(*pages: str, caption: str = "") -> str:
    """A hidden table of contents."""
    options = ":hidden:\n:glob:\n" + f":caption: {caption}\n" * bool(caption)
    return f"\n```{{toctree}}\n{options}\n" + "\n".join(pages) + "\n```\n"


def staged(text: str, target: str) -> str:
    """A page as Sphinx reads it: with tables of contents, styles, and languages of code."""
    if target == "index.md":  # each row of its table is a part
        for caption, row in re.findall(r"^\| \*\*(.*?)\*\* \|(.*)", text, re.MULTILINE):
            links = [link[2].removesuffix(".md") for link in LINK.finditer(row)]
            text += contents(*links, caption=caption)
    if target in UNDER:
        text += contents(UNDER[target])
    for heading, style in STYLES.items():
        text = text.replace(heading, f"{style}\n{heading}")
    text = ENDED.sub(r"\1\n\2```", text)
    return INDENTED.sub(_in_shell, text)


def _in_shell(block: re.Match) -> str:
    """An indented block, marked as shell if it begins with a command."""
    if not COMMAND.match(block[0]):
        return block[0]
    return f"```sh\n{dedent(block[0]).strip()}\n```\n\n"


def stage(out: Path, doxygen: bool) -> None:
    """Write the pages as Sphinx reads them; what has not changed stays as it is."""
    written = set()

    def write(name: str, data: bytes) -> None:
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_bytes() != data:
            path.write_bytes(data)
        written.add(path)

    def copy(file: Path) -> str:
        name = f"files/{file.relative_to(ROOT).as_posix()}"
        write(name, file.read_bytes())
        return name

    for source, target in pages().items():
        if source != ROOT / "README.md":  # docs/index.md takes its place
            text = relinked(source.read_text(encoding="utf-8"), source, target, copy)
            write(target, staged(text, target).encode())
    full = generate.python_pages() | {"cpp-reference.md": generate.cpp_page(doxygen)}
    for name, text in full.items():
        write(name, text.encode())
    for old in set(out.rglob("*")) - written:
        if old.is_file():
            old.unlink()


def doxygen(folder: Path) -> bool:
    """Have Doxygen write its XML of the headers, if there is a doxygen."""
    if not shutil.which("doxygen"):
        print("docs: without the C++ reference, doxygen is not installed (Debian: doxygen)")
        return False
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    settings = (DOCS / "Doxyfile").read_text(encoding="utf-8")
    settings += f"\nOUTPUT_DIRECTORY={folder}\nGENERATE_XML=YES\nGENERATE_HTML=NO\n"
    subprocess.run(["doxygen", "-"], input=settings, text=True, cwd=ROOT, check=True)
    return True


class _Loads(HTMLParser):
    """Collects the addresses that a browser loads of itself."""

    def __init__(self):
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag == "link" and not {"stylesheet", "icon", "preload"} & set(given["rel"].split()):
            return  # says where a page is
        for name in ("src", "srcset", "poster", "data", "href"):
            if name in given and not (name == "href" and tag not in ("link", "use", "image")):
                self.found += [part.split()[0] for part in given[name].split(",") if part.strip()]


def from_network(site: Path) -> list[str]:
    """Pages and styles that load something from elsewhere: `file: address`."""
    wrong = []
    for file in sorted([*site.rglob("*.html"), *site.rglob("*.css")]):
        text = file.read_text(encoding="utf-8")
        loads = _Loads()
        if file.suffix == ".html":
            loads.feed(text)
        found = loads.found + re.findall(r"""(?:url\(|@import)\s*["']?([^"')]+)""", text)
        remote = [at for at in found if re.match(r"(?i)\s*(https?:)?//", at)]
        wrong += [f"{file.relative_to(site)}: {at}" for at in remote]
    return wrong


def main(folder: str = "build/docs", staged: str = "build/site", cpp: bool = True) -> int:
    """Build the site; 0 if there is nothing to complain of."""
    source, work = Path(staged, "source"), Path(staged).resolve()
    stage(source, cpp and doxygen(work / "doxygen"))
    # -E: a page that has not changed is read again, or its warnings would be told once only
    command = [sys.executable, "-m", "sphinx", "-E", "-W", "--keep-going", "-q", "-b", "html"]
    command += ["-c", SITE, "-d", work / "doctrees", source, folder]
    command += ["-D", f"breathe_projects.truepose={work / 'doxygen' / 'xml'}"]
    status = subprocess.run(command, check=False).returncode
    page = ROOT / "build/page/truepose.html"  # by `make page`
    if page.is_file():
        shutil.copy(page, folder)
    for wrong in from_network(Path(folder)):
        print(f"docs: {wrong}: is not loaded from the site itself")
        status = 1
    if status == 0:
        print(f"docs: {folder}/index.html")
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
