"""Engine `cuda`: the tick printed as CUDA C with the time loop inside, compiled by NVRTC, one robot
a thread.

Lanes that share their varied parameters form a group, as in engine `simd`: what does not differ
between them is computed once for all of them. Every visible GPU takes blocks. The same operations
in the same order as in `simd`, each rounded alike: where the CPU fuses multiply-adds, too, both
engines give the same bits.
"""

from __future__ import annotations

import collections
import dataclasses
import functools
import itertools
import queue
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu.code import CudaCode, form_for, typed
from ravenjax.engines.gpu.course import BlockCourse, Places, between, place, whole
from ravenjax.engines.gpu.device import Cubins, Device
from ravenjax.engines.gpu.kernel import WARP
from ravenjax.engines.interface import Block, BlockResult, Progress, TickProgram, Tracer
from ravenjax.engines.lanes import Lanes, Trunk
from ravenjax.errors import UserError
from ravenjax.numbers import tree
from ravenjax.numbers.setup import Precision

WAVES = 4
"""Times that a block of lanes fills the device, at most."""
SEATS = 2
"""Threads that use one device: while one's lanes run, the other packs and unpacks its own."""
_KERNELS = itertools.count()


class CudaKernel:
    """A traced program and its compiled forms, for every device."""

    def __init__(
        self,
        program: TickProgram,
        lanes: int,
        devices: tuple[Device, ...],
        cubins: Cubins | None = None,
        signals: bool = False,
    ) -> None:
        """signals: every signal goes out in each tick."""
        self.program, self.lanes, self.signals, self.devices = program, lanes, signals, devices
        self._cubins: Cubins = {} if cubins is None else cubins
        self._forms: traced.Forms | None = None
        self._seats: queue.Queue[Device] = queue.Queue()
        first = next(_KERNELS) % len(
            devices
        )  # kernels that run one block each, side by side, use all devices
        for device in (devices[first:] + devices[:first]) * SEATS:
            self._seats.put(device)
        self.branches = 0 if signals else wave(devices)

    def size(self, rows: int) -> int:
        """See `interface.Kernel`: whole warps, but no more than a block has where that is less."""
        return min(self.lanes, -(-rows // WARP) * WARP)

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        """Trace and compile for blocks and motions like these, and load the code on every
        device.
        """
        inputs = traced.inputs(self.program, block)
        for device in self.devices:
            self._code(block, motion, self._placed(inputs, device)[1], device)

    def run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None = None
    ) -> BlockResult:
        """See `interface.Kernel`. A block may have any number of lanes; each is computed, alike
        or not.
        """
        return self._run(block, motion, progress)[0]

    def run_signals(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[BlockResult, Any]:
        """As `run`, and every signal of the first lane, each leaf [ticks]."""
        result, out = self._run(block, motion, None)
        assert self._forms is not None
        return result, self._forms.traced.signals_of(
            out, lambda column, dtype: typed(column, dtype.name)
        )

    def trunk(
        self, block: Block, motion: tuple[np.ndarray, ...], last: int, ends: np.ndarray
    ) -> tuple[Trunk, dict[str, np.ndarray]]:
        """See `interface.Kernel`."""
        golden_run = _ending(block, np.full(self.size(1), self.program.ticks))
        inputs, tables = traced.inputs(self.program, golden_run), _joined(motion)
        device = self._seats.get()
        try:
            places, code = (
                self._placed(inputs, device)[0],
                self._code(golden_run, motion, True, device),
            )
            trunk = code.trunk(
                Lanes(inputs, _given(golden_run, places, True), tables, None), places, last
            )
        finally:
            self._seats.put(device)
        if len(ends):
            return trunk, self.run(_ending(block, ends), motion).outcomes
        assert self._forms is not None
        none = [typed(np.zeros(0, np.uint32), dtype) for dtype in code.source.results]
        return trunk, dict(zip(self._forms.traced.outcomes, none, strict=True))

    def _run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None
    ) -> tuple[BlockResult, np.ndarray]:
        inputs = traced.inputs(self.program, block)
        tables = _joined(motion)
        device = self._seats.get()
        try:
            places, grouped = self._placed(inputs, device)
            code = self._code(block, motion, grouped, device)
            assert self._forms is not None
            own, ticks, lanes = self._forms.traced, self.program.ticks, len(places.thread)
            series = own.series
            keep = self.signals or block.reference is None
            out = np.empty((ticks, len(code.source.outputs), lanes), np.uint32) if keep else None
            tick_inputs = _given(block, places, grouped)
            course = self._course(block, places, grouped, code, keep)
            outcomes = code.follow(
                Lanes(inputs, tick_inputs, tables, out), places, course, progress
            )
        finally:
            self._seats.put(device)
        if out is None:
            out = np.empty((0, series, lanes), np.uint32)
        return (
            BlockResult(
                dict(zip(own.outcomes, outcomes, strict=True)), out[:, :series].view(np.float32)
            ),
            out,
        )

    def _placed(self, inputs: list[np.ndarray], device: Device) -> tuple[Places, bool]:
        """Where lanes are computed, and whether by group: if that fits the device at once, or
        wastes half at most.
        """
        form = form_for(device)
        lanes = (
            len(inputs[0]) if inputs else self.lanes
        )  # without faults and parameters, a block says no number
        group = _groups(inputs[: len(self.program.varied)], lanes)
        warps = int((-(-np.bincount(group) // WARP)).sum())
        at_once = device.multiprocessors * form.threads // WARP
        grouped = warps <= max(at_once, 2 * -(-len(group) // WARP))
        return place(group if grouped else np.zeros_like(group), form.threads), grouped

    def _course(
        self, block: Block, places: Places, grouped: bool, code: CudaCode, keep: bool
    ) -> BlockCourse:
        """keep: what goes out in each tick is asked for, from the first on."""
        lanes, ticks = len(places.thread), self.program.ticks
        if keep:
            return whole(places, code.form.threads, ticks, block.ends)
        acts = np.zeros(lanes, np.int32) if block.acts is None else block.acts
        ends = np.full(lanes, ticks) if block.ends is None else block.ends
        trunks = [block.trunk(lane) if grouped else None for lane in places.first.tolist()]
        return between(places, code.form.threads, acts, ends, trunks)

    def _code(
        self, block: Block, motion: tuple[np.ndarray, ...], grouped: bool, device: Device
    ) -> CudaCode:
        self._forms = forms = self._forms or traced.forms(self.program, block, motion, self._cubins)

        def make() -> CudaCode:
            loop = forms.traced.loop if self.signals else forms.traced.without_signals()
            shared, form = len(self.program.varied), form_for(device)
            printed = functools.partial(forms.printed, ("cuda", self.signals, grouped, form))
            return CudaCode(loop, shared, grouped, device, form, self._cubins, printed)

        return forms.code(("cuda", self.signals, grouped, device), make)


def wave(devices: tuple[Device, ...]) -> int:
    """Lanes that run at once on all devices."""
    return sum(device.multiprocessors * form_for(device).threads for device in devices)


def _joined(motion: tuple[np.ndarray, ...]) -> np.ndarray:
    """The columns of the motion one after the other."""
    return np.concatenate([np.ascontiguousarray(column) for column in motion])


def _ending(block: Block, ends: np.ndarray) -> Block:
    """The first lane of a block, once for each of `ends`."""
    first = np.zeros(len(ends), np.int64)
    return dataclasses.replace(
        block,
        varied={path: np.asarray(values)[first] for path, values in block.varied.items()},
        faults=tree.mapped(lambda leaf: np.asarray(leaf)[first], block.faults),
        golden=first if block.golden is None else block.golden[first],
        acts=None,
        ends=None if block.ends is None else ends,
    )


def block_lanes(runs: int, devices: tuple[Device, ...]) -> int:
    """Lanes of a block: each device gets as many blocks, and all but the last lanes fill it a
    whole number of times.
    """
    wave = devices[0].multiprocessors * form_for(devices[0]).threads
    share = -(-runs // len(devices))
    blocks = -(-share // (wave * WAVES))
    unit = wave if share > wave else WARP
    return -(-share // blocks // unit) * unit


def _groups(columns: list[np.ndarray], lanes: int) -> np.ndarray:
    """Number of the group that each lane is in: equal rows of these columns, bit by bit."""
    group = np.zeros(lanes, np.int64)
    for column in columns:
        pattern = np.ascontiguousarray(column).view(f"u{column.dtype.itemsize}")
        _, value = np.unique(pattern, return_inverse=True)
        _, group = np.unique(group * (int(value.max()) + 1) + value, return_inverse=True)
    return group


def _given(block: Block, places: Places, grouped: bool) -> np.ndarray:
    """The golden runs' series as the code reads it; empty, and then zero, where there are none."""
    if not block.compared:
        return np.zeros((0, 0, 0), np.float32)
    if grouped:
        return np.ascontiguousarray(block.series(places.first).transpose(2, 0, 1))
    return block.series(places.lane)


@dataclasses.dataclass(frozen=True)
class CudaEngine:
    """Every visible NVIDIA GPU."""

    cubins: Cubins | None = None  # compiled code kept between processes
    name: str = "cuda"

    @property
    def device(self) -> str:
        """The GPUs in words."""
        counts = collections.Counter(device.name for device in cuda_device.devices())
        return ", ".join(
            f"{count} x {name}" if count > 1 else name for name, count in counts.items()
        )

    @property
    def threads(self) -> int:
        """Blocks side by side: `SEATS` a GPU."""
        return len(cuda_device.devices()) * SEATS

    def compile(self, program: TickProgram, runs: int) -> CudaKernel:
        """See `interface.Engine`. Raises UserError where no GPU can run it."""
        require_float32(program.setup.precision)
        devices = cuda_device.devices()
        return CudaKernel(
            traced.printable(program), block_lanes(runs, devices), devices, self.cubins
        )

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`; the same bits as in a campaign."""
        require_float32(program.setup.precision)
        return Tracer(
            CudaKernel(
                traced.printable(program), 1, cuda_device.devices()[:1], self.cubins, signals=True
            )
        )


def require_float32(precision: Precision) -> None:
    """Raise UserError for a precision that this engine does not have."""
    if precision.needs_x64:
        raise UserError("engine 'cuda' computes in float32; for float64 take engine 'xla'")
