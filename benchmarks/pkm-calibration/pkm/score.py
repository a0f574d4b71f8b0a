"""Scorer: the errors of a submission's poses, and of its stated σ.

python -m pkm.score SUBMISSION…     # folders with submission.json and a CSV for each log
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pkm.files import HELD_OUT, HERE, BenchmarkError, digest, load, matrix, read_csv, robot_of
from pkm.poses import difference

#: Half width of a 95 % interval in σ.
_Z95 = 1.959964


@dataclass(frozen=True)
class Score:
    """Scores of a submission on one log, or over all logs."""

    position: float  #: rms of the position error, mm
    angle: float  #: rms of the orientation error, degrees; NaN where there is none
    coverage: float  #: share of coordinates within 1.96 of their σ; 0.95 is right
    ratio: float  #: √NEES, rms of the error in units of the stated σ; 1 is right
    cpu: float  #: processor time, s
    refused: int = 0  #: machines whose log was refused; their estimates are those without it


def check(benchmark: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return manifest and truth; BenchmarkError where logs and truth do not belong together."""
    manifest = load(benchmark / "manifest.json")
    truth = load(benchmark / "truth.json")
    for log, entry in manifest["logs"].items():
        path = benchmark / "logs" / f"{log}.csv"
        if not path.is_file() or digest(path) != entry["sha256"]:
            raise BenchmarkError(f"{path}: not the log of the manifest (its SHA-256 differs)")
        if truth.get(log, {}).get("sha256") != entry["sha256"]:
            raise BenchmarkError(f"truth.json: {log}: the truth of another log, not of this one")
    if digest(benchmark / "truth.json") != manifest["truth_sha256"]:
        raise BenchmarkError("truth.json: not the truth of the manifest (its SHA-256 differs)")
    return manifest, truth


def estimates(path: Path, names: list[str], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (N, n) and covariances (N, n, n) of a submission's file, in the log's order."""
    table = read_csv(path)
    allowed = ["machine", "pose", *names, *(f"{name}_sigma" for name in names)]
    pairs = [(i, j) for i in range(len(names)) for j in range(i)]
    allowed += [f"cov_{names[j]}_{names[i]}" for i, j in pairs]
    if unknown := [name for name in table if name not in allowed]:
        raise BenchmarkError(f"{path}: unknown columns: {', '.join(unknown)}")
    where = {tuple(row): k for k, row in enumerate(matrix(table, ["machine", "pose"], path))}
    if missing := [row for row in map(tuple, rows) if row not in where]:
        machine, pose = missing[0]
        raise BenchmarkError(
            f"{path}: {len(missing)} held-out poses missing, first machine {machine}, pose {pose}"
        )
    order = [where[tuple(row)] for row in rows]
    x = matrix(table, list(names), path)[order]
    sigma = matrix(table, [f"{name}_sigma" for name in names], path)[order]
    if not np.isfinite(x).all() or not (sigma > 0).all() or not np.isfinite(sigma).all():
        raise BenchmarkError(f"{path}: an estimate is not finite, or a σ is not positive")
    P = np.einsum("ki,ij->kij", sigma**2, np.eye(len(names)))
    for i, j in pairs:
        if (name := f"cov_{names[j]}_{names[i]}") in table:
            P[:, i, j] = P[:, j, i] = table[name][order]
    if not (np.linalg.eigvalsh(P) > 0).all():
        raise BenchmarkError(f"{path}: a covariance is not positive definite")
    return x, P


def score_log(off: np.ndarray, P: np.ndarray, cpu: float, refused: int = 0) -> Score:
    """Return the scores of one log from errors (N, n) and covariances (N, n, n)."""
    n = off.shape[1]
    lengths = min(n, 3)
    sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    squared = np.einsum("ki,ki->k", off, np.linalg.solve(P, off[..., None])[..., 0]) / n
    angle = np.sqrt((off[:, lengths:] ** 2).sum(axis=1).mean()) if n > 3 else np.nan
    return Score(
        position=1e3 * float(np.sqrt((off[:, :lengths] ** 2).sum(axis=1).mean())),
        angle=float(np.degrees(angle)),
        coverage=float((np.abs(off) < _Z95 * sigma).mean()),
        ratio=float(np.sqrt(squared.mean())),
        cpu=cpu,
        refused=refused,
    )


def overall(scores: Sequence[Score]) -> Score:
    """Return the scores over all logs: geometric means, of coverage the mean, of time the sum."""

    def mean(values: Sequence[float]) -> float:
        known = [value for value in values if np.isfinite(value)]
        return float(np.exp(np.mean(np.log(known)))) if known else np.nan

    return Score(
        mean([one.position for one in scores]),
        mean([one.angle for one in scores]),
        float(np.mean([one.coverage for one in scores])),
        mean([one.ratio for one in scores]),
        sum(one.cpu for one in scores),
        sum(one.refused for one in scores),
    )


def score(submission: Path, benchmark: Path = HERE) -> dict[str, Score]:
    """Return a submission's score on every log of a benchmark, last over all of them."""
    manifest, truth = check(benchmark)
    about, scores = load(submission / "submission.json"), {}
    for log, entry in manifest["logs"].items():
        names = robot_of(benchmark / "robots", entry["robot"])["pose"]
        table = read_csv(benchmark / "logs" / f"{log}.csv")
        rows = np.stack([table["machine"], table["pose"]], axis=1).astype(int)
        rows = rows[table["use"] == HELD_OUT]
        x, P = estimates(submission / f"{log}.csv", names, rows)
        off = difference(names, x, np.array(truth[log]["poses"]))
        cpu = float(about.get("cpu_s", {}).get(log, np.nan))
        scores[log] = score_log(off, P, cpu, len(about.get("refused", {}).get(log, ())))
    return scores | {"all": overall(list(scores.values()))}


def table(results: dict[str, dict[str, Score]], causes: dict[str, str]) -> str:
    """Return the scores of several submissions as text, a block for each log."""
    lines = [
        f"{'':34}{'mm rms':>9}{'° rms':>9}{'coverage':>10}{'√NEES':>10}{'CPU s':>9}{'refused':>9}"
    ]
    for log in next(iter(results.values())):
        lines.append(f"{log} ({causes[log]})" if log in causes else "all logs")
        for name, scores in results.items():
            one = scores[log]
            angle = f"{one.angle:9.4f}" if np.isfinite(one.angle) else f"{'–':>9}"
            lines.append(
                f"    {name:30}{one.position:9.3f}{angle}{one.coverage:10.2f}{one.ratio:10.3g}"
                f"{one.cpu:9.2f}{one.refused:9}"
            )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Score submissions and print the table; return 1 where a file is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("submission", type=Path, nargs="+")
    parser.add_argument("--benchmark", type=Path, default=HERE)
    given = parser.parse_args(arguments)
    try:
        results = {path.name: score(path, given.benchmark) for path in given.submission}
        truth = load(given.benchmark / "truth.json")
    except BenchmarkError as error:
        print(error, file=sys.stderr)
        return 1
    print(table(results, {log: one["cause"] for log, one in truth.items()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
