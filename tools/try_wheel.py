"""Test of a wheel on every Python found here, away from the source tree.

    python tools/try_wheel.py dist/truepose-*.whl

Finds the wheel's Python versions on the path and among pyenv's. Each gets a new environment with
the wheel and a copy of some of the tests; missing versions are reported.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

VERSIONS = [f"3.{minor}" for minor in range(11, 16)]
TESTS = ["test_public_api.py", "test_shapes.py", "test_jacobians.py", "test_sensors.py"]
SOURCE = Path(__file__).parents[1]


def find(version: str) -> str | None:
    """Return a working interpreter of this version."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [shutil.which(f"python{version}"), sys.executable]
    candidates += sorted(map(str, pyenv.glob(f"{version}.*/bin/python3")), reverse=True)
    ask = "import sys, venv; print('%d.%d' % sys.version_info[:2])"
    for python in filter(None, candidates):
        ran = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=False)
        if ran.stdout.strip() == version:
            return python
    return None


def works(python: str, wheel: Path) -> bool:
    """Install the wheel into a new environment and run the tests there."""
    with tempfile.TemporaryDirectory(prefix="truepose-wheel-") as name:
        folder = Path(name)
        subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
        scripts = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        pip = [scripts / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check"]
        subprocess.run([*pip, wheel, "pytest"], check=True)
        tests = folder / "tests" / "python"
        tests.mkdir(parents=True)
        for test in ["conftest.py", "fixtures.py", *TESTS]:
            shutil.copy(SOURCE / "tests" / "python" / test, tests)
        options = ["-q", "--import-mode=importlib", "-o", f"pythonpath={tests}"]
        commands = [
            [scripts / "truepose", "info", "h4"],
            [scripts / "python", "-m", "pytest", *options, tests],
        ]
        return all(
            subprocess.run(words, cwd=folder, check=False).returncode == 0 for words in commands
        )


def main() -> int:
    """Test the wheel, and print the result for each version."""
    wheel = Path(sys.argv[1]).resolve()
    said = {
        version: works(python, wheel) if (python := find(version)) else None for version in VERSIONS
    }
    print(f"\n{wheel.name}")
    words = {True: "works", False: "FAILED", None: "not found, not run"}
    for version, result in said.items():
        print(f"  Python {version}: {words[result]}")
    return int(False in said.values() or True not in said.values())


if __name__ == "__main__":
    sys.exit(main())
