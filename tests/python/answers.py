"""Answers as text: numbers of any result, and their comparison with a kept file."""

import dataclasses
import re
from collections import Counter
from collections.abc import Mapping
from itertools import zip_longest

import numpy as np

import truepose as tp
from truepose.show import Table

#: A number that stands alone: names such as q1, versions and times of day are none.
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])", re.ASCII)
#: What a cell of a table holds.
SIMPLE = str | bool | int | float | None
#: What is kept of a line of words, such as a list of choices.
LONGEST = 240
#: Members that repeat what was asked.
ASKED = {"robot", "prior", "truth", "x_d", "over", "use"}
#: Arrays with more numbers than this are told by figures of each column.
MOST = 24


def scaled(values):
    """Write numbers with one power of ten: 5 digits of the largest, so that noise is 0."""
    values = np.asarray(values, dtype=float).ravel()
    finite = np.abs(values[np.isfinite(values)])
    largest = finite.max() if len(finite) else 0.0
    if largest < 1e-12:
        return " ".join("0" if np.isfinite(v) else str(v) for v in values)
    power = int(np.floor(np.log10(1.0001 * largest)))
    power = 0 if -3 <= power <= 3 else power
    places = 4 - int(np.floor(np.log10(1.0001 * largest))) + power
    shown = " ".join(f"{v / 10.0**power:.{max(places, 1)}f}" for v in values)
    return re.sub(r"(?<![\d.])-?0\.0+(?!\d)", "0", shown) + (f" ×1e{power}" if power else "")


def of_array(array, name):
    """Yield an array's numbers by columns, each in its own unit; of many, their figures."""
    array = np.asarray(array)
    array = np.abs(array) if array.dtype.kind == "c" else array
    if array.dtype.kind not in "fiub":
        if array.dtype.kind == "O" and array.ndim == 0:
            return
        yield f"{name}: {' '.join(map(str, array.ravel()[:MOST]))}"
    elif array.size == 0 or (array.size <= MOST and array.dtype.kind in "iub"):
        yield f"{name}: {' '.join(str(int(v)) for v in array.ravel())}"
    elif array.ndim < 2 and array.size <= MOST:
        yield f"{name}: {scaled(array)}"
    else:
        yield f"{name}: {'×'.join(map(str, array.shape))}"
        rows = array[:, None] if array.ndim < 2 else array.reshape(-1, array.shape[-1])
        if rows.shape[1] > 12:
            square = array.ndim == 2 and len(array) == len(array.T)
            rows = np.array(
                [*([np.diag(array)] if square else []), *rows.T[:2], rows.sum(axis=1)]
            ).T
        for k, column in enumerate(rows.astype(float).T):
            yield f"  {k}: {scaled(column if array.size <= MOST else figures(column))}"


