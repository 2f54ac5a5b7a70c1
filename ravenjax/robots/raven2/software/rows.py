"""What enters the control software in one cycle, as a row of bytes that compiled code reads where
it stands.

A datagram lies in it as it came over the wire: nobody unpacks it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.engines.cpu.memory import RowLayout
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, U_STRUCT, Packet
from ravenjax.robots.raven2.loop.control import Inputs
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.usb import UsbIn

_WIRE = U_STRUCT.itemsize
_MOVES, _TURNS = ("delx", "dely", "delz"), ("Qx", "Qy", "Qz", "Qw")


def row_type(setup: RavenSetup) -> np.dtype:
    """One row; quaternions in the width that they are evaluated in, which is a datagram's own in
    the original.
    """
    arms, wide = len(setup.arms), np.dtype(setup.precision.wide)
    fields: list[Any] = [
        (name, wide if name in _TURNS else dtype, *shape) for name, dtype, *shape in U_STRUCT.descr
    ]
    row: list[Any] = [
        ("size", "<i4"),  # before the packet: aligns the quaternions
        ("packet", fields),
        ("received", "<i4"),
        ("enc_val", "<i4", (arms, 7)),
        ("pins", "<i4", arms),
        ("read_ok", "<i4", arms),
    ]
    plain = np.dtype(row)
    return np.dtype([*row, ("rest", "u1", -plain.itemsize % 8)])


def row_layout(setup: RavenSetup, inputs: Inputs) -> RowLayout:
    """Where the numbers of `inputs`, an example, stand in a row."""
    row = row_type(setup)
    places = _offsets(row)
    wire = {
        name: (places["packet"] + offset, row["packet"][name].base)
        for name, offset in _offsets(row["packet"]).items()
    }
    slots = [ARMS.index(arm) for arm in setup.arms]

    def of_packet(name: str, slot: int = 0) -> int:
        start, dtype = wire[name]
        return start + slot * dtype.itemsize

    def numbers(name: str, first: int, count: int) -> Vec:
        return Vec(places[name] + 4 * (first + k) for k in range(count))

    arms = range(len(slots))
    offsets = Inputs(
        Packet(
            received=places["received"],
            size=places["size"],
            sequence=of_packet("sequence"),
            delta=tuple(Vec(of_packet(name, slot) for name in _MOVES) for slot in slots),
            quat=tuple(Vec(of_packet(name, slot) for name in _TURNS) for slot in slots),
            grasp=tuple(of_packet("grasp", slot) for slot in slots),
            surgeon_mode=of_packet("surgeon_mode"),
        ),
        UsbIn(
            tuple(numbers("enc_val", 7 * i, 7) for i in arms), tuple(numbers("pins", 0, len(slots)))
        ),
        tuple(numbers("read_ok", 0, len(slots))),
    )
    types = tuple(str(leaf.dtype) for leaf in jax.tree.leaves(inputs))
    return RowLayout(types, tuple(jax.tree.leaves(offsets)), row.itemsize)


def _offsets(row: np.dtype) -> dict[str, int]:
    return {name: offset for name, (_, offset, *_) in (row.fields or {}).items()}


class InputRows:
    """Rows of some cycles, to be filled: each wholly, before it is used."""

    def __init__(self, setup: RavenSetup, cycles: int = 1) -> None:
        self.setup, dtype = setup, row_type(setup)
        raw = np.zeros(cycles * dtype.itemsize + 8, np.uint8)
        start = -raw.ctypes.data % 8
        flat = raw[start : start + cycles * dtype.itemsize]
        rows = flat.view(dtype)
        self.bytes = flat.reshape(cycles, dtype.itemsize)
        self.enc_val: np.ndarray = rows["enc_val"]  # [cycles, arms, 7]
        self.pins: np.ndarray = rows["pins"]  # [cycles, arms]
        self.read_ok: np.ndarray = rows["read_ok"]  # [cycles, arms]
        self._packets: np.ndarray = rows["packet"]
        self._as_sent = self._packets.dtype == U_STRUCT
        self._stride = dtype.itemsize
        places = _offsets(dtype)
        self._wire, self._received = places["packet"], places["received"] // 4
        self._memory = (flat if cycles else raw).data
        self._words = self._memory.cast("i")
        still = np.zeros((), self._packets.dtype)
        still["Qw"] = 1.0
        self._still, self._still_bytes = still, SIZE_BYTES[setup.console]

    def silence(self, cycle: int = 0) -> None:
        """No packet."""
        self._packets[cycle] = self._still
        self._came(cycle, 0, self._still_bytes)

    def datagram(self, data: bytes | bytearray | memoryview, cycle: int = 0) -> None:
        """A packet of increments in a datagram of any length; what a short one lacks reads 0,
        and it is dropped.
        """
        size = len(data)
        if size != _WIRE:
            data = bytes(data[:_WIRE]).ljust(_WIRE, b"\0")
        if self._as_sent:
            start = cycle * self._stride + self._wire
            self._memory[start : start + _WIRE] = data
        else:
            with np.errstate(over="ignore"):
                self._packets[cycle] = np.frombuffer(data, U_STRUCT)[0]
        self._came(cycle, 1, size)

    def packet(self, packet: Packet, cycle: int = 0) -> None:
        """A packet of checked numbers."""
        self._packets[cycle] = self._still
        fields = self._packets[cycle]
        fields["sequence"] = packet.sequence % 2**32
        fields["surgeon_mode"] = packet.surgeon_mode
        for i, arm in enumerate(self.setup.arms):
            slot = ARMS.index(arm)
            numbers = zip((*_MOVES, *_TURNS), (*packet.delta[i], *packet.quat[i]), strict=True)
            with np.errstate(over="ignore"):
                for name, value in numbers:
                    fields[name][slot] = value
            fields["grasp"][slot] = packet.grasp[i]
        self._came(cycle, packet.received, packet.size)

    def _came(self, cycle: int, received: int, size: int) -> None:
        first = cycle * self._stride // 4
        self._words[first] = size
        self._words[first + self._received] = received
