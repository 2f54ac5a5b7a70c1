"""Engine `wasm`: the tick printed as WebAssembly and run by a runtime in this process, or in a
browser.

The code is that of engine `simd` for vectors of four lanes: the same printer, the same split, the
same buffers. Without a fused multiply-add each is two operations, each rounded: bits are those of
`simd` on a CPU without one.
"""

from __future__ import annotations

import dataclasses
import os
from importlib import metadata

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.engine import SimdKernel, lanes_of_block
from ravenjax.engines.interface import TickProgram, Tracer
from ravenjax.engines.wasm import code, runtime


@dataclasses.dataclass(frozen=True)
class WasmEngine:
    """All cores of a CPU, by a WebAssembly runtime. Raises UserError where none is installed."""

    objects: jit.Objects | None = None  # modules kept between processes
    name: str = "wasm"

    def __post_init__(self) -> None:
        runtime.wasmtime()

    @property
    def device(self) -> str:
        """The runtime in words."""
        return (
            f"wasmtime {metadata.version('wasmtime')}, {jit.host().cpu}, 128-bit vectors, no fused"
            " multiply-add"
        )

    @property
    def threads(self) -> int:
        """One block a core."""
        return len(os.sched_getaffinity(0))

    def compile(self, program: TickProgram, runs: int) -> SimdKernel:
        """See `interface.Engine`."""
        lanes = lanes_of_block(runs, self.threads, code.WIDTH)
        return SimdKernel(
            traced.printable(program), lanes, self.objects, target=runtime.WasmTarget()
        )

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`. Lanes run one by one, to the same bits as in a campaign."""
        kernel = SimdKernel(
            traced.printable(program), 1, self.objects, signals=True, target=runtime.WasmTarget()
        )
        return Tracer(kernel)
