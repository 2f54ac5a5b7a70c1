"""What the control software wrote, in one cycle or in many."""

from __future__ import annotations

import dataclasses
import functools
import struct
from typing import Any

import numpy as np

from ravenjax.engines.cpu.memory import stored
from ravenjax.engines.cpu.record_kind import RecordKind
from ravenjax.numbers.lazy import jax
from ravenjax.robots.raven2.loop import control


@dataclasses.dataclass(frozen=True)
class Output:
    """What one cycle wrote."""

    dac: tuple[tuple[int, ...], ...]  # per arm 7 signed counts, as written to USB
    output_pins: int  # byte to the PLC: run level (bits 0, 1), FP (2), READY (3), watchdog (4)
    _kind: RecordKind = dataclasses.field(repr=False, compare=False)
    _row: bytes = dataclasses.field(repr=False, compare=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """Everything that crossed the seams of the control software in this cycle."""
        return self._kind.read(self._row)


@dataclasses.dataclass(frozen=True, eq=False)
class Outputs:
    """What each of some cycles wrote."""

    dac: np.ndarray  # [cycles, arms, 7] int32, signed counts, as written to USB
    output_pins: np.ndarray  # [cycles] int32, bytes to the PLC
    _kind: RecordKind = dataclasses.field(repr=False)
    _rows: np.ndarray = dataclasses.field(repr=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """Everything that crossed the seams of the control software, each number an array
        [cycles].
        """
        return jax.tree.unflatten(
            self._kind.tree, [self._column(k) for k in range(len(self._kind.types))]
        )

    def _column(self, k: int) -> np.ndarray:
        return column(self._kind, self._rows, k)


class OutputReader:
    """Makes `Output` and `Outputs` of what cycles left in memory."""

    def __init__(self, signals: RecordKind) -> None:
        self.kind = signals
        places = jax.tree.unflatten(signals.tree, range(len(signals.types)))
        self._dac_places = [list(arm.current_cmd_written) for arm in places.arms]
        self._pins_place: int = places.pins_out
        offsets = signals.layout.offsets
        self._dac = struct.Struct("=7i")
        self._dac_offsets = [offsets[first] for first, *_ in self._dac_places]
        self._pins, self._pins_offset = struct.Struct("=i"), offsets[self._pins_place]

    def one(self, row: bytes) -> Output:
        """Of a single cycle."""
        unpack = self._dac.unpack_from
        dac = tuple([unpack(row, offset) for offset in self._dac_offsets])
        return Output(dac, self._pins.unpack_from(row, self._pins_offset)[0], self.kind, row)

    def many(self, rows: np.ndarray) -> Outputs:
        """Of some cycles, [cycles, bytes]."""
        commands = [[column(self.kind, rows, k) for k in arm] for arm in self._dac_places]
        dac = np.stack([np.stack(arm, axis=-1) for arm in commands], axis=1)
        return Outputs(dac, column(self.kind, rows, self._pins_place).copy(), self.kind, rows)


def column(kind: RecordKind, rows: np.ndarray, k: int) -> np.ndarray:
    """The k-th number of each row."""
    dtype: Any = stored(kind.types[k])
    start = kind.layout.offsets[k]
    numbers = rows[:, start : start + dtype.itemsize].view(dtype)[:, 0]
    return numbers != 0 if kind.types[k] == "bool" else numbers
