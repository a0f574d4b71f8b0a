"""Pages that follow from the code: commands, names, robots, keys of a robot file, C headers.

`python docs/site/generate.py` writes them into docs/, each below the mark that ends its own text.
With `--check` it only names the pages that differ, and fails if there is one.
"""

from __future__ import annotations

import ast
import enum
import importlib
import inspect
import itertools
import operator
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import c_header

import truepose
from truepose.robotfile import reading, sensors
from truepose.robotfile.schema import RobotFile

ROOT = Path(__file__).parents[2]
DOCS, SOURCES = ROOT / "docs", ROOT / "src"
#: What stands below it in a page is generated.
MARK = "<!-- Generated below this line: python docs/site/generate.py -->"
#: Rooms of the library, each on the ones before it.
ROOMS = ("math", "mechanism", "estimation", "control", "c", "calibration", "simulation", "python")
#: Public headers: of C for controllers, for computers without a deadline, of the package safety;
#: and of C++.
C_HEADERS = (
    "include/truepose/truepose.h",
    "include/truepose/calibrate.h",
    "packages/safety/include/truepose_safety.h",
)
CPP_HEADERS = ("truepose.hpp", "status.hpp", "sizes.hpp")

#: Words for the types of a JSON schema.
WORDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
COUNTS = {2: "two", 3: "three", 4: "four", 6: "six"}
#: A number whose square is one too: the schema's own bound, which says nothing of a robot.
HUGE = 1e12


def robot_file() -> str:
    """Every key of every table of a robot file, from its schema."""
    schema = RobotFile.model_json_schema()
    tables = schema["$defs"]
    top = schema | {"properties": dict(schema["properties"])}
    for key, what in reading.SHORTHAND.items():
        top["properties"][key] = {"description": what, "default": None, "type": "string"}
    for name in ("Chain", "Motor"):
        top["properties"][f"{name.lower()}_defaults"]["$ref"] = name
    top["properties"]["units"] |= {"type": "array", "items": {"type": "string"}}
    kinds = {model.__name__: tables[model.__name__] for model in sensors.SENSORS.values()}
    text = "\n".join(_table("Top level", top, tables))
    for name, table in tables.items():
        if name not in kinds:
            text += "\n".join(_table(_title(name), table, tables))
    return text + _sensors(kinds, tables)


def _sensors(kinds: dict[str, dict], tables: dict) -> str:
    """The keys that all sensors share, then each kind's own."""
    first, *others = (kind["properties"] for kind in kinds.values())
    shared = [key for key in first if all(other.get(key) == first[key] for other in others)]
    every = next(iter(kinds.values())) | {
        "description": "A sensor is one number, gain * value - offset. `kind` says which keys it "
        "has beside these.",
        "properties": {key: first[key] for key in shared},
    }
    text = "\n".join(_table("`[[sensor]]`", every, tables))
    for name in sorted(kinds, key=list(tables).index):
        kind = kinds[name]["properties"]["kind"]
        title = ", ".join(f"`{value}`" for value in kind.get("enum") or [kind["const"]])
        own = {key: field for key, field in kinds[name]["properties"].items() if key not in shared}
        own = {"kind": own.pop("kind")} | own
        table = kinds[name] | {"properties": own}
        text += "\n".join(_table(title, table, tables, "###"))
    return text


def _title(name: str) -> str:
    """Heading of a table, by where the file has it."""
    places = {
        "Chain": "`[[chain]]`, `[chain_defaults]`",
        "Body": "`[[body]]`",
        "Closure": "`[[closure]]`",
        "Motor": "`[[motor]]`, `[motor_defaults]`",
        "Bar": "`[[bar]]`",
        "Workspace": "`[workspace]`, `[fkm_region]`",
        "Tolerance": "`[tolerances]`: of each parameter",
        "PassiveAxis": "`[[passive_axis]]`",
        "CalibrationSection": "`[calibration]`",
    }
    return places.get(name, f"`[{name.lower()}]`")


