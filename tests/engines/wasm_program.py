"""Small functions through the compiler of engine wasm, on arrays of inputs."""

from __future__ import annotations

import numpy as np
import wasmtime
from compiled_program import printed

from ravenjax.engines.wasm import code
from ravenjax.ir.program import Program


def wasm_results(
    program: Program, width: int, columns: tuple[np.ndarray, ...], tables: np.ndarray | None = None
):
    """Results of a program by WebAssembly, `width` inputs at a time."""
    text, outputs = printed(program, width, code.FEATURES)
    engine = wasmtime.Engine()
    store, module = wasmtime.Store(engine), wasmtime.Module(engine, code.emit(text, ["f"]))
    memory = wasmtime.Memory(store, wasmtime.MemoryType(wasmtime.Limits(2, None)))
    function = wasmtime.Instance(store, module, [memory]).exports(store)["f"]
    at_in, at_out, at_tables = 64, 2**15, 2**16
    if tables is not None:
        memory.write(store, tables.tobytes(), at_tables)
    length = len(columns[0])
    parts: list[list[np.ndarray]] = [[] for _ in program.outputs]
    for start in range(0, length, width):
        rows = np.minimum(np.arange(start, start + width), length - 1)
        words = b"".join(
            c[rows].astype(np.int32 if c.dtype == bool else c.dtype).tobytes() for c in columns
        )
        memory.write(store, words, at_in)
        function(store, at_in, at_out, at_tables)
        row = np.frombuffer(memory.read(store, at_out, at_out + outputs.bytes), np.uint8)
        for k, (dtype, offset) in enumerate(zip(outputs.types, outputs.offsets, strict=True)):
            stored = np.dtype(np.int32 if dtype == "bool" else dtype)
            parts[k].append(
                row[offset : offset + width * stored.itemsize].view(stored).astype(dtype)
            )
    return [np.concatenate(part)[:length] for part in parts]
