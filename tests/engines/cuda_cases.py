"""What every compiler of printed CUDA C is checked with: operations, and a campaign."""

from pathlib import Path

import numpy as np
import operation_cases
from compiled_program import same_bits

from ravenjax import resources
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu.code import column_words
from ravenjax.engines.gpu.cuda import CudaPrinter
from ravenjax.engines.gpu.engine import CudaEngine
from ravenjax.engines.interface import Block
from ravenjax.ir import semantics
from ravenjax.ir.program import Program
from ravenjax.numbers.vec import replace

CASES = [*operation_cases.CASES, *operation_cases.FUSED]


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
    out = launch(f"case{k}", np.stack([column_words(c) for c in columns]), out, len(columns[0]))
    (expected,) = semantics.run_program(program, columns)
    expected = np.asarray(expected)
    got = out[0].astype(bool) if expected.dtype == bool else out[0].view(expected.dtype)
    same_bits(got, expected)


PRELUDE = Path(resources.__file__).parent / "engines/gpu/prelude.cu.j2"
SOURCE = PRELUDE.read_text(encoding="utf-8") + "".join(
    printed(k, program) for k, (_, program, _) in enumerate(CASES)
)


# --- a campaign ---


def cut(ticks: int) -> plan.Plan:
    """A plan of every fault site, cut to its first ticks."""
    ready = plan.make_plan(
        loading.load_campaign(resources.find_resource("campaigns", "quick.toml"))
    )
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
            np.testing.assert_array_equal(
                column_words(values), column_words(other.outcomes[name]), err_msg=name
            )