def _anchor(title: str) -> str:
    """Where a link finds a heading, on a forge and in the site."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _table(title: str, table: dict, tables: dict, heading: str = "##") -> Iterator[str]:
    yield f"\n{heading} {title}\n"
    yield " ".join(inspect.cleandoc(table.get("description", "")).split()) + "\n"
    yield "| key | value | default | meaning |\n|---|---|---|---|"
    for key, field in table["properties"].items():
        needed = key in table.get("required", ())
        default = "**needed**" if needed else _default(field, tables)
        yield f"| `{key}` | {_value(field, tables)} | {default} | {_cell(field['description'])} |"
    yield ""


def _value(field: dict, tables: dict) -> str:
    """Type, unit and bounds of a key, in words."""
    words, unit, bounds = _kind(field, tables)
    return _cell("; ".join(filter(None, [f"{words}, {unit}" if unit else words, bounds])))


def _kind(field: dict, tables: dict) -> tuple[str, str, str]:
    """Words, unit and bounds of a schema."""
    arms = [arm for arm in field.get("anyOf", ()) if arm.get("type") != "null"]
    if arms:
        return _kind(arms[0] | {k: v for k, v in field.items() if k == "unit"}, tables)
    unit, bounds = field.get("unit", ""), _bounds(field)
    if "$ref" in field:
        return f"[table](#{_anchor(_title(field['$ref'].split('/')[-1]))})", "", ""
    if "enum" in field or "const" in field:
        values = field.get("enum") or [field["const"]]
        marks = [f"`{value}`" if field["type"] == "integer" else f'`"{value}"`' for value in values]
        return ", ".join(marks), unit, ""
    if field["type"] == "array":
        if "discriminator" in field.get("items", {}):
            return "[tables](#sensor)", "", ""
        items = field.get("prefixItems") or [field["items"]]
        words, of_item, bounds = _kind(items[0], tables)
        many = COUNTS[len(items)] if "prefixItems" in field else "list of"
        plural = words if words.startswith("list") or words == "text" else _plural(words)
        return f"{many} {plural}", unit or of_item, f"each {bounds}" if bounds else ""
    if field["type"] == "object":
        inner = field.get("additionalProperties")
        words, of_item, bounds = _kind(inner, tables)
        return f"by name: {words}", unit or of_item, bounds
    return WORDS[field["type"]], unit, bounds


def _plural(words: str) -> str:
    """Of `number`, or of a link to a table."""
    return words.replace("table]", "tables]") if "table]" in words else f"{words}s"


def _bounds(field: dict) -> str:
    signs = {
        "minimum": "≥",
        "exclusiveMinimum": ">",
        "maximum": "≤",
        "exclusiveMaximum": "<",
    }
    given = ((sign, field[key]) for key, sign in signs.items() if key in field)
    return " and ".join(f"{sign} {value:g}" for sign, value in given if abs(value) < HUGE)


def _default(field: dict, tables: dict) -> str:
    value = field.get("default")
    if value in (None, "", [], {}) or isinstance(value, dict):
        return "–"
    if isinstance(value, list) and all(isinstance(v, float | int) for v in value):
        return "`[" + ", ".join(f"{v:g}" for v in value) + "]`"
    if isinstance(value, bool | str):
        return f"`{str(value).lower()}`" if isinstance(value, bool) else f'`"{value}"`'
    return f"`{value:g}`"


def _cell(text: str) -> str:
    """Text in a Markdown table: a bar would end the cell."""
    return text.replace("|", "\\|")


def robots() -> str:
    """A picture and a line for every shipped robot."""
    text = "| picture | robot |\n|---|---|\n"
    for name in truepose.list_robots():
        robot = reading.read(name)
        folder = f"../robots/{name}"
        text += f"| [![{name}]({folder}/picture.png)]({folder}/README.md) "
        text += f"| [{name}]({folder}/README.md): {robot.title or name}. `{robot.mobility}`, "
        text += f"{robot.n} motors, sensors in use: {', '.join(robot.sensors) or 'none'}. |\n"
    return text


def commands() -> str:
    """The core's commands with their help and options; the packages' in a line each."""
    import typer
    from typer.cli import get_docs_for_click

    from truepose.commands.cli import app

    command = typer.main.get_command(app)
    _in_full(command)
    text = get_docs_for_click(obj=command, ctx=typer.Context(command), name="truepose")
    text = text.split("\n", 1)[1]  # the page has a title of its own
    text = re.sub(r"^\$ ", "", text, flags=re.MULTILINE).replace("```console", "```text")
    text = re.sub(r"\*\*(truepose [^*]*)\*\*", r"`\1`", text)
    return f"{text.rstrip()}\n\n## Commands of packages\n\n{_of_packages()}"


def _in_full(group) -> None:
    """Leave the core's commands; give them whole sentences in lists, and every option."""
    for name, command in list(group.commands.items()):
        command.short_help = command.get_short_help_str(limit=1000)
        for parameter in command.params:
            parameter.hidden = False
        if hasattr(command, "commands"):
            _in_full(command)
            of_package = not command.commands
        else:
            of_package = command.hidden or "truepose." not in command.callback.__module__
        if of_package:
            del group.commands[name]