def figures(column):
    """Return three of many numbers, their root mean square, the largest and a weighted mean."""
    good = np.isfinite(column)
    if not good.all():
        return [column.size - good.sum(), *(figures(column[good]) if good.any() else [])]
    if np.ptp(column) == 0:
        return [column[0]]
    weights = np.cos(np.arange(len(column)))
    square = np.sqrt(np.mean(column**2))
    few = column[[0, len(column) // 3, -1]]
    return [*few, square, column.max(), np.mean(weights * column)]


def members(result):
    """Yield public fields and properties of an object, by name."""
    kind = type(result)
    if dataclasses.is_dataclass(result):
        names = [field.name for field in dataclasses.fields(result)]
    else:
        names = list(getattr(result, "_fields", ()) or getattr(result, "__dict__", ()))
    for name in dir(kind):
        if isinstance(getattr(kind, name, None), property) or (
            type(kind.__dict__.get(name)).__name__ == "cached_property"
        ):
            names.append(name)
    for name in dict.fromkeys(names):
        if not name.startswith("_") and name not in ASKED:
            try:
                yield name, getattr(result, name)
            except tp.TrueposeError as error:
                yield name, str(error)


def told(result, name="", depth=0):
    """Yield an answer's lines: its numbers and words, under their names."""
    if isinstance(result, tp.Robot):
        parameters = result.parameters.values()
        yield f"{name}: robot {result.name} {' '.join(result.readings)}"
        yield f"  values: {scaled(figures(np.array([p.value for p in parameters])))}"
        yield f"  sigmas: {scaled(figures(np.array([p.sigma for p in parameters])))}"
    elif isinstance(result, str):
        yield f"{name}: {result}" if "\n" not in result else f"{name}:\n{result}"
    elif isinstance(result, bool | int | np.bool_ | np.integer):
        yield f"{name}: {int(result)}"
    elif isinstance(result, float | np.floating):
        yield f"{name}: {scaled([result])}"
    elif isinstance(result, np.ndarray):
        yield from of_array(result, name)
        if type(result) is not np.ndarray:
            yield from of_members(result, name, depth)
    elif result is not None and not callable(result) and depth < 7:
        yield from of_many(result, name, depth)


def of_many(result, name, depth):
    """Yield the lines of a mapping, a sequence or an object."""
    if isinstance(result, Mapping):
        values = list(result.values())
        if values and all(isinstance(v, float) for v in values):
            yield f"{name}: {' '.join(map(str, result)) if len(values) <= MOST else len(values)}"
            yield from of_array(np.array(values), f"  {name}")
        elif len(values) > 1 and (rows := rows_of(values)):
            yield f"{name}: {' '.join(map(str, result)) if len(values) <= MOST else len(values)}"
            yield from of_sequence(rows, name, depth)
        else:
            for key, value in result.items():
                yield from told(value, f"{name}.{key}", depth + 1)
    elif isinstance(result, Table):
        yield from of_sequence(result.records(), f"{name}.{result.title}", depth)
    elif isinstance(result, list | tuple | frozenset) and not hasattr(result, "_fields"):
        yield from of_sequence(list(result), name, depth)
    else:
        yield from of_members(result, name, depth)


def of_members(result, name, depth):
    """Yield the lines of an object's members."""
    for key, value in members(result):
        yield from told(value, f"{name}.{key}", depth + 1)


def rows_of(values):
    """Return objects of the same few numbers and words as rows of a table; else nothing."""
    if len({type(value) for value in values}) > 1 or isinstance(values[0], SIMPLE | tp.Robot):
        return []
    rows = [v if isinstance(v, dict) else dict(members(v)) for v in values]
    rows = [{k: v for k, v in row.items() if not callable(v)} for row in rows]
    alike = len({tuple(row) for row in rows}) == 1
    return (
        rows
        if rows[0] and alike and all(isinstance(v, SIMPLE) for r in rows for v in r.values())
        else []
    )


def of_sequence(result, name, depth):
    """Yield the lines of a list: rows of a table by columns."""
    if len(result) > 1 and (rows := rows_of(result)):
        for key in rows[0]:
            yield from of_sequence([row[key] for row in rows], f"{name}.{key}", depth)
    elif all(isinstance(v, float | int | None) and not isinstance(v, bool) for v in result):
        kind = int if all(isinstance(v, int) for v in result) else float
        yield from of_array(np.array([np.nan if v is None else v for v in result], kind), name)
    elif all(isinstance(v, SIMPLE) for v in result):
        words = [str(v) if isinstance(v, str | bool) else scaled([v or 0.0]) for v in result]
        counts = Counter(words) if len(words) > MOST else {}
        if len(counts) > 6:
            words = [str(len(words)), *words[::20]]
        elif counts:
            words = [f"{counts[word]} {word}," for word in sorted(counts)]
        yield f"{name}: {' '.join(words)}"
    else:
        for k, value in enumerate(result[:12]):
            yield from told(value, f"{name}.{k}", depth + 1)


def answer(result) -> str:
    """Return an answer as text."""
    return "\n".join(told(result)) + "\n"


def masked(text: str) -> str:
    """Shorten numbers and long lines."""
    return "\n".join(map(short, text.splitlines())) + "\n"


def short(line: str) -> str:
    """Shorten numbers to 5 digits; blanks are one."""
    line = re.sub(r"[ ─━═]+", " ", line).strip()
    line = NUMBER.sub(lambda number: digits(number[0]), line)
    return line if len(line) <= LONGEST else f"{line[:LONGEST]}… {len(line)}"


def digits(number: str) -> str:
    """Round a number of more than 6 digits to 5; what is 0 but for rounding is 0."""
    if len(re.sub(r"e.*|\D", "", number).lstrip("0")) < 7:
        return number
    return "0" if abs(real(number)) < 1e-13 else f"{real(number):#.5g}".rstrip(".")


def real(number: str) -> float:
    """Return a number of a text."""
    return float(number.replace("−", "-"))


def unit(number: str) -> float:
    """Return one unit of the last digit of a printed number; of a count, nothing."""
    digits, _, power = number.partition("e")
    places = len(digits.partition(".")[2])
    return 10.0 ** (int(power or 0) - places) if places or power else 0.0


def same(obtained, kept) -> None:
    """Compare two answers: words alike, numbers within 1e-4 or one unit of their last digit."""
    got, was = (path.read_text(encoding="utf-8").splitlines() for path in (obtained, kept))
    wrong = []
    for k, (new, old) in enumerate(zip_longest(got, was, fillvalue="(no line)"), 1):
        numbers = NUMBER.findall(new), NUMBER.findall(old)
        alike = NUMBER.sub("#", new) == NUMBER.sub("#", old) and all(
            abs(real(a) - real(b)) <= 1.001 * max(1e-4 * abs(real(b)), unit(a), unit(b))
            for a, b in zip(*numbers, strict=True)
        )
        if not alike:
            wrong.append(f"line {k}: {old}\n     now: {new}")
    if wrong:
        more = f"\n… {len(wrong) - 8} more" if len(wrong) > 8 else ""
        renew = "\nWhere that is meant: --force-regen, and the reason in the commit."
        raise AssertionError(f"{kept.name}\n" + "\n".join(wrong[:8]) + more + renew)


def some(robot, count=3, seed=1):
    """Return poses of a robot's workspace."""
    box = robot.spec.workspace
    low, high = np.array(box.minimum), np.array(box.maximum)
    return np.random.default_rng(seed).uniform(
        0.8 * low + 0.2 * high, 0.2 * low + 0.8 * high, (count, robot.n)
    )


def tried(function, *words, **options):
    """Return an answer, or the message of its refusal."""
    try:
        return function(*words, **options)
    except tp.TrueposeError as error:
        return str(error)


def numbers(run):
    """Return the arrays of a simulation, and what it says."""
    if isinstance(run, str):
        return run
    return [run.x, run.torque, run.q_e.ravel(), run.motor_error.ravel(), run.status, run.table()]
