"""Instruction counts of every call of each f_… function: median and worst.

    instructions.py EXECUTABLE --compiler "g++ 12.2.0"            # compare with instructions.json
    instructions.py EXECUTABLE --compiler "g++ 12.2.0" --update   # write the counts there

The median is over usual inputs, the worst over these and hostile ones. The script fails if either
more than doubled, or if a worst exceeds its limit relative to a median (GOALS).

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

KNOWN = pathlib.Path(__file__).with_name("instructions.json")
MOST = 2  #: times the stored count
#: Limits of a function's worst relative to the median of the second function.
GOALS = {
    "f_control_joint": (5, "f_control_joint"),
    "f_control_tej": (5, "f_control_tej"),
    "f_control_cartesian": (5, "f_control_cartesian"),
    "f_control_weighted": (5, "f_control_weighted"),
    "f_control_estimated": (5, "f_control_estimated"),
    "f_estimate": (5, "f_estimate"),
    "f_learn": (5, "f_learn"),
    "f_fkm_home_12": (5, "f_fkm_home"),
}

Counts = dict[str, dict[str, int]]


def count(executable: str) -> Counts:
    """Return median and worst of every function f_…, callees included."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "callgrind.out"
        run = subprocess.run(
            [
                "valgrind",
                "--tool=callgrind",
                "--combine-dumps=yes",
                f"--callgrind-out-file={out}",
                executable,
            ],
            check=True,
            capture_output=True,
            text=True,
        )
        print(run.stdout, end="")
        usual: dict[str, list[int]] = {}
        hostile: dict[str, list[int]] = {}
        name = ""
        with out.open() as lines:  # one part per call with function and count
            for line in lines:
                if found := re.match(r"desc: Trigger: Client Request: (f_\w+)(!?)", line):
                    name, calls = found[1], hostile if found[2] else usual
                elif name and (found := re.match(r"summary: (\d+)", line)):
                    calls.setdefault(name, []).append(int(found[1]))
                    name = ""
    return {
        name: {
            "median": round(statistics.median(calls)),
            "worst": max(calls + hostile.get(name, [])),
        }
        for name, calls in sorted(usual.items())
    }


def compare(counts: Counts, before: Counts) -> bool:
    """Print a table; return whether a count grew, or a function was added or removed."""
    failed = False
    for name in sorted(counts | before):
        cells = []
        for key in ("median", "worst"):
            new, old = counts.get(name, {}).get(key), before.get(name, {}).get(key)
            change = f"{new / old - 1:+7.1%}" if new and old else "       "
            grew = bool(before) and (new is None or old is None or new > MOST * old)
            failed |= grew
            cells.append(f"{key} {new or 0:8d} {change}{' FAIL' if grew else '     '}")
        print(f"{name:30s} {'   '.join(cells)}".rstrip())
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("executable")
    parser.add_argument("--compiler", required=True)
    parser.add_argument("--update", action="store_true")
    options = parser.parse_args()
    counts = count(options.executable)
    if not counts:
        print("no function f_… was counted")
        return 1
    known = json.loads(KNOWN.read_text()) if KNOWN.exists() else {}
    before = known.get(options.compiler, {})
    if options.update:
        known[options.compiler] = counts
        KNOWN.write_text(json.dumps(known, indent=2) + "\n")
        print(f"wrote {len(counts)} counts of {options.compiler} to {KNOWN.name}")
        before = counts
    elif not before:
        print(f"WARNING: no counts are stored for {options.compiler}; nothing was compared.")
        print("Known compilers:", ", ".join(known) or "none")
    failed = compare(counts, before)
    if failed:
        print("A count more than doubled, or a function came or went. Accept with --update.")
    for name, (times, of) in GOALS.items():
        share = counts[name]["worst"] / counts[of]["median"]
        if share > times:
            print(f"{name} takes {share:.1f} times the median of {of} at worst, over {times}")
            failed = True
    return failed


if __name__ == "__main__":
    sys.exit(main())
