"""Simulates USB transfers between control software and boards.

Source: raven2 get_USB_packet.cpp, put_USB_packet.cpp. The software ignores failed transfers. After
a failed read it uses the last delivered values again. After a failed write the board keeps the last
written values. DAC commands and output pins are in one message.
"""

from typing import TypeVar

import numpy as np

from ravenjax.numbers import Scalar, Vec, for_each_arm, record, where
from ravenjax.robots.raven2.setup import PerArm, RavenSetup

AnyUsb = TypeVar("AnyUsb", "UsbIn", "UsbOut")


@record
class UsbIn:
    """Values last read from the boards, one board per arm."""

    enc_val: PerArm[Vec]  # 7 int32 counts, after unpacking
    pins: PerArm[Scalar]  # int32 input byte of the PLC; bits 6, 7: run level


@record
class UsbOut:
    """Values on the boards, one board per arm."""

    current_cmd: PerArm[Vec]  # 7 int32 DAC counts
    pins: PerArm[Scalar]  # int32 output byte to the PLC


def init(setup: RavenSetup) -> UsbIn:
    """Return the values before the first read."""
    zero = np.int32(0)
    return UsbIn(for_each_arm(setup, Vec.full(7, zero)), for_each_arm(setup, zero))


def transfer_values(held: AnyUsb, message: AnyUsb, ok: PerArm[Scalar]) -> AnyUsb:
    """Return the values on the receiving side after this cycle.
    ok: int32 flag of each board, 1 if its transfer succeeded: the message then replaces `held`.
    """
    succeeded = tuple(flag != 0 for flag in ok)
    new, old = vars(message), vars(held)
    return type(held)(*(tuple(map(where, succeeded, new[name], old[name])) for name in new))
