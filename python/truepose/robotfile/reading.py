"""Reader of robot files; every error is one line."""

import contextlib
import copy
import functools
import itertools
import os
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import ValidationError

from truepose import files
from truepose.exceptions import InputError, RobotFileError, choose, one_line, shortened
from truepose.robotfile import consistency
from truepose.robotfile.base import Problem, Section, tables
from truepose.robotfile.pattern import MARK, TURNED, Copy, copies, misfits, repeats, turned_copies
from truepose.robotfile.quantities import factors_of, in_si, marked
from truepose.robotfile.schema import SECTIONS, Pattern, RobotFile
from truepose.robotfile.sensors import SENSORS

AnySection = TypeVar("AnySection", bound=Section)
_SECTIONS = SECTIONS | SENSORS | {f"{of}_defaults": SECTIONS[of] for of in ("chain", "motor")}
#: Keys that are expanded before the schema's check, and their meaning.
SHORTHAND = {
    "based_on": "the shipped robot that this file changes: its tables are laid over that robot's, "
    "its lists replace that robot's",
    "units": 'units of lengths and angles without one, as ["mm", "deg"]; default ["m", "rad"]. '
    "Other quantities, and [calibration], are in SI units",
    "chain_defaults": "keys of 'chain' that all chains share; a chain's own key wins",
    "motor_defaults": "keys of 'motor' that all motors of a mechanism share",
}
#: Of each table written out, its index in the file.
Sources = dict[str, list[int]]
#: Largest robot file. A calibration of the most parameters possible takes 0.7 MB.
MOST_BYTES = 1_000_000

_DEEP = re.compile(r"(?:\.[\w\s\"'-]{1,40}){100}")  # a key of a hundred parts

LINE = 1000  #: most characters shown of a problem
_TOLD = 100  # most problems of one sort, in one file

#: Ending of folders with a possible true robot instead of a nominal one.
TWIN = "-twin"


def shipped() -> dict[str, Path]:
    """Return names and files of the shipped robots, without twins."""
    return {name: path for name, path in loadable().items() if not name.endswith(TWIN)}


def loadable() -> dict[str, Path]:
    """Return names and files of all that is shipped, with twins."""
    folder = resources.files("truepose") / "_data/robots"
    return {p.parent.name: p for p in sorted(Path(str(folder)).glob("*/robot.toml"))}


def path_of(robot: str) -> Path:
    """Return the file of a shipped robot's name, or of a path."""
    return loadable().get(robot, Path(robot))


def read(robot: str | Path) -> RobotFile:
    """Read a robot file by a shipped robot's name or a path; every error is one line."""
    files = loadable()
    if not isinstance(robot, (str, os.PathLike)) or not str(robot):
        raise RobotFileError(f"robot = {robot!r}: must be a shipped robot's name or a file's path")
    path = path_of(str(robot))
    if path.suffix != ".toml" and not path.exists():
        raise RobotFileError(choose("robot", robot, files) + ", or the path of a robot file")
    return parse(text_of(path, str(robot)), str(robot))


def text_of(path: Path, where: str) -> str:
    """Read a file; `where` names it in the message."""
    text = files.text(path, MOST_BYTES, where, RobotFileError)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse(text: str, where: str) -> RobotFile:
    """Read a robot file's text; `where` names it in the message."""
    try:
        data = table_of(text)
    except ValueError as error:
        raise RobotFileError(f"{where}: {error}") from None
    spec = validate(data, where)
    spec._text = text
    return spec


def table_of(text: str) -> dict:
    """Parse a TOML text; ValueError with one line where it is invalid."""
    try:
        if _DEEP.search(text):  # the parser would take minutes
            raise RecursionError
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not TOML: {_shown(text, str(error))}") from None
    except RecursionError:
        raise ValueError("not TOML that can be read: nested too deeply") from None


def _shown(text: str, error: str) -> str:
    """Return an error of the parser with the line that it is about, and a likely mistake."""
    at = re.search(r"\(at line (\d+)", error)
    line = text.split("\n")[int(at[1]) - 1].strip() if at else ""
    hint = ""
    if re.match(r"[^\"'#]*=\s*[-+]?\d+,\d", line):
        hint = "; decimals need a point"
    elif re.match(r"[^\"'#]*=\s*[A-Za-z]", line):
        hint = "; a text needs quotes"
    elif "," in line and error.startswith("Expected '='"):  # a header
        hint = "; a log of readings is no robot file: give the robot first"
    return f"{error}: {one_line(line, LINE)}{hint}" if line else error


def validate(data: dict, where: str) -> RobotFile:
    """Check the contents of a robot file; `where` names it in the message."""
    spec, found = examine(data)
    if spec is None or found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        raise RobotFileError(f"{where}: {shortened(found[0].text, LINE)}{more}")
    return spec


