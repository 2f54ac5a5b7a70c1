"""Stale buffers after a failed read, and boards that a failed write leaves as they were."""

from __future__ import annotations

import numpy as np

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import usb

SETUP = RavenSetup(arms=("gold", "green"), tools=("r_grasper",) * 2)


def test_a_failed_read_reuses_that_boards_last_counts_and_pins():
    first = usb.UsbIn((Vec.full(7, np.int32(5)),) * 2, (np.int32(64), np.int32(128)))
    second = usb.UsbIn((Vec.full(7, np.int32(9)),) * 2, (np.int32(192), np.int32(192)))
    state = usb.step(SETUP, usb.init(SETUP), first, (1, 1))
    state = usb.step(SETUP, state, second, (0, 1))
    assert [[int(x) for x in arm] for arm in state.enc_val] == [[5] * 7, [9] * 7]
    assert [int(pins) for pins in state.pins] == [64, 192]


def test_a_failed_write_leaves_that_boards_command_and_pins():
    messages = [
        usb.UsbOut((Vec.full(7, np.int32(command)),) * 2, (np.int32(pins),) * 2)
        for command, pins in ((5, 31), (9, 15))
    ]
    boards = usb.write(SETUP, usb.init_out(SETUP), messages[0], (1, 1))
    boards = usb.write(SETUP, boards, messages[1], (0, 1))
    assert [[int(x) for x in arm] for arm in boards.current_cmd] == [[5] * 7, [9] * 7]
    assert [int(pins) for pins in boards.pins] == [31, 15]
