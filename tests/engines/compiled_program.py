"""Small functions through the compiler of engine simd, on arrays of inputs."""

import ctypes

import jax
import numpy as np

from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.llvm import LlvmPrinter
from ravenjax.engines.cpu.memory import BufferLayout, stored_type
from ravenjax.ir import lowering
from ravenjax.ir.program import Program

HARD_FLOATS = np.array(
    [
        *(0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1.5, 2.5, -2.5, 3.0, 1e-3, -7.25, np.pi),
        *(1e-40, -1e-40, 1e-38, 3e38, -3e38, np.inf, -np.inf, np.nan, 7e-46, 0.49999997),
        *(2.0**31, -(2.0**31), 2147483520.0, 2.0**32, 1e10, -1e10, 1e6, 8388609.0),
    ],
    np.float32,
)
HARD_INTEGERS = np.array(
    [
        *(0, 1, -1, 2, -2, 3, -3, 7, 31, 32, 33, -32, 255, 32767, 32768, -32768, -32769),
        *(65535, 65536, 123456789, -987654321, 2**30, -(2**30)),
        *(2**31 - 1, -(2**31), -(2**31) + 1),
    ],
    np.int32,
)


def pairs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every pair of them."""
    first, second = np.meshgrid(values, values)
    return first.ravel(), second.ravel()


def lowered(function, *columns: np.ndarray) -> Program:
    """`function` of single numbers of these types."""
    return lowering.lower_jaxpr(
        jax.make_jaxpr(function)(*(jax.ShapeDtypeStruct((), c.dtype) for c in columns))
    )


def printed(program: Program, width: int, features) -> tuple[str, BufferLayout]:
    """LLVM code of a function `f` of addresses of inputs, results and tables, and where its
    results lie.
    """
    inputs = BufferLayout.of_lanes(program.inputs, width)
    types = (program.operations[i].dtype for i in program.outputs)
    outputs = BufferLayout.of_lanes(types, width)
    printer = LlvmPrinter(width, features)
    places = inputs.places("%in")
    sources = {
        i: places[op.detail] for i, op in enumerate(program.operations) if op.name == "input"
    }
    results = list(zip(program.outputs, outputs.places("%out"), strict=True))
    printer.run(program, program.needed(), sources, results)
    body = "\n".join(printer.lines)
    text = f"define void @f(ptr %in, ptr %out, ptr %tables) {{\n{body}\nret void\n}}\n" + "\n".join(
        printer.declared
    )
    return text, outputs


def compiled(
    program: Program, width: int, columns: tuple[np.ndarray, ...], tables: np.ndarray | None = None
):
    """Results of a program by compiled code, `width` inputs at a time."""
    text, outputs = printed(program, width, jit.host_target().features)
    module = jit.compile_functions(text, ["f"])
    function = module.function("f", [ctypes.c_void_p] * 3)
    length = len(columns[0])
    found = [[] for _ in program.outputs]
    for start in range(0, length, width):
        rows = np.minimum(np.arange(start, start + width), length - 1)
        given = b"".join(c[rows].astype(stored_type(str(c.dtype))).tobytes() for c in columns)
        taken = np.zeros((1, outputs.bytes), np.uint8)
        function(given, taken.ctypes.data, None if tables is None else tables.ctypes.data)
        for parts, part in zip(found, outputs.unpack(taken), strict=True):
            parts.append(part)
    return [np.concatenate(parts)[:length] for parts in found]


def same_bits(got: np.ndarray, expected: np.ndarray) -> None:
    """Equal types and bits; any NaN equals any other."""
    assert got.dtype == expected.dtype
    if got.dtype.kind == "f":
        assert np.array_equal(np.isnan(got), np.isnan(expected))
        got, expected = (
            np.where(np.isnan(x), 0.0, x).astype(got.dtype).view(f"u{got.itemsize}")
            for x in (got, expected)
        )
    np.testing.assert_array_equal(got, expected)
