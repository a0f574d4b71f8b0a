"""Parts of the documentation that follow from the code: keys, commands, names.

Each function gives a page's text in Markdown; `make.py` puts it where the page includes it.
"""

from __future__ import annotations

import importlib
import inspect
import itertools
import operator
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import truepose
from truepose.robotfile import reading, sensors
from truepose.robotfile.schema import RobotFile

SOURCES = Path(__file__).parents[2] / "src"
#: Rooms of the library, each on the ones before it.
ROOMS = ("math", "mechanism", "estimation", "control", "c", "calibration", "simulation", "python")
#: Public headers: of C for controllers, for computers without a deadline, of the package safety;
#: and of C++.
C_HEADERS = ("truepose.h", "calibrate.h", "truepose_safety.h")
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
    text = "\n".join(_table("Top level", "top-level", top, tables))
    for name, table in tables.items():
        if name not in kinds:
            text += "\n".join(_table(*_titles(name), table, tables))
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
    text = "\n".join(_table("`[[sensor]]`", "sensor", every, tables))
    for name in sorted(kinds, key=list(tables).index):
        kind = kinds[name]["properties"]["kind"]
        title = ", ".join(f"`{value}`" for value in kind.get("enum") or [kind["const"]])
        own = {key: field for key, field in kinds[name]["properties"].items() if key not in shared}
        own = {"kind": own.pop("kind")} | own
        table = kinds[name] | {"properties": own}
        text += "\n".join(_table(title, name.lower(), table, tables, "###"))
    return text


def _titles(name: str) -> tuple[str, str]:
    """Heading and anchor of a table, by where the file has it."""
    places = {
        "Chain": "`[[chain]]`, `[chain_defaults]`",
        "Body": "`[[body]]`",
        "Closure": "`[[closure]]`",
        "Motor": "`[[motor]]`, `[motor_defaults]`",
        "Bar": "`[[bar]]`",
        "Workspace": "`[workspace]`, `[fkm_region]`",
        "Tolerance": "`[tolerances]`: of each parameter",
        "Prices": "`[prices]`",
    }
    return places.get(name, f"`[{name.lower()}]`"), name.lower()


def _table(
    title: str, anchor: str, table: dict, tables: dict, heading: str = "##"
) -> Iterator[str]:
    yield f"\n(key-{anchor})=\n{heading} {title}\n"
    yield " ".join(inspect.cleandoc(table.get("description", "")).split()) + "\n"
    yield "{.keys}\n| key | value | default | meaning |\n|---|---|---|---|"
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
        name = field["$ref"].split("/")[-1]
        return f"[table](#key-{name.lower()})", "", ""
    if "enum" in field or "const" in field:
        values = field.get("enum") or [field["const"]]
        marks = [f"`{value}`" if field["type"] == "integer" else f'`"{value}"`' for value in values]
        return ", ".join(marks), unit, ""
    if field["type"] == "array":
        if "discriminator" in field.get("items", {}):
            return "[tables](#key-sensor)", "", ""
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
    text = "{.robots}\n| | |\n|---|---|\n"
    for name in truepose.list_robots():
        robot = reading.read(name)
        folder = f"../robots/{name}"
        text += f"| [![{name}]({folder}/picture.png)]({folder}/README.md) "
        text += f"| [{name}]({folder}/README.md): {robot.title or name}. `{robot.mobility}`, "
        text += f"{robot.n} motors, sensors in use: {', '.join(robot.sensors) or 'none'}. |\n"
    return text


def commands() -> str:
    """Every command's help and options, from the command line's own description."""
    import typer
    from typer.cli import get_docs_for_click

    from truepose.commands.cli import app

    command = typer.main.get_command(app)
    _in_full(command)
    text = get_docs_for_click(obj=command, ctx=typer.Context(command), name="truepose")
    text = text.split("\n", 1)[1]  # the page has a title of its own
    return re.sub(r"^\$ ", "", text, flags=re.MULTILINE).replace("```console", "```text")


def _in_full(group) -> None:
    """Let lists of commands have their first sentences whole, and pages every option."""
    for command in getattr(group, "commands", {}).values():
        command.short_help = command.get_short_help_str(limit=1000)
        for parameter in command.params:
            parameter.hidden = False
        _in_full(command)


#: Of the Python reference, those that come first.
ROOMS = ("robot", "simulation", "calibration")


def public() -> dict[str, list[str]]:
    """Public names, below `truepose`, by the submodule where they live."""
    names: dict[str, list[str]] = {}
    for name in truepose.__all__:
        thing = getattr(truepose, name)
        if inspect.ismodule(thing):
            names.setdefault(name, []).extend(f"{name}.{inner}" for inner in thing.__all__)
        else:
            names.setdefault(thing.__module__.split(".")[1], []).append(name)
    return names


def python() -> tuple[str, dict[str, str]]:
    """Every public name: a list of the subjects, and a page for each submodule."""
    names, text, pages = public(), "", {}
    rooms = sorted(names, key=lambda room: (*ROOMS, room).index(room))
    for room in rooms:
        what = inspect.getdoc(importlib.import_module(f"truepose.{room}")) or room
        subject = what.splitlines()[0].rstrip(".")
        listed = sorted(names[room], key=lambda name: name != "load")
        text += f"- [{subject}](python/{room}.md): {', '.join(f'`{name}`' for name in listed)}\n"
        page = f"# {subject}\n"
        for name in listed:
            page += f"\n## `{name}`\n\n```{{eval-rst}}\n{_directive(name)}\n```\n"
        pages[f"python/{room}.md"] = page
    places = "\n".join(f"python/{room}" for room in rooms)
    return f"{text}\n```{{toctree}}\n:hidden:\n\n{places}\n```\n", pages


def _directive(name: str) -> str:
    thing = operator.attrgetter(name)(truepose)
    kind = "function"
    if isinstance(thing, type):
        kind = "exception" if issubclass(thing, Exception) else "class"
    members = "\n   :members:\n   :inherited-members: Exception, tuple" if kind == "class" else ""
    *room, last = name.split(".")
    where = ".".join(["truepose", *room])
    return f".. currentmodule:: {where}\n\n.. auto{kind}:: {last}{members}"


def headers(names: Iterable[str], doxygen: bool) -> str:
    """What Doxygen knows of public headers."""
    if not doxygen:
        return "*Built without doxygen: the reference itself is left out.*\n"
    files = "\n".join(f".. doxygenfile:: {name}" for name in names)
    return f"```{{eval-rst}}\n{files}\n```\n"


def internal_headers() -> str:
    """Every internal header and its subject, by room."""
    text = ""
    for room in ROOMS:
        text += f"\n`src/{room}`\n\n"
        for header in sorted((SOURCES / room).glob("*.hpp")):
            text += f"- `{header.name}`: {_subject(header)}\n"
    return text


def _subject(header: Path) -> str:
    """The paragraph that a header begins with: its subject."""
    comment = itertools.takewhile(
        lambda line: line.startswith("// "), header.read_text(encoding="utf-8").splitlines()
    )
    return " ".join(line.removeprefix("// ") for line in comment)


def parts(doxygen: bool) -> dict[str, str]:
    """Every generated part, by the name under which a page includes it; and pages."""
    names, subjects = python()
    return subjects | {
        "generated/robot-file.md": robot_file(),
        "generated/robots.md": robots(),
        "generated/commands.md": commands(),
        "generated/python.md": names,
        "generated/cpp.md": headers(CPP_HEADERS, doxygen),
        "generated/internal-headers.md": internal_headers(),
        "generated/c.md": headers(C_HEADERS, doxygen),
    }
