"""USB: what the control software has of the boards, and the boards of it (raven2: get_,
put_USB_packet.cpp).

Transfers that fail are ignored by the loop: what the board last delivered is used again, and what
was last written to it stays. DAC commands and output pins travel in one message.
"""

from __future__ import annotations

import numpy as np

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import per_arm
from ravenjax.numbers.vec import Scalar, Vec, record, where
from ravenjax.robots.raven2.setup import RavenSetup


@record
class UsbIn:
    """What came from the boards, one board per arm."""

    enc_val: tuple[Vec, ...]  # per arm 7 int32 counts, after unpacking
    pins: tuple[Scalar, ...]  # per arm int32 input byte of the PLC; bits 6, 7: run level


@record
class UsbOut:
    """What the boards hold, one board per arm."""

    current_cmd: tuple[Vec, ...]  # per arm 7 int32 DAC counts
    pins: tuple[Scalar, ...]  # per arm int32 output byte to the PLC


def init(setup: RavenSetup) -> UsbIn:
    """Boards that have delivered nothing."""
    return UsbIn(
        per_arm(setup, lambda *_: Vec.full(7, np.int32(0))), per_arm(setup, lambda *_: np.int32(0))
    )


def step(setup: RavenSetup, state: UsbIn, read: UsbIn, read_ok: tuple[Scalar, ...]) -> UsbIn:
    """The buffers of this cycle: fresh where the board's read succeeded (int32 1), else those of
    the last cycle.
    """
    ok = tuple(flag != 0 for flag in read_ok)
    return UsbIn(
        tuple(
            where(flag, new, old)
            for flag, new, old in zip(ok, read.enc_val, state.enc_val, strict=True)
        ),
        tuple(
            where(flag, new, old) for flag, new, old in zip(ok, read.pins, state.pins, strict=True)
        ),
    )


def init_out(setup: RavenSetup) -> UsbOut:
    """Boards that nothing was written to."""
    zero = jnp.int32(0)
    return UsbOut(per_arm(setup, lambda *_: Vec.full(7, zero)), per_arm(setup, lambda *_: zero))


def write(setup: RavenSetup, held: UsbOut, message: UsbOut, write_ok: tuple[Scalar, ...]) -> UsbOut:
    """What the boards hold after this cycle: the message where the write succeeded (int32 1),
    else as before.
    """
    ok = tuple(flag != 0 for flag in write_ok)
    return UsbOut(
        tuple(
            where(flag, new, old)
            for flag, new, old in zip(ok, message.current_cmd, held.current_cmd, strict=True)
        ),
        tuple(
            where(flag, new, old)
            for flag, new, old in zip(ok, message.pins, held.pins, strict=True)
        ),
    )
