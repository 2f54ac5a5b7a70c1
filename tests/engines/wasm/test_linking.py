"""What the linker makes of an object is what LLVM's own linker does, and what it does not know
it refuses.
"""

from __future__ import annotations

import shutil
import subprocess

import pytest

from ravenjax.engines.wasm import code

wasmtime = pytest.importorskip(
    "wasmtime", reason="wasmtime is not installed (pip install wasmtime)"
)
WASM_LD = shutil.which("wasm-ld") or shutil.which("wasm-ld-14")

CALLS = """
define i32 @twice(i32 %x) { %y = mul i32 %x, 2 ret i32 %y }
define i32 @chosen(i32 %x) { %y = call i32 @twice(i32 %x) %z = call i32 @more(i32 %y) ret i32 %z }
define internal i32 @more(i32 %x) noinline { %y = add i32 %x, 1 ret i32 %y }
define i32 @there(ptr %at) { %y = load i32, ptr %at ret i32 %y }
"""


def results(binary, exported_memory=False):
    """What the functions give, and the memory's word 8."""
    engine = wasmtime.Engine()
    store, module = wasmtime.Store(engine), wasmtime.Module(engine, binary)
    memory = wasmtime.Memory(store, wasmtime.MemoryType(wasmtime.Limits(2, None)))
    instance = wasmtime.Instance(store, module, [] if exported_memory else [memory])
    there = instance.exports(store)
    memory = there["memory"] if exported_memory else memory
    memory.write(store, (7).to_bytes(4, "little"), 2048)
    return there["twice"](store, 21), there["chosen"](store, 21), there["there"](store, 2048)


def test_calls_reach_the_functions_that_they_name():
    names = ["chosen", "twice", "there"]
    binary = code.emit_module(CALLS, names)
    assert results(binary) == (42, 43, 7)
    engine = wasmtime.Engine()
    module = wasmtime.Module(engine, binary)
    assert [one.name for one in module.exports] == names
    assert [(one.module, one.name) for one in module.imports] == [code.MEMORY]


@pytest.mark.skipif(WASM_LD is None, reason="no wasm-ld on the path (apt-get install lld)")
def test_it_does_what_wasm_ld_does(tmp_path):
    path, linked = tmp_path / "o.o", tmp_path / "o.wasm"
    path.write_bytes(code.compile_module(CALLS))
    names = ["twice", "chosen", "there"]
    exports = [f"--export={name}" for name in names]
    subprocess.run([WASM_LD, path, "-o", linked, "--no-entry", *exports], check=True)
    ours = code.emit_module(CALLS, names)
    assert results(linked.read_bytes(), exported_memory=True) == results(ours)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            (
                "declare i32 @far(i32)\ndefine i32 @f(i32 %x) { %y = call i32 @far(i32 %x) ret i32"
                " %y }"
            ),
            "imports 2",
        ),
        (
            "@word = global i32 5\ndefine i32 @f() { %y = load i32, ptr @word ret i32 %y }",
            "section",
        ),
    ],
)
def test_what_it_does_not_know_is_refused(text, told):
    with pytest.raises(code.Unlinkable, match=told):
        code.emit_module(text, ["f"])
