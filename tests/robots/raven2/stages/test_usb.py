"""Stale buffers after a failed read, and boards that a failed write leaves as they were."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import usb

SETUP = RavenSetup(arms=("gold", "green"), tools=("r_grasper",) * 2)


@pytest.mark.parametrize("start", [usb.init(SETUP), usb.init_out(SETUP)])
def test_a_failed_transfer_leaves_what_the_board_had(start):
    first, second = (
        type(start)((Vec.full(7, np.int32(counts)),) * 2, (np.int32(pins),) * 2)
        for counts, pins in ((5, 64), (9, 192))
    )
    state = usb.transfer(usb.transfer(start, first, (1, 1)), second, (0, 1))
    counts, pins = vars(state).values()
    assert [[int(x) for x in arm] for arm in counts] == [[5] * 7, [9] * 7]
    assert [int(byte) for byte in pins] == [64, 192]
