"""Engine `cuda`: generates CUDA C for a robot's tick, and runs many robots on NVIDIA GPUs.

One thread computes one robot (lane). NVRTC, NVIDIA's compiler library, compiles the code. Lanes
with equal varied parameters form a group, and numbers that are equal in a group are computed once.
All visible GPUs are used. Operations, their order and their rounding equal those of engine `simd`.
Both engines therefore give the same bits if the CPU fuses multiply-adds.
"""

import collections
import contextlib
import dataclasses
import itertools
import queue
from collections.abc import Iterator

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu.code import CudaCode, form_for, typed_column
from ravenjax.engines.gpu.course import BlockCourse, Places, place_lanes, plan_course
from ravenjax.engines.gpu.device import Device
from ravenjax.engines.gpu.kernel import WARP, print_loop
from ravenjax.engines.interface import Block, BlockResult, Motion, Progress, TickProgram, Tracer
from ravenjax.engines.lanes import Lanes, Trunk
from ravenjax.engines.trace_key import Objects
from ravenjax.errors import UserError
from ravenjax.ir.time_loop import split_lanes
from ravenjax.numbers.setup import Precision

WAVES = 4
"""Most times that a block of lanes fills the device."""
SEATS = 2
"""Threads per device: while the lanes of one thread run, the other packs and unpacks its lanes."""
_KERNELS = itertools.count()


