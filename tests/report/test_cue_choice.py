"""What the data choose of the haptic sets, or what they need to choose."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import synthetic_results as synthetic
from cue_results import FRAME, HAZARD, MANIFEST, ROWS, RUNS, TABLE, missed

from ravenjax.report import page
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import cues
from ravenjax.stats.alarms.choice import AlarmCounts
from ravenjax.stats.sample_size.planning import hours_to_bound


def test_a_minute_of_motion_chooses_nothing_and_says_what_it_needs():
    """80 golden runs of 2.8 s: no false cue at 2 mm and above says nothing about an hour."""
    found = {one.rule: one for one in cues.choices(TABLE, list(ROWS.values()))}
    assert TABLE.motions().hours == pytest.approx(80 * 2.8 / 3600)
    strict = found["false cues an hour: at most 0.5"]
    assert strict.row is None and strict.possible == "2, 3 or 5 mm" and math.isnan(strict.least_mm)
    assert strict.hours == pytest.approx(hours_to_bound(0.5)) == pytest.approx(7.378, abs=1e-3)
    loose = found["false cues an hour: at most 60"]  # 3.689 / 60 h = 3.7 min are there
    assert loose.row is not None and loose.row.cue.threshold_mm == 2.0 and math.isnan(loose.hours)


def motion_for(hours):
    """The same faults with golden runs that are together so long, and a result whose runs are
    so, too.
    """
    pedal = int(hours * 3.6e6 / 80)
    return FRAME.assign(golden_pedal_down_ms=pedal), synthetic.manifest(
        RUNS, duration_ms=pedal + 200
    )


def test_as_many_hours_as_it_asks_for_decide():
    chosen = {}
    for hours in (7.0, 7.4):
        frame, manifest = motion_for(hours)
        runs = Runs.of(frame, manifest)
        chosen[hours] = {one.rule: one for one in cues.choices(runs, cues.rows(runs))}
    assert chosen[7.0]["false cues an hour: at most 0.5"].row is None
    named = next(
        one
        for rule, one in chosen[7.4].items()
        if rule.startswith("false cues an hour: at most 0.5")
    )
    assert named.row is not None and named.row.cue.threshold_mm == 2.0
    assert (
        named.row.per_hour.high <= 0.5 and named.alike == 1
    )  # the other gain does exactly as well


@pytest.mark.slow
def test_thresholds_that_the_faults_do_not_tell_apart_are_both_named():
    frame, manifest = motion_for(100.0)
    second = [k for k, cue in enumerate(MANIFEST.cues) if cue.threshold_mm == 3.0]
    third = [k for k, cue in enumerate(MANIFEST.cues) if cue.threshold_mm == 2.0]
    nearly = {
        f"cue{k}_first_ms": frame[f"cue{j}_first_ms"] for k, j in zip(second, third, strict=True)
    }
    runs = Runs.of(frame.assign(**nearly), manifest)
    found = cues.choices(runs, cues.rows(runs))
    (limit,) = [one for one in found if one.rule.startswith("false cues")]
    assert limit.row is None and math.isnan(limit.hours)
    assert (limit.possible, limit.remainder, limit.least_mm) == ("2 or 3 mm", "2 or 3 mm", 2.0)
    text = page.render(runs, manifest, Path("out"))
    assert "2 or 3 mm may be best: these faults do not tell them apart" in text


def test_the_counts_that_choices_stand_on():
    rows = list(ROWS.values())
    found = cues._alarm_counts(TABLE, rows)
    plain = np.stack([missed(FRAME, row.number)[HAZARD] for row in rows], axis=1)
    each = plain.astype(int)
    expected = AlarmCounts(
        each.sum(0),
        each.T @ (1 - each),
        len(plain),
        np.array([row.per_hour.count for row in rows]),
        np.array([row.per_hour.hours for row in rows]),
    )
    for name, mine, other in zip(AlarmCounts._fields, found, expected, strict=True):
        assert np.array_equal(mine, other), name


def test_the_hours_that_are_asked_for_are_those_of_the_strictest_limit():
    found = cues.choices(TABLE, list(ROWS.values()))
    assert cues.hours_to_offer(found) == pytest.approx(hours_to_bound(0.5))


@pytest.mark.slow
def test_the_page_says_that_it_cannot_be_said_and_offers_the_command():
    text = page.render(Runs.of(FRAME, MANIFEST), MANIFEST, Path("out"))
    assert "cannot be said before 7.38 h of fault-free motion" in text
    assert "ravenjax fault-free out 7.4" in text
    assert (
        "80 fault-free motions of 3.7 min in pedal-down together, of 1 motion of the hands" in text
    )


@pytest.mark.slow
def test_one_threshold_alone_is_weighed_against_none_but_may_keep_a_limit():
    alone = synthetic.manifest(RUNS, cues=MANIFEST.cues[:1])
    runs = Runs.of(FRAME, alone)
    found = cues.choices(runs, cues.rows(runs))
    assert all(one.rule.startswith("false cues an hour") for one in found)
    assert (found[0].possible, found[0].several) == ("3 mm", False)
    assert "whether 3 mm keeps it" in page.render(runs, alone, Path("out"))
