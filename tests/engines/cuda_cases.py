"""Operations and a time loop that every compiler of printed CUDA C is checked with."""

from __future__ import annotations

import numpy as np
from compiled_program import HARD_FLOATS, HARD_INTEGERS, pairs, same_bits

from ravenjax.bundled import resources
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu.code import words
from ravenjax.engines.gpu.cuda import PRELUDE, CudaPrinter
from ravenjax.engines.gpu.engine import CudaEngine
from ravenjax.engines.interface import Block
from ravenjax.ir import polynomials, semantics
from ravenjax.ir.builder import Builder, rewrite
from ravenjax.ir.program import Program
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers.vec import replace

FLOAT_PAIRS, INTEGER_PAIRS = pairs(HARD_FLOATS), pairs(HARD_INTEGERS)
UNSIGNED_PAIRS = tuple(x.view(np.uint32) for x in INTEGER_PAIRS)
TRUTHS = pairs(np.array([False, True]))
ANGLES = np.concatenate(
    [HARD_FLOATS, np.linspace(-40, 40, 999), np.geomspace(1e-30, 1e30, 500)]
).astype(np.float32)
COMPARED = ("eq", "ne", "lt", "le")


def one_operation(name, dtype, *types):
    builder = Builder()
    return builder.program([builder.emit(name, dtype, *(builder.input(t) for t in types))])


def cases():
    """Name, program and columns of everything that is checked."""
    for name in ("neg", "abs", "sqrt", "floor", "ceil", "round"):
        yield f"{name}_float32", one_operation(name, "float32", "float32"), (HARD_FLOATS,)
    for name in ("add", "sub", "mul", "div", "max", "min", *COMPARED):
        dtype = "bool" if name in COMPARED else "float32"
        yield f"{name}_float32", one_operation(name, dtype, "float32", "float32"), FLOAT_PAIRS
    for name in (
        "add",
        "sub",
        "mul",
        "div",
        "rem",
        "max",
        "min",
        "and",
        "or",
        "xor",
        "shl",
        "shr",
        "sar",
        *COMPARED,
    ):
        for source, columns in (("int32", INTEGER_PAIRS), ("uint32", UNSIGNED_PAIRS)):
            if (name, source) != ("sar", "uint32"):
                dtype = "bool" if name in COMPARED else source
                yield f"{name}_{source}", one_operation(name, dtype, source, source), columns
    for name in ("neg", "not"):
        yield f"{name}_int32", one_operation(name, "int32", "int32"), (HARD_INTEGERS,)
        yield (
            f"{name}_uint32",
            one_operation(name, "uint32", "uint32"),
            (HARD_INTEGERS.view(np.uint32),),
        )
    yield "abs_int32", one_operation("abs", "int32", "int32"), (HARD_INTEGERS,)
    a, b, c = FLOAT_PAIRS[0], FLOAT_PAIRS[1], np.roll(FLOAT_PAIRS[0], 5)
    yield "fma", one_operation("fma", "float32", *["float32"] * 3), (a, b, c)
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((2, 2000)).astype(np.float32)
    yield "fma_cancels", one_operation("fma", "float32", *["float32"] * 3), (x, y, -(x * y))
    for dtype in ("int32", "uint32"):
        yield f"to_{dtype}", one_operation("convert", dtype, "float32"), (HARD_FLOATS,)
        yield (
            f"from_{dtype}",
            one_operation("convert", "float32", dtype),
            (HARD_INTEGERS.view(dtype),),
        )
        yield f"bits_{dtype}", one_operation("bitcast", dtype, "float32"), (HARD_FLOATS,)
        yield (
            f"of_bits_{dtype}",
            one_operation("bitcast", "float32", dtype),
            (HARD_FLOATS.view(dtype),),
        )
    yield "uint32_of_int32", one_operation("bitcast", "uint32", "int32"), (HARD_INTEGERS,)
    yield "truncate", one_operation("truncate", "int32", "float32"), (HARD_FLOATS,)
    for name in ("and", "or", "xor"):
        yield f"{name}_bool", one_operation(name, "bool", "bool", "bool"), TRUTHS
    yield "not_bool", one_operation("not", "bool", "bool"), TRUTHS[:1]
    for dtype, pair in (("float32", FLOAT_PAIRS), ("int32", INTEGER_PAIRS)):
        condition = np.arange(len(pair[0])) % 3 == 0
        yield (
            f"select_{dtype}",
            one_operation("select", dtype, "bool", dtype, dtype),
            (condition, *pair),
        )
    for value in (0.0, -0.0, 1.5, np.inf, -3e38, np.nan):
        for name in ("max", "min"):
            builder = Builder()
            x = builder.input("float32")
            program = builder.program(
                [builder.emit(name, "float32", builder.constant("float32", value), x)]
            )
            yield f"{name}_of_constant", program, (HARD_FLOATS,)
    for name in polynomials.FUNCTIONS:
        builder = Builder()
        count = 2 if name == "atan2" else 1
        inputs = [builder.input("float32") for _ in range(count)]
        arithmetic = polynomials.Arithmetic(builder.emit, builder.constant)
        program = builder.program([polynomials.FUNCTIONS[name](arithmetic, *inputs)])
        yield name, program, FLOAT_PAIRS if count == 2 else (ANGLES,)


CASES = list(cases())


