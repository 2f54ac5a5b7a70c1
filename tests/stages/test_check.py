"""The history that a check leaves."""

from __future__ import annotations

import math

import numpy as np

from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import check


def history(entries):
    seen = check.init(RavenSetup())
    for tick, (tripped, margin) in enumerate(entries):
        seen = check.update(seen, np.int32(tick), np.bool_(tripped), margin)
    return int(seen.first_tick), int(seen.count), float(seen.margin)


def test_a_check_that_never_trips():
    assert history([(False, 3.0), (False, 1.0), (False, 2.0)]) == (-1, 0, 1.0)


def test_first_trip_count_and_smallest_margin():
    assert history([(False, 3.0), (True, -1.0), (False, 5.0), (True, -0.5)]) == (1, 2, -1.0)


def test_nan_and_missing_margins_leave_the_margin_alone():
    assert history([(True, math.nan), (True, None)]) == (0, 2, math.inf)
