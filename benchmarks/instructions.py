"""Instruction counts of every call of each operation of benchmark_core: median and worst.

    instructions.py EXECUTABLE --compiler "g++ 12.2.0"            # compare with instructions.json
    instructions.py EXECUTABLE --compiler "g++ 12.2.0" --update   # write the counts there

The median is over usual inputs, the worst over these and hostile ones. The script fails if either
more than doubled, or if a worst exceeds its limit (LIMITS), or one relative to a median (GOALS).

Needs valgrind. Counts are exact and independent of the machine's load. They depend on compiler and
libm, so each compiler has its own list; one without a list passes with a warning.
"""

import argparse
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict

KNOWN = pathlib.Path(__file__).with_name("instructions.json")
MOST = 2  #: times the stored count
WORST = 5  #: times the median
#: Operations whose worst is limited, each with that whose median counts.
GOALS = {
    name: name
    for name in (
        "H4 joint",
        "H4 TEJ law",
        "H4 cartesian",
        "H4 weighted",
        "H4 estimated",
        "H4 estimate",
        "H4 online calibration",
    )
} | {"H4 FKM from home, 12 steps": "H4 FKM from home"}
#: Limits of the worst.
LIMITS = {
    "H4 at work, ideal weighted": 60_000,
    "H4 at work, ideal weighted, cached": 60_000,
    "H4 at work, full estimated": 400_000,
    "H4 at work, full estimated, cached": 400_000,
}


def count(executable: str) -> dict[str, dict[str, int]]:
    """Return median and worst of every operation."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "callgrind.out"
        options = ["--tool=callgrind", "--combine-dumps=yes", f"--callgrind-out-file={out}"]
        words = ["valgrind", *options, executable, "--count"]
        run = subprocess.run(words, check=True, capture_output=True, text=True)
        print(run.stdout, end="")
        calls = defaultdict(lambda: ([], []))  # usual, hostile
        # One part per call with the operation and its count.
        part = re.compile(
            r"^desc: Trigger: Client Request: (.+?)(!?)$.*?^summary: (\d+)", re.M | re.S
        )
        for name, mark, instructions in part.findall(out.read_text()):
            calls[name][bool(mark)].append(int(instructions))
    return {
        name: {"median": round(statistics.median(usual)), "worst": max(usual + hostile)}
        for name, (usual, hostile) in sorted(calls.items())
        if usual
    }


def compare(counts: dict, before: dict) -> bool:
    """Print a table; return whether a count grew, or an operation was added or removed."""
    failed = False
    for name in sorted(counts | before):
        cells = []
        for key in ("median", "worst"):
            new, old = counts.get(name, {}).get(key), before.get(name, {}).get(key)
            change = f"{new / old - 1:+7.1%}" if new and old else "       "
            grew = bool(before) and (new is None or old is None or new > MOST * old)
            failed |= grew
            cells.append(f"{key} {new or 0:8d} {change}{' FAIL' if grew else '     '}")
        print(f"{name:33s} {'   '.join(cells)}".rstrip())
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("executable")
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--update", action="store_true")
    options = parser.parse_args()
    counts = count(options.executable)
    if not counts:
        print("no operation was counted")
        return 1
    known = json.loads(KNOWN.read_text()) if KNOWN.exists() else {}
    if options.update:
        known[options.compiler] = counts
        KNOWN.write_text(json.dumps(known, indent=2) + "\n")
        print(f"wrote {len(counts)} counts of {options.compiler} to {KNOWN.name}")
    elif options.compiler not in known:
        print(f"WARNING: no counts are stored for {options.compiler}; nothing was compared.")
        print("Known compilers:", ", ".join(known) or "none")
    failed = compare(counts, known.get(options.compiler, {}))
    if failed:
        print("A count more than doubled, or an operation came or went. Accept with --update.")
    for name, of in GOALS.items():
        share = counts[name]["worst"] / counts[of]["median"]
        if share > WORST:
            print(f"{name} takes {share:.1f} times the median of {of} at worst, over {WORST}")
            failed = True
    for name, most in LIMITS.items():
        if counts[name]["worst"] > most:
            print(f"{name} takes {counts[name]['worst']} at worst, over {most}")
            failed = True
    return failed


if __name__ == "__main__":
    sys.exit(main())