def _of_packages() -> str:
    """The first line of each package's commands, from its sources: it need not be installed."""
    text = "| command | package | |\n|---|---|---|\n"
    for file in sorted(ROOT.glob("packages/*/pyproject.toml")):
        points = tomllib.loads(file.read_text(encoding="utf-8"))["project"].get("entry-points", {})
        for name, where in points.get("truepose.commands", {}).items():
            module, _, function = where.partition(":")
            source = file.parent / "src" / f"{module.replace('.', '/')}.py"
            what = _first_line(source.read_text(encoding="utf-8"), function)
            link = f"[{file.parent.name}](../packages/{file.parent.name}/README.md)"
            text += f"| `truepose {name.replace('.', ' ')}` | {link} | {what} |\n"
    return text


def _first_line(source: str, name: str) -> str:
    """The first line of a function's docstring, or the help of a group of commands."""
    for one in ast.parse(source).body:
        if getattr(one, "name", "") == name:
            return (ast.get_docstring(one) or "").splitlines()[0]
    return re.search(rf'^{name} = .*help="([^"]*)"', source, re.MULTILINE)[1]


#: Of the Python reference, those that come first.
SUBJECTS = ("robot", "simulation", "calibration")


def public() -> dict[str, list[str]]:
    """Public names, below `truepose`, by the submodule where they live."""
    names: dict[str, list[str]] = {}
    for name in truepose.__all__:
        thing = getattr(truepose, name)
        if inspect.ismodule(thing):
            names.setdefault(name, []).extend(f"{name}.{inner}" for inner in thing.__all__)
        else:
            names.setdefault(thing.__module__.split(".")[1], []).append(name)
    rooms = sorted(names, key=lambda room: (*SUBJECTS, room).index(room))
    return {room: sorted(names[room], key=lambda name: name != "load") for room in rooms}


def _subject(room: str) -> str:
    what = inspect.getdoc(importlib.import_module(f"truepose.{room}")) or room
    return what.splitlines()[0].rstrip(".")


def python() -> str:
    """Every public name with its signature and first line, and the methods of classes."""
    text = ""
    for room, names in public().items():
        text += f"\n## {_subject(room)}\n\n"
        for name in names:
            thing = operator.attrgetter(name)(truepose)
            text += f"- `tp.{name}{_signature(thing)}`: {_first(thing)}\n"
            for method, of in _methods(thing):
                text += f"  - `.{method}{_signature(of)}`: {_first(of)}\n"
    return text.lstrip()


def _methods(thing) -> Iterator[tuple[str, object]]:
    """Public methods and properties of a class, by truepose and with a docstring."""
    if not isinstance(thing, type) or issubclass(thing, Exception | enum.Enum):
        return
    own = (one for one in reversed(thing.__mro__) if one.__module__.startswith("truepose"))
    for name, member in sorted({k: v for one in own for k, v in vars(one).items()}.items()):
        of = getattr(member, "__func__", getattr(member, "func", member))
        if name[0] != "_" and (callable(of) or isinstance(of, property)) and inspect.getdoc(of):
            yield name, of


def _first(thing) -> str:
    """The first paragraph of a docstring."""
    paragraph = (inspect.getdoc(thing) or "").split("\n\n")[0]
    paragraph = re.sub(r":\w+:`(?:\.?truepose\.)?([^`]*)`", r"`\1`", paragraph)
    return " ".join(paragraph.replace("``", "`").split())


