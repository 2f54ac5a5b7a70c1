"""The study of a healthy robot's report: words, and headlines of made-up runs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from ravenjax.stats.bootstrap import units
from studies import catalogue
from studies.healthy import headlines, robot
from studies.healthy.headlines import FULL, HALF, OFF, ScaledFaults


def made_up(extra: int) -> ScaledFaults:
    """Forty faults of eight kinds; with all errors `extra` more of them have each event."""
    events = {}
    for scale, more in ((OFF, 0), (HALF, 0), (FULL, extra)):
        hit = np.arange(40) % 4 == 0
        hit[np.flatnonzero(~hit)[:more]] = True
        events[scale] = pd.DataFrame(dict.fromkeys(headlines.SHARES, hit))
    return ScaledFaults(events, units.units(np.arange(40) % 8))


def test_a_change_is_that_of_the_same_faults() -> None:
    faults = made_up(4)
    assert faults.share("evaded", OFF).value == pytest.approx(0.25)
    assert faults.change("evaded", FULL).value == pytest.approx(0.1)
    assert faults.change("evaded", HALF).value == 0.0
    assert faults.change("evaded", FULL).low < 0.1 < faults.change("evaded", FULL).high


def test_a_mean_over_robots_has_an_interval_over_robots() -> None:
    values = pd.DataFrame({"rms": np.random.default_rng(0).normal(2.0, 0.5, 100)})
    one = headlines.mean(values, "rms")
    assert one.low < values["rms"].mean() == pytest.approx(one.value)
    assert one.high - one.low == pytest.approx(4 * 0.05, rel=0.2)


def test_the_tables_name_every_headline() -> None:
    table = robot._with_faults(made_up(2))
    assert [row[0] for row in table.rows] == list(headlines.SHARES.values())
    assert {row[3].partition(" ")[0] for row in table.rows} == {"30.0"}


def test_its_campaigns_draw_robots_and_run_each_without_its_errors_too() -> None:
    import ravenjax as rj

    study = catalogue.find("healthy_robot")
    for variant in study.variants:
        config = rj.load_campaign(variant.campaign, variant.overrides)
        assert config.campaign.kinematic_errors == "measured"
        assert config.cross[headlines.SCALE].values == headlines.SCALES
        assert (
            tuple(cue.threshold_m * 1e3 for cue in config.haptics.cues()) == headlines.THRESHOLDS_MM
        )
