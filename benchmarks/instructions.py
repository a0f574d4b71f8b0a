"""Counts the instructions of one call of each f_… function, and fails when any grew by over 5 %.

    instructions.py EXECUTABLE --compiler "g++ 12.2.0"            # compare with instructions.json
    instructions.py EXECUTABLE --compiler "g++ 12.2.0" --update   # write the counts there

Needs valgrind. Counts are exact, hence independent of how busy the machine is; they depend on the
compiler and its libm, so each compiler has its own list, and one without a list passes, with a
warning.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

KNOWN = pathlib.Path(__file__).with_name("instructions.json")
TOLERANCE = 0.05


def count(executable: str) -> dict[str, int]:
    """Instructions per call of every function f_…, callees included."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "callgrind.out"
        run = subprocess.run(
            [
                "valgrind",
                "--tool=callgrind",
                f"--callgrind-out-file={out}",
                "--compress-strings=no",
                "--compress-pos=no",
                executable,
            ],
            check=True,
            capture_output=True,
            text=True,
        )
        poses = int(re.search(r"(\d+) poses", run.stdout)[1])
        # The inclusive cost of a call stands on the line after its `calls=` line.
        counts: dict[str, int] = {}
        called = ""
        lines = iter(out.read_text().splitlines())
        for line in lines:
            if line.startswith("cfn="):
                called = line.removeprefix("cfn=")
            elif line.startswith("calls=") and called.startswith("f_"):
                counts[called] = counts.get(called, 0) + int(next(lines).split()[1])
    return {name: round(total / poses) for name, total in sorted(counts.items())}


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
    if options.update:
        known[options.compiler] = counts
        KNOWN.write_text(json.dumps(known, indent=2) + "\n")
        print(f"wrote {len(counts)} counts of {options.compiler} to {KNOWN.name}")
        return 0
    before = known.get(options.compiler)
    if before is None:
        print(f"WARNING: no counts are known for {options.compiler}; nothing was compared.")
        print("Known compilers:", ", ".join(known) or "none")
        before = {}
    failed = False
    for name in sorted(counts | before):
        new, old = counts.get(name), before.get(name)
        change = f"{new / old - 1:+7.1%}" if new and old else "       "
        grew = bool(before) and (new is None or old is None or new > old * (1 + TOLERANCE))
        failed |= grew
        print(f"{name:24s} {new or 0:8d} {change} {'FAIL' if grew else ''}")
    if failed:
        print("A count grew by over 5 %, or a function came or went. If that is meant: --update.")
    return failed


if __name__ == "__main__":
    sys.exit(main())
