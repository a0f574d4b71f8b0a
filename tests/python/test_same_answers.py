"""Answers of every command, as they were before."""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest
from answers import data, page, table

from truepose.robotfile import shipped

HERE = Path(__file__).parent / "test_same_answers"
#: Commands by verb and case.
COMMANDS = tomllib.loads((HERE / "commands.toml").read_text(encoding="utf-8"))
#: Lines of shipped robots' files, which files made of them repeat.
SHIPPED = {
    line
    for path in shipped().values()
    for line in path.read_text(encoding="utf-8").splitlines()
    if not line.startswith("[")
}


def changed(path, words):
    """Write a file, change its text, or a column of a log."""
    if not path.exists():
        return words[1].replace("\\n", "\n")
    text = path.read_text(encoding="utf-8")
    if len(words) == 2:
        assert words[0] in text
        return text.replace(*words)
    column, factor, offset, since = words[0], float(words[1]), float(words[2]), int(words[3])
    notes = [line for line in text.splitlines() if line.startswith("#")]
    header, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    k = header.index(column)
    for row in rows[since:]:
        row[k] = repr(factor * float(row[k]) + offset)
    return "\n".join([*notes, *(",".join(row) for row in [header, *rows])]) + "\n"


@pytest.fixture
def printed(run, tmp_path, kept):
    """Return a function that runs a case's commands and compares what they print and write."""

    def check(verb, case):
        text, before = "", set()
        for line in COMMANDS[verb][case].splitlines():
            words = shlex.split(line)
            if words[0] == "=":
                path = tmp_path / words[1]
                path.write_text(changed(path, words[2:]), encoding="utf-8")
            elif words[0] == "+":
                for name in words[1:]:
                    shutil.copy(HERE / "inputs" / name, tmp_path)
            elif words[0] == "-":
                assert run(*words[1:])[0] == 0
            else:
                status, out, err = run(*words)
                out = data(out) if out.startswith("{") else out
                text += f"$ {line}\n{status}\n{out}{err}"
                continue
            before |= {path for path in tmp_path.rglob("*") if path.is_file()}
        own = verb.startswith("import")
        for path in sorted({p for p in tmp_path.rglob("*") if p.is_file()} - before):
            text += f"== {path.relative_to(tmp_path)}\n{written(path, own)}"
        kept(text)

    return check


def written(path, own):
    """Return what is kept of a written file; of one made of a shipped robot, what is its `own`."""
    if path.suffix in (".svg", ".png", ".parquet", ".npz"):
        return ""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""
    if path.suffix == ".h":
        text = re.sub(r" */\* \w+ \*/", "", text)
    if path.suffix == ".xml":
        text = re.sub(r' rgba="[^"]*"', "", text)
    if path.suffix == ".toml" and not own:
        text = "\n".join(line for line in text.splitlines() if line not in SHIPPED)
        text = re.sub(r"(?m)^\[[^\n]*\n(?=\[)", "", re.sub(r",\n\s*(?=\[-?\d)", ", ", text))
    return {".html": page, ".csv": table}.get(path.suffix, str)(text) + "\n"


@pytest.mark.parametrize("case", COMMANDS["list"])
def test_list(printed, case):
    printed("list", case)


@pytest.mark.parametrize("case", COMMANDS["info"])
def test_info(printed, case):
    printed("info", case)


@pytest.mark.parametrize("case", COMMANDS["new"])
def test_new(printed, case):
    printed("new", case)


@pytest.mark.parametrize("case", COMMANDS["check"])
def test_check(printed, case):
    printed("check", case)


@pytest.mark.parametrize("case", COMMANDS["export_c"])
def test_export_c(printed, case):
    printed("export_c", case)


@pytest.mark.parametrize("case", COMMANDS["export_linuxcnc"])
def test_export_linuxcnc(printed, case):
    printed("export_linuxcnc", case)


@pytest.mark.parametrize("case", COMMANDS["export_mjcf"])
def test_export_mjcf(printed, case):
    printed("export_mjcf", case)


@pytest.mark.parametrize("case", COMMANDS["accuracy"])
def test_accuracy(printed, case):
    printed("accuracy", case)


@pytest.mark.parametrize("case", COMMANDS["design"])
def test_design(printed, case):
    printed("design", case)


@pytest.mark.parametrize("case", COMMANDS["place"])
def test_place(printed, case):
    printed("place", case)


@pytest.mark.parametrize("case", COMMANDS["plan"])
def test_plan(printed, case):
    printed("plan", case)


@pytest.mark.parametrize("case", COMMANDS["faults"])
def test_faults(printed, case):
    printed("faults", case)


@pytest.mark.parametrize("case", COMMANDS["isolate"])
def test_isolate(printed, case):
    printed("isolate", case)


@pytest.mark.parametrize("case", COMMANDS["calibrate"])
def test_calibrate(printed, case):
    printed("calibrate", case)


@pytest.mark.parametrize("case", COMMANDS["simulate_log"])
def test_simulate_log(printed, case):
    printed("simulate_log", case)


@pytest.mark.parametrize("case", COMMANDS["zero"])
def test_zero(printed, case):
    printed("zero", case)


@pytest.mark.parametrize("case", COMMANDS["simulate"])
def test_simulate(printed, case):
    printed("simulate", case)


@pytest.mark.parametrize("case", COMMANDS["monte_carlo"])
def test_monte_carlo(printed, case):
    printed("monte_carlo", case)


@pytest.mark.parametrize("case", COMMANDS["margins"])
def test_margins(printed, case):
    printed("margins", case)


@pytest.mark.parametrize("case", COMMANDS["import_mjcf"])
def test_import_mjcf(printed, case):
    printed("import_mjcf", case)


@pytest.mark.parametrize("case", COMMANDS["import_urdf"])
def test_import_urdf(printed, case):
    printed("import_urdf", case)


@pytest.mark.parametrize("case", COMMANDS["klipper"])
def test_klipper(printed, case):
    printed("klipper", case)


@pytest.mark.parametrize("case", COMMANDS["maslow"])
def test_maslow(printed, case):
    printed("maslow", case)


@pytest.mark.parametrize("case", COMMANDS["workbench"])
def test_workbench(printed, case):
    printed("workbench", case)
