"""Stores the inputs of a control cycle as a row of bytes that compiled code reads.

The bytes of a datagram are copied from the network into the row without a conversion.
"""

from typing import Any

import numpy as np

from ravenjax.engines.cpu.memory import BufferLayout
from ravenjax.engines.cpu.transition import RecordKind
from ravenjax.numbers import Vec, tree
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console import packet as packets
from ravenjax.robots.raven2.console.packet import DELTAS, QUATS, SIZE_BYTES, U_STRUCT, Packet
from ravenjax.robots.raven2.loop.control import Inputs
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import usb


def row_type(setup: RavenSetup) -> np.dtype:
    """Return the NumPy type of one row: the fields of a datagram, and the other inputs of a cycle.

    Quaternions have the floating-point type in which they are evaluated. With the original
    software's precision this is float64, as in the datagram, which can then be copied.
    """
    arms, wide = len(setup.arms), np.dtype(setup.precision.wide)
    fields: list[Any] = [
        (name, wide if name in QUATS else dtype, *shape) for name, dtype, *shape in U_STRUCT.descr
    ]
    row: list[Any] = [
        ("size", "<i4"),  # before the packet, which aligns the quaternions
        ("packet", fields),
        ("received", "<i4"),
        ("enc_val", "<i4", (arms, 7)),
        ("pins", "<i4", arms),
        ("read_ok", "<i4", arms),
    ]
    # Rows are padded to whole multiples of 8 bytes, so that each row is aligned.
    return np.dtype([*row, ("padding", "u1", -np.dtype(row).itemsize % 8)])


def row_kind(setup: RavenSetup) -> RecordKind:
    """Return the record `Inputs` that compiled code reads from a row, with each number's offset."""
    # slots: index of each arm in the pairs of a datagram, 0 for gold and 1 for green
    row, slots = row_type(setup), [ARMS.index(arm) for arm in setup.arms]
    offset_of = _byte_offsets(row)
    # The record `Inputs` with the byte offset of each number in place of the number.
    packet = offset_of["packet"]
    offsets = Inputs(
        Packet(
            received=offset_of["received"],
            size=offset_of["size"],
            sequence=packet["sequence"],
            delta=tuple(Vec(packet[name][slot] for name in DELTAS) for slot in slots),
            quat=tuple(Vec(packet[name][slot] for name in QUATS) for slot in slots),
            grasp=tuple(packet["grasp"][slots]),
            surgeon_mode=packet["surgeon_mode"],
        ),
        usb.UsbIn(tuple(map(Vec, offset_of["enc_val"])), tuple(offset_of["pins"])),
        tuple(offset_of["read_ok"]),
    )
    boards = usb.init(setup)
    # The same record, with leaves in the same order, for the types: `read_ok` has those of `pins`.
    example = Inputs(packets.empty_packet(setup), boards, read_ok=boards.pins)
    record = RecordKind.of(example).record
    types = tuple(map(str, tree.tree_leaves(record)))
    offsets_in_row = tuple(map(int, tree.tree_leaves(offsets)))
    return RecordKind(record, BufferLayout(types, offsets_in_row, row.itemsize))


def _byte_offsets(dtype: np.dtype, start: int = 0) -> Any:
    # Returns the byte offset of each number of a NumPy type, as nested dicts of arrays.
    if dtype.fields:
        return {
            name: _byte_offsets(inner, start + offset)
            for name, (inner, offset, *_) in dtype.fields.items()
        }
    index = np.arange(np.prod(dtype.shape, dtype=int)).reshape(dtype.shape)
    return start + dtype.base.itemsize * index


class InputRows:
    """Input rows of several cycles, which the caller fills before a cycle runs."""

    def __init__(self, setup: RavenSetup, cycles: int = 1):
        self.setup, dtype = setup, row_type(setup)
        rows = np.zeros(cycles, dtype)
        self.bytes = rows.view(np.uint8).reshape(cycles, dtype.itemsize)
        self.enc_val: np.ndarray = rows["enc_val"]  # [cycles, arms, 7]
        self.pins: np.ndarray = rows["pins"]  # [cycles, arms]
        self.read_ok: np.ndarray = rows["read_ok"]  # [cycles, arms]
        self._packets, self._received, self._sizes = rows["packet"], rows["received"], rows["size"]
        self._no_packet = np.zeros((), self._packets.dtype)
        self._no_packet["Qw"] = 1.0  # no rotation

    def enter(self, packet: bytes | bytearray | memoryview | Packet | None, cycle: int = 0) -> None:
        """Write the packet of a cycle: a datagram of any length, a checked packet, or none.
        The missing bytes of a short datagram become 0, and the software drops such a datagram.
        """
        if packet is None:
            self._packets[cycle] = self._no_packet
            self._received[cycle], self._sizes[cycle] = 0, SIZE_BYTES[self.setup.console]
        elif isinstance(packet, Packet):
            self._packets[cycle] = self._no_packet
            packets.fill_fields(self._packets[cycle], packet, self.setup.arms)
            self._received[cycle], self._sizes[cycle] = packet.received, packet.size
        else:
            data = bytes(packet[: U_STRUCT.itemsize]).ljust(U_STRUCT.itemsize, b"\0")
            # A float64 of the datagram may be too large for the quaternions' type
            with np.errstate(over="ignore"):
                self._packets[cycle] = np.frombuffer(data, U_STRUCT)[0]
            self._received[cycle], self._sizes[cycle] = 1, len(packet)
