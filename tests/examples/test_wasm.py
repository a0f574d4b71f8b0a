"""The C interface in WebAssembly. examples/wasm, by wasmtime and by node.

Skipped where clang-22 or its wasm libraries are not installed.
"""

import gzip
import json
import re
import shutil
import struct
from pathlib import Path

import pytest
import wasmtime
from compiling import for_wasm, told

SOURCE = Path(__file__).parents[2]
HEADER = SOURCE / "include" / "truepose" / "truepose.h"
#: Of the seven questions of tests/reference/agree.h the last is the estimate, a search.
ALLOWED = (1e-13,) * 6 + (1e-10,)

pytestmark = for_wasm


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Return where the modules lie, as examples/wasm builds them: small."""
    folder = tmp_path_factory.mktemp("wasm")
    told("make", "-C", SOURCE / "examples" / "wasm", f"BUILD={folder}")
    return folder


def agreement(module: Path) -> tuple[int, tuple[float, ...]]:
    """Return how many robots wasmtime asks, and the largest differences."""
    store = wasmtime.Store()
    code = wasmtime.Module.from_file(store.engine, str(module))
    exports = wasmtime.Instance(store, code, []).exports(store)
    memory = exports["memory"]
    start = (exports["__heap_base"].value(store) + 15) // 16 * 16
    memory.grow(store, 1)
    asked = exports["agree"](store, start)
    return asked, struct.unpack("<7d", memory.read(store, start, start + 56))


def test_it_answers_as_python_does(built):
    asked, worst = agreement(built / "agree.wasm")
    assert asked == 6
    assert all(off <= most for off, most in zip(worst, ALLOWED, strict=True)), worst


def test_it_imports_nothing_exports_the_interface_and_is_small(built):
    path = built / "truepose.wasm"
    module = wasmtime.Module.from_file(wasmtime.Engine(), str(path))
    assert not module.imports
    declared = set(re.findall(r"\b(truepose_\w+)\(", HEADER.read_text(encoding="utf-8")))
    shown = {export.name for export in module.exports}
    assert shown - {"memory", "__heap_base", "__stack_pointer"} == declared
    assert len(gzip.compress(path.read_bytes(), 9)) <= 90_000


def test_node_finds_the_same(built, tmp_path):
    if not shutil.which("node"):
        pytest.skip("node is not installed")
    (tmp_path / "agree.mjs").write_text(
        "import { readFileSync } from 'node:fs';\n"
        "const bytes = readFileSync(process.argv[2]);\n"
        "const { instance } = await WebAssembly.instantiate(bytes, {});\n"
        "const { memory, agree, __heap_base } = instance.exports;\n"
        "const start = Math.ceil(__heap_base.value / 16) * 16;\n"
        "memory.grow(1);\n"
        "const asked = agree(start);\n"
        "console.log(JSON.stringify([asked, [...new Float64Array(memory.buffer, start, 7)]]));\n",
        encoding="utf-8",
    )
    asked, worst = json.loads(told("node", tmp_path / "agree.mjs", built / "agree.wasm"))
    assert (asked, tuple(worst)) == agreement(built / "agree.wasm")