def examine(data: dict) -> tuple[RobotFile | None, list[Problem]]:
    """Return the checked robot file, and everything that is wrong with its form and names.

    With problems it is the file without them, or None where they leave no mechanism.
    """
    try:
        whole, sources, problems = written_out(data)
    except RobotFileError as error:
        return None, [Problem(*error.args)]
    guessed, spec = False, None
    try:
        spec = RobotFile.model_validate(whole)
    except ValidationError as error:
        problems = [*_form_problems(error, data, sources), *problems]
        spec, guessed = _without(whole, error)
    if spec is None:
        return None, problems
    unfit = [*itertools.islice(consistency.misfits(spec), _TOLD)]
    named = consistency.misnamed(spec, not (unfit or guessed))
    for path, text in (*unfit, *itertools.islice(named, _TOLD)):
        problems.append(Problem(where_written(path, data, sources), text))
    return (None if unfit or guessed else spec), problems


def _without(whole: dict, error: ValidationError) -> tuple[RobotFile | None, bool]:
    """Return a file without the keys whose form is wrong, and whether values had to be guessed."""
    whole, guessed = copy.deepcopy(whole), False
    # Left out, then tables that need what was; what is needed: any number, then any direction.
    for stand_in in (None, None, 1.0, (0.0, 0.0, 1.0)):
        for problem in error.errors(include_url=False, include_context=False):
            *path, last = problem["loc"]
            table: Any = whole
            with contextlib.suppress(LookupError, TypeError):  # its table is replaced already
                for part in path:  # a sensor's kind is in the location, but no key
                    table = table if part in SENSORS and part not in table else table[part]
                if stand_in is None and isinstance(table, dict):
                    table.pop(last, None)
                    continue
                guessed = True
                if path == ["chain"] and isinstance(table[last], dict):
                    table[last] = {"arm": 1e-3, "rod": 1.0, "axis": (0.0, 0.0, 1.0)} | table[last]
                else:
                    table[last] = stand_in or 1.0
        try:
            return RobotFile.model_validate(whole), guessed
        except ValidationError as left:
            error = left
    return None, True


def _form_problems(error: ValidationError, data: dict, sources: Sources) -> list[Problem]:
    """Return what is wrong with the form of a robot file, each once."""
    found = error.errors(include_url=False)[:_TOLD]
    found.sort(key=lambda problem: problem["type"] != "extra_forbidden")  # misspelt, not missing
    described = {}  # copies of a chain have the same problem: report it once
    for problem in found:
        location = where_written(problem["loc"], data, sources)
        text = _describe(problem | {"loc": location})
        described[text] = Problem(tuple(p for p in location if p not in SENSORS), text)
    return [*described.values()]


def section(kind: type[AnySection], name: str, values: dict, robot: str) -> AnySection:
    """Check a table of a robot, given in Python."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        problem = error.errors()[0]
        text = _describe({**problem, "loc": (name, *problem["loc"])})
        raise InputError(f"{robot}: {text}") from None


@functools.cache
def _adapter(kind: type[Section], key: str) -> Any:
    from pydantic import TypeAdapter

    field = kind.model_fields[key]
    made: Any = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
    return TypeAdapter(made)


def checked(kind: type[Section], key: str, value: Any) -> Any:
    """Check the value of a table's key, given in Python."""
    if key not in kind.model_fields:
        raise InputError(choose("key", key, kind.model_fields))
    try:
        return _adapter(kind, key).validate_python(value)
    except ValidationError as error:
        problem = error.errors()[0]
        raise InputError(_describe({**problem, "loc": (key, *problem["loc"])})) from None


def where_written(location: tuple, data: dict, sources: Sources) -> tuple:
    """Return where the file has a table's key: in a motif, or shared by all chains or motors."""
    top, number, *rest = (*location, None, None)[: max(len(location), 2)]
    of = sources.get(top, [])
    if not isinstance(number, int) or number >= len(of):
        return location
    own, shared = tables(data, top), data.get(f"{top}_defaults", {})
    number = of[number]
    if rest and rest[0] in shared and not (number < len(own) and rest[0] in own[number]):
        return (f"{top}_defaults", *rest)
    return (top, number, *rest)


