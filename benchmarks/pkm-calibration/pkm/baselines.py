"""The four baselines, written as submissions and scored: python -m pkm.baselines."""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pkm import ideal
from pkm.files import (
    CALIBRATION,
    HELD_OUT,
    HERE,
    BenchmarkError,
    columns_of,
    load,
    matrix,
    read_csv,
    robot_of,
    save,
    write_csv,
)
from pkm.score import Score, check, score, table

Method = Callable[[dict[str, np.ndarray]], tuple[np.ndarray, np.ndarray]]


def methods(robot: dict[str, Any]) -> dict[str, Method]:
    """Return the baselines for a robot by their names; truepose's where it is installed."""
    model = ideal.Ideal(robot)
    found: dict[str, Method] = {
        "nominal": lambda log: ideal.nominal(model, log),
        "least-squares": lambda log: ideal.plain_least_squares(model, log),
    }
    if find_spec("truepose") is None:
        return found
    from pkm import with_truepose

    loaded = with_truepose.load(robot)
    for level in ("ideal", "full"):
        found[f"truepose-{level}"] = lambda log, level=level: with_truepose.calibrated(
            robot, loaded, level, log
        )
    return found


def machines(path: Path, robot: dict[str, Any]) -> list[dict[str, Any]]:
    """Return each machine of a log: number, poses, readings, tracker's readings or None."""
    columns = read_csv(path)
    readings = matrix(columns, columns_of(robot), path)
    names = [f"measured_{name}" for name in robot["pose"]]
    seen = matrix(columns, names, path) if names[0] in columns else None
    found = []
    for machine in np.unique(columns["machine"]).astype(int):
        own = columns["machine"] == machine
        first, held = (own & (columns["use"] == use) for use in (CALIBRATION, HELD_OUT))
        found.append({
            "machine": machine, "pose": columns["pose"][held].astype(int),
            CALIBRATION: readings[first], HELD_OUT: readings[held],
            "measured": None if seen is None else seen[first],
        })  # fmt: skip
    return found


def submit(benchmark: Path, out: Path) -> list[Path]:
    """Write the baselines' submissions to all logs of a benchmark; return their folders."""
    check(benchmark)
    about: dict[str, dict[str, Any]] = {}
    for log, entry in load(benchmark / "manifest.json")["logs"].items():
        robot = robot_of(benchmark / "robots", entry["robot"])
        parts = machines(benchmark / "logs" / f"{log}.csv", robot)
        for name, method in (every := methods(robot)).items():
            start, answers = time.process_time(), []
            own = about.setdefault(name, {"name": name, "cpu_s": {}, "refused": {}})
            for part in parts:
                try:
                    answers.append(method(part))
                except ValueError as refusal:  # a machine that is not calibrated stays nominal
                    answers.append(every["nominal"](part))
                    own["refused"].setdefault(log, {})[str(part["machine"])] = str(refusal)
            own["cpu_s"][log] = round(time.process_time() - start, 3)
            (out / name).mkdir(parents=True, exist_ok=True)
            write_submission(out / name / f"{log}.csv", robot["pose"], parts, answers)
    for name, own in about.items():
        save(out / name / "submission.json", own)
    return [out / name for name in about]


def write_submission(path: Path, names: list[str], parts: Any, answers: Any) -> None:
    """Write a submission's file of one log."""
    machine = np.concatenate([[part["machine"]] * len(part["pose"]) for part in parts])
    x, P = (np.concatenate([answer[k] for answer in answers]) for k in range(2))
    columns = {"machine": machine, "pose": np.concatenate([part["pose"] for part in parts])}
    columns |= dict(zip(names, x.T, strict=True))
    columns |= {f"{name}_sigma": np.sqrt(P[:, i, i]) for i, name in enumerate(names)}
    for i, name in enumerate(names):
        columns |= {f"cov_{names[j]}_{name}": P[:, i, j] for j in range(i)}
    write_csv(path, columns, ".10g")


def run(benchmark: Path, out: Path) -> dict[str, dict[str, Score]]:
    """Return the baselines' scores on a benchmark."""
    return {folder.name: score(folder, benchmark) for folder in submit(benchmark, out)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the baselines and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--benchmark", type=Path, default=HERE)
    parser.add_argument("--out", type=Path, help="keep submissions here")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        out = given.out or Path(folder)
        try:
            results = run(given.benchmark, out)
            truth = load(given.benchmark / "truth.json")
        except BenchmarkError as error:
            print(error, file=sys.stderr)
            return 1
        print(table(results, {log: one["cause"] for log, one in truth.items()}))
        for name in results:
            for log, refused in load(out / name / "submission.json")["refused"].items():
                first, reason = next(iter(refused.items()))
                print(f"{name}: {log}: {len(refused)} machines refused, {first}: {reason}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