def printed(k: int, program: Program) -> str:
    """Case k as a kernel of one thread a number."""
    inputs = {
        i: f"in[{op.detail} * n + i]"
        for i, op in enumerate(program.operations)
        if op.name == "input"
    }
    printer = CudaPrinter()
    printer.run(
        program,
        program.needed(),
        inputs,
        [(i, f"out[{o} * n + i]") for o, i in enumerate(program.outputs)],
    )
    lines = "\n".join(printer.lines)
    return (
        f'extern "C" __global__ void case{k}(const unsigned* in, unsigned* out, int n) {{\n  const'
        f" int i = blockIdx.x * blockDim.x + threadIdx.x;\n  if (i >= n) return;\n{lines}\n}}\n"
    )


def check(launch, k: int) -> None:
    """Case k through `launch(name, in, out, n)` against what the program means."""
    _, program, columns = CASES[k]
    out = np.full((1, len(columns[0])), 0xDEADBEEF, np.uint32)
    out = launch(f"case{k}", np.stack([words(c) for c in columns]), out, len(columns[0]))
    (expected,) = semantics.run(program, columns)
    expected = np.asarray(expected)
    got = out[0].astype(bool) if expected.dtype == bool else out[0].view(expected.dtype)
    same_bits(got, expected)


SOURCE = PRELUDE + "".join(printed(k, program) for k, (_, program, _) in enumerate(CASES))


# --- a time loop ---


def small_loop() -> TimeLoop:
    """Inputs: a group's gain, a lane's offset and flag. Some state swaps, some is shared, some
    counts; one jumps.
    """
    b = Builder()
    gain, offset, flag = b.input("float32"), b.input("float32"), b.input("bool")
    zero = b.constant("float32", 0.0)
    begin = b.program(
        [zero, offset, b.emit("mul", "float32", gain, gain), b.constant("int32", 0), flag]
    )

    b = Builder()
    gain, offset, flag = b.input("float32"), b.input("float32"), b.input("bool")
    x, y, shared, count, odd = (
        b.input(t) for t in ("float32", "float32", "float32", "int32", "bool")
    )
    now, given = b.input("int32"), b.input("float32")
    table = b.table("float32", 5)
    index = b.emit("min", "int32", now, b.constant("int32", 4))
    moved = b.emit("add", "float32", shared, b.emit("mul", "float32", gain, b.lookup(table, index)))
    pushed = b.emit(
        "fma", "float32", y, b.constant("float32", 0.5), b.emit("add", "float32", moved, offset)
    )
    held = b.emit("lt", "bool", b.constant("float32", 0.2), offset)
    both = b.emit("and", "bool", b.emit("xor", "bool", odd, flag), held)
    far = pushed
    for k in range(20):
        far = b.emit("fma", "float32", far, b.constant("float32", 0.5), b.constant("float32", k))
    chosen = b.emit(
        "rarely", "float32", b.emit("lt", "bool", b.constant("float32", 1.5), pushed), far, pushed
    )
    step = b.program(
        [
            y,
            b.emit("sub", "float32", chosen, b.emit("mul", "float32", x, given)),
            moved,
            b.emit(
                "add",
                "int32",
                count,
                b.emit("select", "int32", both, b.constant("int32", 3), b.constant("int32", 1)),
            ),
            b.emit("not", "bool", odd),
            pushed,
            both,
        ]
    )

    b = Builder()
    gain, offset, flag = b.input("float32"), b.input("float32"), b.input("bool")
    x, y, shared, count, odd = (
        b.input(t) for t in ("float32", "float32", "float32", "int32", "bool")
    )
    finish = b.program([b.emit("add", "float32", x, shared), y, count, odd, offset])
    return TimeLoop(*(rewrite(program, lambda *_: None) for program in (begin, step, finish)))


def meant(loop: TimeLoop, inputs, given, table):
    """Results and what goes out [tick, number, lane], by evaluating the programs tick by tick."""
    lanes = len(inputs[0])
    state = [np.broadcast_to(np.asarray(s), lanes) for s in semantics.run(loop.begin, inputs)]
    out = []
    for now in range(len(given)):
        new = semantics.run(loop.step, [*inputs, *state, np.int32(now), given[now]], [table])
        state, leaving = new[: loop.states], new[loop.states :]
        out.append([np.broadcast_to(x, lanes) for x in leaving])
    return semantics.run(loop.finish, [*inputs, *state]), out


# --- a campaign ---


def cut(ticks: int) -> plan.Plan:
    """A plan of every fault site, cut to its first ticks."""
    ready = plan.make_plan(loading.load(resources.find("campaigns", "quick.toml")))
    columns = tuple(column[:ticks] for column in ready.columns)
    return replace(ready, program=replace(ready.program, ticks=ticks), columns=columns)


def check_engines(short: plan.Plan, runs: int) -> None:
    """So many runs of a plan, spread over it, have the bits of engine simd in engine cuda."""
    rows = np.linspace(0, short.runs - 1, runs).astype(int)
    varied, harmless = short.lanes(rows, runs, harmless=True)
    _, faults = short.lanes(rows, runs)
    results = []
    for engine in (SimdEngine(), CudaEngine()):
        kernel = engine.compile(short.program, runs)
        golden_runs = kernel.run(Block(varied, harmless, None), short.columns)
        results.append(
            (golden_runs, kernel.run(Block(varied, faults, golden_runs.reference), short.columns))
        )
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(
            one.reference.view(np.uint32), other.reference.view(np.uint32)
        )
        assert list(one.outcomes) == list(other.outcomes)
        for name, values in one.outcomes.items():
            np.testing.assert_array_equal(words(values), words(other.outcomes[name]), err_msg=name)
