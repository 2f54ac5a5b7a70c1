"""WebAssembly gives the bits that each operation means, and a fused multiply-add those of a
product and a sum.
"""

import numpy as np
import pytest
from compiled_program import printed, same_bits
from operation_cases import CASES, FUSED, look_ups

from ravenjax.engines import wasm
from ravenjax.engines.cpu.memory import stored_type
from ravenjax.ir import polynomials, semantics

wasmtime = pytest.importorskip(
    "wasmtime", reason="wasmtime is not installed (pip install wasmtime)"
)
WIDTHS = (1, wasm.WIDTH)


def wasm_results(program, width, columns, tables=None):
    """Results of a program by WebAssembly, `width` inputs at a time."""
    text, outputs = printed(program, width, wasm.FEATURES)
    engine = wasmtime.Engine()
    store, module = wasmtime.Store(engine), wasmtime.Module(engine, wasm.emit_module(text, ["f"]))
    memory = wasmtime.Memory(store, wasmtime.MemoryType(wasmtime.Limits(2, None)))
    function = wasmtime.Instance(store, module, [memory]).exports(store)["f"]
    at_in, at_out, at_tables = 64, 2**15, 2**16
    if tables is not None:
        memory.write(store, tables.tobytes(), at_tables)
    length = len(columns[0])
    parts = [[] for _ in program.outputs]
    for start in range(0, length, width):
        rows = np.minimum(np.arange(start, start + width), length - 1)
        words = b"".join(c[rows].astype(stored_type(str(c.dtype))).tobytes() for c in columns)
        memory.write(store, words, at_in)
        function(store, at_in, at_out, at_tables)
        row = np.frombuffer(memory.read(store, at_out, at_out + outputs.bytes), np.uint8)
        for part, values in zip(parts, outputs.unpack(row[np.newaxis]), strict=True):
            part.append(values)
    return [np.concatenate(part)[:length] for part in parts]


@pytest.mark.parametrize("width", WIDTHS)
def test_every_operation_gives_the_bits_that_it_means(width):
    for name, program, columns in CASES:
        if name in polynomials.FUNCTIONS:
            continue
        # A call takes longer than the operations in it.
        some = tuple(column[:: 1 if width > 1 else 7] for column in columns)
        (expected,) = semantics.run_program(program, some)
        same_bits(wasm_results(program, width, some)[0], np.asarray(expected))


@pytest.mark.parametrize("width", WIDTHS)
def test_look_ups(width):
    program, places, tables, expected = look_ups()
    for got, right in zip(wasm_results(program, width, (places,), tables), expected, strict=True):
        same_bits(got, right)


def test_a_multiply_add_is_a_product_and_a_sum_each_rounded():
    for _, program, (a, b, c) in FUSED:
        product = semantics.evaluate_operation("mul", "float32", (a, b))
        expected = semantics.evaluate_operation("add", "float32", (product, c))
        same_bits(wasm_results(program, wasm.WIDTH, (a, b, c))[0], expected)
