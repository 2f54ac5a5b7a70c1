"""The machine's peak, measured: independent fused multiply-adds in registers, all cores or the
whole GPU at once.

Counted in operations of single numbers, a fused multiply-add as one: the same count as that of a
tick's operations. Many short bursts are timed and the best is taken, so that other processes on the
machine do not lower it. A tick's selects and integer operations may go through further units, its
divisions and roots take several turns of one: the ratio says how near the tick comes to the rate of
multiply-adds, no more.
"""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ravenjax.bench import clock, machine
from ravenjax.engines.cpu import jit

CHAINS = 12
"""Independent chains a thread: more than latency times pipes (4 x 2), few enough for 16
registers.
"""
_CPU_ROUNDS, _GPU_ROUNDS = 1_000_000, 4096
_GPU_THREADS, _GPU_BLOCKS, _GPU_LAUNCHES = 256, 64, 8  # of a block; blocks a multiprocessor

_CUDA = f"""
extern "C" __global__ void peak(float* room, int rounds) {{
  float a = room[0] + 0.5f, b = room[1] + 1.0f, x[{CHAINS}];
  #pragma unroll
  for (int k = 0; k < {CHAINS}; ++k) x[k] = (float)(threadIdx.x + k);
  #pragma unroll 4
  for (int i = 0; i < rounds; ++i)
    #pragma unroll
    for (int k = 0; k < {CHAINS}; ++k) x[k] = fmaf(x[k], a, b);
  float sum = 0.0f;
  for (int k = 0; k < {CHAINS}; ++k) sum += x[k];
  if (sum == 12345.0f) room[2] = sum;
}}
"""


def measure(seconds: float, engine: str) -> float:
    """Operations a second of what a printing engine runs on. Raises UserError where there is
    none.
    """
    return cuda() if engine == "cuda" else cpu(machine.usable_cpus(), enough_s=seconds)


def cpu(
    threads: int, repeats: int = 500, rounds: int = _CPU_ROUNDS, enough_s: float = 2.0
) -> float:
    """Operations a second of `threads` cores."""
    width = jit.host().width
    module = jit.compile(_ir(width, "fma" in jit.host().features or width == 4), ["peak"])
    peak = module.function("peak", [ctypes.c_void_p, ctypes.c_int64])
    rooms = [np.array([0.5, 1.0, 0.0], np.float32) for _ in range(threads)]
    with ThreadPoolExecutor(threads) as pool:
        timing = clock.timed(
            lambda: list(pool.map(lambda room: peak(room.ctypes.data, rounds), rooms)),
            repeats,
            enough_s,
        )
    return threads * rounds * CHAINS * width / timing.best_s


def cuda(repeats: int = 5) -> float:
    """Operations a second of all visible GPUs. Raises UserError where there is none."""
    from ravenjax.engines.gpu import device as cuda_device

    def one(device: cuda_device.Device) -> float:
        module = cuda_device.DeviceModule(
            device, cuda_device.compile(_CUDA, device.architecture, ())
        )
        function, blocks = module.function("peak"), device.multiprocessors * _GPU_BLOCKS
        with cuda_device.DeviceSession(device) as session:
            room = session.room(4)

            def work() -> None:
                for _ in range(_GPU_LAUNCHES):
                    session.launch(function, blocks, _GPU_THREADS, session.main, room, _GPU_ROUNDS)
                session.finish(session.mark(session.main))

            timing = clock.timed(work, repeats, 5.0)
        return _GPU_LAUNCHES * blocks * _GPU_THREADS * _GPU_ROUNDS * CHAINS / timing.best_s

    return sum(map(one, cuda_device.devices()))


def _ir(width: int, fused: bool) -> str:
    """void peak(float room[3], long rounds)."""
    wide, chains = f"<{width} x float>", range(CHAINS)
    call = f"call {wide} @llvm.fma.v{width}f32({wide} %x{{k}}, {wide} %a, {wide} %b)"
    step = call if fused else f"fadd {wide} %x{{k}}, %b"
    return "\n".join(
        [
            f"declare {wide} @llvm.fma.v{width}f32({wide}, {wide}, {wide})",
            "define void @peak(ptr %room, i64 %rounds) {",
            "entry:",
            "  %second = getelementptr float, ptr %room, i64 1",
            "  %third = getelementptr float, ptr %room, i64 2",
            "  %a1 = load float, ptr %room",
            "  %b1 = load float, ptr %second",
            *(f"  %{n}0 = insertelement {wide} poison, float %{n}1, i64 0" for n in "ab"),
            *(
                f"  %{n} = shufflevector {wide} %{n}0, {wide} poison, <{width} x i32>"
                " zeroinitializer"
                for n in "ab"
            ),
            "  br label %loop",
            "loop:",
            "  %i = phi i64 [0, %entry], [%next, %loop]",
            *(
                f"  %x{k} = phi {wide} [splat (float {k}.0), %entry], [%y{k}, %loop]"
                for k in chains
            ),
            *(f"  %y{k} = {step.format(k=k)}" for k in chains),
            "  %next = add i64 %i, 1",
            "  %more = icmp slt i64 %next, %rounds",
            "  br i1 %more, label %loop, label %done",
            "done:",
            *(
                f"  %s{k + 1} = fadd {wide} {f'%s{k}' if k else 'zeroinitializer'}, %y{k}"
                for k in chains
            ),
            f"  %out = extractelement {wide} %s{CHAINS}, i64 0",
            "  store float %out, ptr %third",
            "  ret void",
            "}",
        ]
    )