def written_out(data: dict) -> tuple[dict, Sources, list[Problem]]:
    """Expand based_on, defaults, pattern and motors; return also where each table is, and problems.

    The arguments of a RobotFileError are those of a Problem.
    """
    own = dict(data)
    base = _base(own.pop("based_on")) if "based_on" in own else {}
    if factors := factors_of(own.pop("units", [])):
        own = {key: of if key == "pattern" else marked(of) for key, of in own.items()}
    whole = _over(base, own)
    shared = {top: whole.pop(f"{top}_defaults", {}) for top in ("chain", "motor")}
    for top, of in shared.items():
        if not isinstance(of, dict):
            raise RobotFileError((f"{top}_defaults",), f"{top}_defaults: must be a table")
    if isinstance(whole.get("chain"), list):
        chains = whole["chain"]
        whole["chain"] = [shared["chain"] | c if isinstance(c, dict) else c for c in chains]
    pattern, written, problems = _repeated(whole)
    sources: Sources = {top: [copy.source for copy in of] for top, of in written.items()}
    mechanism = "body" in whole or "closure" in whole
    if shared[unfit := "chain" if mechanism else "motor"]:
        others = "bodies and closures" if mechanism else "chains"
        raise RobotFileError((f"{unfit}_defaults",), f"{unfit}_defaults: not in a file of {others}")
    if mechanism:
        whole = {"mobility": "mechanism", "chain": []} | whole
        _list_motors(whole, shared["motor"])
    whole = in_si(whole, factors, lambda path: where_written(path, data, sources))
    for top, of in written.items():
        if pattern and top != "motor":
            whole[top] = turned_copies(top, whole[top], of, pattern.about)
    return whole, sources, problems


def _repeated(whole: dict) -> tuple[Pattern | None, dict[str, list[Copy]], list[Problem]]:
    """Repeat the tables of a pattern, not turned yet; return it, its copies and problems."""
    pattern, written, problems = None, {}, []
    with contextlib.suppress(ValidationError):  # the schema reports an unusable pattern
        pattern = Pattern.model_validate(whole.get("pattern"))
    for top in TURNED:
        if not isinstance(listed := whole.get(top), list):
            continue
        if pattern:
            problems += [Problem(*problem) for problem in misfits(top, listed, pattern.repeat)]
        for number, table in enumerate(listed):
            if not pattern and top != "chain" and repeats(top, table):
                text = f"{table['name']}: {MARK} repeats a table: give [pattern] repeat, about"
                raise RobotFileError((top, number, "name"), text)
        written[top] = copies(top, listed, pattern.repeat if pattern else 1)
        whole[top] = [copy.table for copy in written[top]]
    return pattern, written, problems


def _list_motors(whole: dict, shared: dict) -> None:
    """Give each motor of a mechanism a table, in the order of their numbers; others last."""
    movers = [*tables(whole, "body"), *tables(whole, "closure")]
    names = {str(of["motor"]) for of in movers if "motor" in of}
    own = {str(of.get("name")): of for of in tables(whole, "motor")}
    order = [*sorted(names, key=lambda name: (len(name), name)), *(own.keys() - names)]
    whole["motor"] = [shared | {"name": name} | own.get(name, {}) for name in order]


def _base(name: object) -> dict:
    """Return the data of the shipped robot that a file is based on."""
    robots = shipped()
    if not isinstance(name, str) or name not in robots:
        raise RobotFileError(("based_on",), "based_on: " + choose("robot", name, robots))
    return tomllib.loads(robots[name].read_text(encoding="utf-8"))


def _over(base: dict, data: dict) -> dict:
    """Lay a file's data over those of its base: tables by key, the rest whole."""
    result = dict(base)
    for key, value in data.items():
        both = isinstance(result.get(key), dict) and isinstance(value, dict)
        result[key] = result[key] | value if both else value
    return result


def _describe(problem: dict) -> str:
    location = [part for part in problem["loc"] if part not in SENSORS]
    key = ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in location)
    kind, value = problem["type"], problem["input"]
    if kind == "extra_forbidden":
        section = next((s for s in map(str, reversed(problem["loc"][:-1])) if s in _SECTIONS), None)
        fields = (_SECTIONS[section] if section else RobotFile).model_fields
        known = list(fields)
        return f"{key}: " + choose("key", location[-1], known if section else [*known, *SHORTHAND])
    reasons = {
        "missing": ": is missing",
        "union_tag_not_found": f".kind: is missing (choices: {', '.join(SENSORS)})",
        "tuple_type": f" = {shortened(repr(value))}: must be a list",
        **dict.fromkeys(("model_type", "dict_type", "model_attributes_type"), ": must be a table"),
    }
    if kind in reasons:
        return key + reasons[kind]
    if kind == "union_tag_invalid":
        return f"{key}.kind: " + choose("kind", value.get("kind"), SENSORS)
    message = problem["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if problem["loc"] == ("mobility",):
        message += "; a file with [[body]] and [[closure]] needs none"
    if isinstance(value, dict):
        return f"{key}: {message}" if key else message
    return f"{key} = {shortened(repr(value))}: {message}"