class CudaKernel(traced.PrintedKernel):
    """A traced program and its compiled forms, for every device."""

    def __init__(
        self,
        program: TickProgram,
        lanes: int,
        devices: tuple[Device, ...],
        objects: Objects | None = None,
    ):
        super().__init__(program, lanes, {} if objects is None else objects)
        self.devices = devices
        self._seats: queue.Queue[Device] = queue.Queue()
        # Each kernel begins with another device: parallel kernels of one block then use them all.
        first = next(_KERNELS) % len(devices)
        for device in (devices[first:] + devices[:first]) * SEATS:
            self._seats.put(device)
        # As many lanes as run at once on all devices.
        self.branches = sum(gpu.multiprocessors * form_for(gpu).threads for gpu in devices)

    def size(self, rows: int) -> int:
        """Return the lanes of whole warps, at most those of a block; see `interface.Kernel`."""
        return min(self.lanes, -(-rows // WARP) * WARP)

    def prepare(self, block: Block, motion: Motion) -> None:
        """Trace and compile for blocks and motions like these, and load the code on all devices."""
        for device in self.devices:
            self._code(block, motion, self._placed(block, device)[2], device)

    def trunk(
        self, block: Block, motion: Motion, last: int, ends: np.ndarray
    ) -> tuple[Trunk, dict[str, np.ndarray]]:
        """Return snapshots of a golden run before tick `last`, and its outcomes at `ends`, [ends].
        The first lane of `block` is this golden run; see `interface.BranchingKernel`.
        """
        # The smallest number of lanes is a warp. All of them repeat the golden run.
        copies = _repeat_lane(block, np.full(self.size(1), self.program.ticks))
        with self._seat() as device:
            inputs, places, _ = self._placed(copies, device)
            code = self._code(copies, motion, True, device)
            tables, golden = traced.motion_tables(motion), _golden_series(copies, places, True)
            trunk = code.trunk(Lanes(inputs, golden, tables, None), places, last)
        # The outcomes come from a second run. It has a lane for each end, so it needs an end.
        if len(ends):
            return trunk, self.run(_repeat_lane(block, ends), motion).outcomes
        empty = [typed_column(np.zeros(0, np.uint32), dtype) for dtype in code.source.results]
        return trunk, dict(zip(self.forms(block, motion).traced.outcomes, empty, strict=True))

    @contextlib.contextmanager
    def _seat(self) -> Iterator[Device]:
        # Yields a device that fewer than SEATS threads use, and waits for one if necessary.
        device = self._seats.get()
        try:
            yield device
        finally:
            self._seats.put(device)

    def run(self, block: Block, motion: Motion, progress: Progress | None = None) -> BlockResult:
        """Run one block on a device that fewer than SEATS threads of the CPU use now."""
        with self._seat() as device:
            inputs, places, grouped = self._placed(block, device)
            code = self._code(block, motion, grouped, device)
            # Only golden runs return their reference series.
            ticks = self.program.ticks if block.reference is None else 0
            series = np.empty((ticks, code.source.outputs, len(places.thread)), np.uint32)
            tables, golden = traced.motion_tables(motion), _golden_series(block, places, grouped)
            lanes = Lanes(inputs, golden, tables, series if ticks else None)
            course = self._course(block, places, grouped, code)
            outcomes = code.run_course(lanes, places, course, progress)
        names = self.forms(block, motion).traced.outcomes
        return BlockResult(dict(zip(names, outcomes, strict=True)), series.view(np.float32))

    def _placed(self, block: Block, device: Device):
        """Return a block's inputs, the threads of its lanes, and whether lanes run by group. If
        not, all lanes are in group 0, and share only what depends on the tick alone. Lanes run by
        group if this needs no more warps than fit on the device, or at most twice as many warps as
        without groups.
        """
        form = form_for(device)
        inputs, group = self.groups(block)
        group_warps = int((-(-np.bincount(group) // WARP)).sum())
        fewest_warps = -(-len(group) // WARP)
        resident_warps = device.multiprocessors * form.threads // WARP
        grouped = group_warps <= max(resident_warps, 2 * fewest_warps)
        places = place_lanes(group if grouped else np.zeros_like(group), form.threads)
        return inputs, places, grouped

    def _course(self, block: Block, places: Places, grouped: bool, code: CudaCode) -> BlockCourse:
        # Plans which ticks each block of threads runs, and the snapshots from which it starts.
        ends = np.full(len(places.thread), self.program.ticks) if block.ends is None else block.ends
        # Golden runs need the outputs of every tick, so they begin in tick 0. Lanes that are not
        # grouped also begin in tick 0, because lanes of a warp can have different golden runs.
        if block.reference is None or not grouped:
            return plan_course(places, code.form.threads, ends)
        # Lanes of a group have one golden run. `places.first` is one lane of each group.
        trunks = [block.trunk(lane) for lane in places.first.tolist()]
        return plan_course(places, code.form.threads, ends, block.acts, trunks)

    def _code(self, block: Block, motion: Motion, grouped: bool, device: Device) -> CudaCode:
        # Returns the compiled code for this block. `cache` keeps it, and its text on disk.
        cache, form = self.forms(block, motion), form_for(device)

        def print_code():
            loop, shared = cache.traced.without_signals(), len(self.program.varied)
            return print_loop(split_lanes(loop, shared, grouped), form, grouped)

        def compile_code():
            source = cache.printed(("cuda", grouped, form), print_code)
            return CudaCode(source, grouped, device, form, self.objects)

        return cache.code(("cuda", grouped, device), compile_code)


def _repeat_lane(block: Block, ends: np.ndarray) -> Block:
    # Returns a block with the first lane of `block` once for each tick of `ends`, where it stops.
    repeated = block.select_lanes(np.zeros(len(ends), np.int64))
    return dataclasses.replace(repeated, acts=None, ends=None if block.ends is None else ends)


def block_lanes(runs: int, devices: tuple[Device, ...]) -> int:
    """Return the number of lanes of a block, for a campaign of `runs` runs. With enough runs, it is
    a multiple of the lanes that a device runs at once, at most WAVES times as many. Each device
    gets the same number of blocks.
    """
    resident_lanes = devices[0].multiprocessors * form_for(devices[0]).threads
    device_runs = -(-runs // len(devices))
    device_blocks = -(-device_runs // (resident_lanes * WAVES))
    lanes = -(-device_runs // device_blocks)
    multiple = resident_lanes if device_runs > resident_lanes else WARP
    return -(-lanes // multiple) * multiple


def _golden_series(block: Block, places: Places, grouped: bool) -> np.ndarray:
    """Return the reference series of the golden runs, in the layout that the code reads. It is
    [groups, ticks, series] if grouped, else [ticks, series, threads]. If lanes are not compared, it
    is empty, and the code reads zeros.
    """
    if not block.compared:
        return np.zeros((0, 0, 0), np.float32)
    if grouped:
        return np.ascontiguousarray(block.series(places.first).transpose(2, 0, 1))
    return block.series(places.lane)


@dataclasses.dataclass(frozen=True)
class CudaEngine:
    """Engine that uses every visible NVIDIA GPU."""

    objects: Objects | None = None  # cache of compiled code that outlives the process
    name: str = "cuda"

    @property
    def device(self) -> str:
        """The GPUs in words."""
        counts = collections.Counter(device.name for device in cuda_device.visible_gpus())
        return ", ".join(f"{n} x {name}" if n > 1 else name for name, n in counts.items())

    @property
    def threads(self) -> int:
        """Parallel blocks: `SEATS` per GPU."""
        return len(cuda_device.visible_gpus()) * SEATS

    def compile(self, program: TickProgram, runs: int) -> CudaKernel:
        """See `interface.Engine`. Raises UserError if no GPU can run the program."""
        require_float32(program.setup.precision)
        devices = cuda_device.visible_gpus()
        return CudaKernel(program, block_lanes(runs, devices), devices, self.objects)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`. Engine `simd` computes the same bits, so its tracer is used."""
        require_float32(program.setup.precision)
        return SimdEngine(self.objects).tracer(program, lanes)


def require_float32(precision: Precision) -> None:
    """Raise UserError for a precision that this engine does not support."""
    if precision.needs_x64:
        raise UserError("engine 'cuda' computes in float32. For float64 use engine 'xla'")
