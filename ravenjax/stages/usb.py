"""USB read: the control software's copy of encoder counts and input pins (raven2: get_USB_packet.cpp).

Read errors are ignored by the loop: what the board last delivered is used again.
"""

from __future__ import annotations

import numpy as np

from ravenjax.types import Scalar, Setup, Vec, per_arm, record, where


@record
class UsbIn:
    """What came from the boards, one board per arm."""

    enc_val: tuple[Vec, ...]  # per arm 7 int32 counts, after unpacking
    pins: tuple[Scalar, ...]  # per arm int32 input byte of the PLC; bits 6, 7: run level


def init(setup: Setup) -> UsbIn:
    """Boards that have delivered nothing."""
    return UsbIn(per_arm(setup, lambda *_: Vec.full(7, np.int32(0))), per_arm(setup, lambda *_: np.int32(0)))


def step(setup: Setup, state: UsbIn, read: UsbIn, read_ok: tuple[Scalar, ...]) -> UsbIn:
    """The buffers of this cycle: fresh where the board's read succeeded (int32 1), else those of the last cycle."""
    ok = tuple(flag != 0 for flag in read_ok)
    return UsbIn(
        tuple(where(flag, new, old) for flag, new, old in zip(ok, read.enc_val, state.enc_val, strict=True)),
        tuple(where(flag, new, old) for flag, new, old in zip(ok, read.pins, state.pins, strict=True)),
    )
