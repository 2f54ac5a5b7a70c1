"""The study of a healthy robot's report: words, and headlines of made-up runs."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.stats import units
from studies import healthy_robot
from studies.healthy_robot import FULL, HALF, OFF, ScaledFaults


def made_up(extra: int) -> ScaledFaults:
    """Forty faults of eight kinds; with all errors `extra` more of them have each event."""
    events = {}
    for scale, more in ((OFF, 0), (HALF, 0), (FULL, extra)):
        hit = np.arange(40) % 4 == 0
        hit[np.flatnonzero(~hit)[:more]] = True
        events[scale] = pd.DataFrame(dict.fromkeys(healthy_robot.SHARES, hit))
    return ScaledFaults(events, units.group_units(np.arange(40) % 8))


def test_a_change_is_that_of_the_same_faults() -> None:
    faults = made_up(4)
    assert faults.share("evaded", OFF).value == pytest.approx(0.25)
    assert faults.change("evaded", FULL).value == pytest.approx(0.1)
    assert faults.change("evaded", HALF).value == 0.0
    assert faults.change("evaded", FULL).low < 0.1 < faults.change("evaded", FULL).high


def test_a_mean_over_robots_has_an_interval_over_robots() -> None:
    values = np.random.default_rng(0).normal(2.0, 0.5, 100)
    one = healthy_robot.mean(values)
    assert one.low < values.mean() == pytest.approx(one.value)
    assert one.high - one.low == pytest.approx(4 * 0.05, rel=0.2)
