"""Linked functions call those that they name, and what the linker does not know it refuses."""

import pytest

from ravenjax.engines import wasm

wasmtime = pytest.importorskip("wasmtime", reason="wasmtime is not installed")

CALLS = """
define i32 @twice(i32 %x) { %y = mul i32 %x, 2 ret i32 %y }
define i32 @chosen(i32 %x) { %y = call i32 @twice(i32 %x) %z = call i32 @more(i32 %y) ret i32 %z }
define internal i32 @more(i32 %x) noinline { %y = add i32 %x, 1 ret i32 %y }
define i32 @there(ptr %at) { %y = load i32, ptr %at ret i32 %y }
"""


def results(binary):
    """What the functions give, and the memory's word 8."""
    engine = wasmtime.Engine()
    store, module = wasmtime.Store(engine), wasmtime.Module(engine, binary)
    memory = wasmtime.Memory(store, wasmtime.MemoryType(wasmtime.Limits(2, None)))
    instance = wasmtime.Instance(store, module, [memory])
    there = instance.exports(store)
    memory.write(store, (7).to_bytes(4, "little"), 2048)
    return there["twice"](store, 21), there["chosen"](store, 21), there["there"](store, 2048)


def test_calls_reach_the_functions_that_they_name():
    names = ["chosen", "twice", "there"]
    binary = wasm.emit_module(CALLS, names)
    assert results(binary) == (42, 43, 7)
    engine = wasmtime.Engine()
    module = wasmtime.Module(engine, binary)
    assert [one.name for one in module.exports] == names
    assert [(one.module, one.name) for one in module.imports] == [wasm.MEMORY]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "declare i32 @far()\ndefine i32 @f() { %y = call i32 @far() ret i32 %y }",
            "has 2 imports",
        ),
        ("@w = global i32 5\ndefine i32 @f() { %y = load i32, ptr @w ret i32 %y }", "section"),
    ],
)
def test_what_it_does_not_know_is_refused(text, told):
    with pytest.raises(wasm.Unlinkable, match=told):
        wasm.emit_module(text, ["f"])
