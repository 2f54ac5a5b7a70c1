"""Measures the machine's peak rate of operations, and the share of this rate that the fastest
engine reaches.

    python analysis/engines/peak.py [simd | cuda]

The peak rate is that of independent fused multiply-adds in registers, on all cores or the whole GPU
at once. Each multiply-add counts as one operation, as in a tick. The result is the best of many
short bursts. In a tick, selections and integer operations may use other units of the processor, and
divisions and roots take several cycles. The ratio therefore only shows how close the tick comes to
the rate of multiply-adds.
"""

import ctypes
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import tick_operations

sys.path.append(str(Path(__file__).resolve().parents[1]))

from bench import engines, workload
from bench.workload import Workload
from ravenjax.engines.cpu import jit

CHAINS = 12
"""Independent chains per thread: more than latency times pipes (4 x 2), and few enough for 16
registers.
"""
_GPU_ROUNDS, _GPU_THREADS, _GPU_BLOCKS, _GPU_LAUNCHES = 4096, 256, 64, 8
"""Rounds, threads per block, blocks per multiprocessor, and launches."""

_CUDA = f"""
extern "C" __global__ void peak(float* room, int rounds) {{
  float a = room[0] + 0.5f, b = room[1] + 1.0f, x[{CHAINS}], sum = 0.0f;
  for (int k = 0; k < {CHAINS}; ++k) x[k] = (float)(threadIdx.x + k);
  #pragma unroll 4
  for (int i = 0; i < rounds; ++i)
    #pragma unroll
    for (int k = 0; k < {CHAINS}; ++k) x[k] = fmaf(x[k], a, b);
  for (int k = 0; k < {CHAINS}; ++k) sum += x[k];
  if (sum == 12345.0f) room[2] = sum;
}}
"""


def measure_cpu(seconds: float, rounds: int = 1_000_000) -> float:
    """Return operations per second of all cores that this process may use."""
    threads, width = joblib.cpu_count(), jit.host_target().width
    peak = jit.compile_functions(_llvm(width), ["peak"]).function(
        "peak", [ctypes.c_void_p, ctypes.c_int64]
    )
    rooms = [np.array([0.5, 1.0, 0.0], np.float32) for _ in range(threads)]
    with ThreadPoolExecutor(threads) as pool:

        def work() -> None:
            list(pool.map(lambda room: peak(room.ctypes.data, rounds), rooms))

        work()
        best_s = min(workload.repeat(work, seconds, 500))
    return threads * rounds * CHAINS * width / best_s


def measure_gpus(seconds: float) -> float:
    """Return operations per second of all visible GPUs. Raises UserError if there is none."""
    from ravenjax.engines.gpu import device as cuda_device

    return sum(measure_gpu(seconds, device) for device in cuda_device.visible_gpus())


def measure_gpu(seconds: float, device: Any) -> float:
    """Return operations per second of one GPU."""
    from ravenjax.engines.gpu import device as cuda_device

    code = cuda_device.compile_cubin(_CUDA, device.architecture, ())
    function = cuda_device.DeviceModule(device, code).function("peak")
    blocks = device.multiprocessors * _GPU_BLOCKS
    with cuda_device.DeviceSession(device) as session:
        room = session.allocate(4)

        def work() -> None:
            for _ in range(_GPU_LAUNCHES):
                session.launch(function, blocks, _GPU_THREADS, session.main, room, _GPU_ROUNDS)
            session.finish(session.mark(session.main))

        work()
        best_s = min(workload.repeat(work, seconds, 5))
    return _GPU_LAUNCHES * blocks * _GPU_THREADS * _GPU_ROUNDS * CHAINS / best_s


def _llvm(width: int) -> str:
    """Return the LLVM IR of void peak(float room[3], long rounds)."""
    wide, chains = f"<{width} x float>", range(CHAINS)
    step = f"call {wide} @llvm.fma.v{width}f32({wide} %x{{k}}, {wide} %a, {wide} %b)"
    if "fma" not in jit.host_target().features and width != 4:
        step = f"fadd {wide} %x{{k}}, %b"
    first = "\n".join(
        f"  %x{k} = phi {wide} [splat (float {k}.0), %entry], [%y{k}, %loop]" for k in chains
    )
    steps = "\n".join(f"  %y{k} = {step.format(k=k)}" for k in chains)
    sums = "\n".join(f"  %s{k + 1} = fadd {wide} %s{k}, %y{k}" for k in chains)
    return f"""
declare {wide} @llvm.fma.v{width}f32({wide}, {wide}, {wide})
define void @peak(ptr %room, i64 %rounds) {{
entry:
  %second = getelementptr float, ptr %room, i64 1
  %third = getelementptr float, ptr %room, i64 2
  %a1 = load float, ptr %room
  %b1 = load float, ptr %second
  %a0 = insertelement {wide} poison, float %a1, i64 0
  %b0 = insertelement {wide} poison, float %b1, i64 0
  %a = shufflevector {wide} %a0, {wide} poison, <{width} x i32> zeroinitializer
  %b = shufflevector {wide} %b0, {wide} poison, <{width} x i32> zeroinitializer
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%next, %loop]
{first}
{steps}
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %rounds
  br i1 %more, label %loop, label %done
done:
  %s0 = fadd {wide} zeroinitializer, zeroinitializer
{sums}
  %out = extractelement {wide} %s{CHAINS}, i64 0
  store float %out, ptr %third
  ret void
}}
"""


def main(engine: str = "simd") -> None:
    """Print the peak of the hardware of a code-generating engine, and the engine's share of it."""
    peak = measure_gpus(4.0) if engine == "cuda" else measure_cpu(2.0)
    rate = max(row["ticks_per_s"] for row in engines.measure(10.0, engine))
    share = rate * tick_operations.count(Workload(1000)).per_lane / peak
    print(f"peak {peak / 1e9:,.0f} G operations/s, {rate / 1e6:.3g} M ticks/s: {share:.0%} of it")


if __name__ == "__main__":
    main(*sys.argv[1:])