def _signature(thing) -> str:
    """Names and short defaults of the parameters, without types."""
    try:
        given = inspect.signature(thing).parameters.values()
    except (TypeError, ValueError):
        return ""
    if isinstance(thing, type) and issubclass(thing, Exception | enum.Enum):
        return ""
    shown = []
    for one in given:
        long = one.default is not one.empty and len(repr(one.default)) > 20
        if one.name != "self":
            shown.append(
                str(one.replace(annotation=one.empty, default="…" if long else one.default))
            )
    keywords = [one for one in given if one.name != "self" and one.kind == one.KEYWORD_ONLY]
    if keywords and not any(one.kind == one.VAR_POSITIONAL for one in given):
        shown.insert(len(shown) - len(keywords), "*")
    return f"({', '.join(shown)})".replace("'…'", "…").replace("<factory>", "…")


def python_pages() -> dict[str, str]:
    """In the site, a page of docstrings in full for each subject."""
    pages = {}
    for room, names in public().items():
        page = f"# {_subject(room)}\n"
        for name in names:
            page += f"\n## `{name}`\n\n```{{eval-rst}}\n{_directive(name)}\n```\n"
        pages[f"python/{room}.md"] = page
    return pages


def _directive(name: str) -> str:
    thing = operator.attrgetter(name)(truepose)
    kind = "function"
    if isinstance(thing, type):
        kind = "exception" if issubclass(thing, Exception) else "class"
    members = "\n   :members:\n   :inherited-members: Exception, tuple" if kind == "class" else ""
    *room, last = name.split(".")
    where = ".".join(["truepose", *room])
    return f".. currentmodule:: {where}\n\n.. auto{kind}:: {last}{members}"


def cpp_page(doxygen: bool) -> str:
    """In the site, the public C++ headers as Doxygen reads them, and the internal ones."""
    files = "\n".join(f".. doxygenfile:: {name}" for name in CPP_HEADERS)
    missing = "*Built without doxygen: the reference itself is left out.*"
    return f"""# C++ reference

`#include "truepose/truepose.hpp"`, namespace `truepose`: every class and function of the public
headers, from their comments. Nothing allocates, locks or throws.
Examples: [truepose in C++](cpp.md).

{f"```{{eval-rst}}{chr(10)}{files}{chr(10)}```" if doxygen else missing}

## Internal headers

They are not installed and may change in any version. [Architecture](architecture.md) describes
their folders.
{internal_headers()}"""


def internal_headers() -> str:
    """Every internal header and its subject, by room."""
    text = ""
    for room in ROOMS:
        text += f"\n`src/{room}`\n\n"
        for header in sorted((SOURCES / room).glob("*.hpp")):
            text += f"- `{header.name}`: {_comment(header)}\n"
    return text


def _comment(header: Path) -> str:
    """The paragraph that a header begins with: its subject."""
    comment = itertools.takewhile(
        lambda line: line.startswith("// "), header.read_text(encoding="utf-8").splitlines()
    )
    return " ".join(line.removeprefix("// ") for line in comment)


def c_reference() -> str:
    """Types and functions of the C headers, from their comments."""
    return "\n".join(
        c_header.reference(header, (ROOT / header).read_text(encoding="utf-8"))
        for header in C_HEADERS
    )


#: The pages, by the functions that make them.
PAGES = {
    "cli.md": commands,
    "python.md": python,
    "robots.md": robots,
    "robot-file-keys.md": robot_file,
    "c-reference.md": c_reference,
}


def stale() -> dict[Path, str]:
    """Return the pages that differ from the code, with the text that they should have."""
    found = {}
    for name, generated in PAGES.items():
        page = DOCS / name
        text = page.read_text(encoding="utf-8")
        renewed = f"{text.split(MARK)[0].rstrip()}\n\n{MARK}\n\n{generated().strip()}\n"
        if text != renewed:
            found[page] = renewed
    return found


def main(*options: str) -> int:
    """Write the pages, or with --check name those that differ."""
    check = "--check" in options
    found = stale()
    for page, text in found.items():
        if check:
            print(f"docs/{page.name} differs from the code: run python docs/site/generate.py")
        else:
            page.write_text(text, encoding="utf-8")
            print(f"docs/{page.name}")
    return int(check and bool(found))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
