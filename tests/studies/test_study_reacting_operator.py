"""The study of the reacting operator: pairs, times and prices of made-up runs with known answers, and the whole."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from ravenjax.campaign import design, loading
from ravenjax.stats.intervals import Estimate
from ravenjax.studies import reacting_drawings as drawings
from ravenjax.studies import (
    reacting_free,
    reacting_measures,
    reacting_operator,
    reacting_pairs,
    reacting_tables,
    reacting_times,
    running,
)
from ravenjax.studies.reacting_measures import CORRECT, RELEASE, SLOW
from ravenjax.studies.reacting_pairs import Runs

ACTION = "param:reaction.action"
QUIET: dict[str, Any] = {
    "group": "sampled/a",
    "failed": "",
    "peak_live_deviation_mm": 1.0,
    "twin_peak_live_deviation_mm": 0.7,
    "stray_mm": 0.5,
    "jump_tip": False,
    "jump_text": False,
    "jump_tip_first_ms": -1,
    "tissue_depth_mm": 0.0,
    "twin_tissue_depth_mm": 0.0,
    "reaction_ms": -1,
    "response": "none",
    "idle_ms": 0,
    "pedal_down_ms": 2500,
    "twin_pedal_down_ms": 2500,
    "moved_first_ms": -1,
    "twin_moved_first_ms": -1,
    "cue0_first_ms": -1,
    "twin_cue0_first_ms": -1,
    "fault0_start_ms": 1000,
    "fault0_duration_ms": 10,
    reacting_times.DELAY: 200.0,
    reacting_times.LIMIT: 0.01,
    ACTION: 0.0,
}
FACTS: dict[str, Any] = {
    "failed": False,
    "faulty": True,
    "activated": True,
    "harm": False,
    "harm_ms": -1,
    "active_ms": 1000,
    "layer": "packets",
}


def runs(*rows: tuple[dict[str, Any], dict[str, Any]]) -> Runs:
    """Runs by hand: what differs from a quiet one in the table, and in its facts; each its own fault."""
    frame = pd.DataFrame([{**QUIET, "pair": k, **row} for k, (row, _) in enumerate(rows)])
    facts = pd.DataFrame([{**FACTS, "distinct": k, **fact} for k, (_, fact) in enumerate(rows)])
    return Runs(frame, facts.assign(group=frame["group"], action=frame[ACTION].astype(int)), 3000)


def paired_runs(*pairs: tuple[dict[str, Any], dict[str, Any]], action: int = RELEASE) -> Runs:
    """Each pair as (what nobody's run shows, what the reacting run shows)."""
    rows = []
    for k, (without, with_) in enumerate(pairs):
        rows.append(({**without, "pair": 2 * k}, {"distinct": k}))
        rows.append(({**with_, "pair": 2 * k, ACTION: float(action)}, {"distinct": k}))
    return runs(*rows)


ACTED = {"reaction_ms": 1300}
STRAYED = {"stray_mm": 12.0}


def test_a_contrast_counts_what_was_avoided_and_what_was_caused() -> None:
    table = paired_runs(
        *[(STRAYED, ACTED)] * 6,  # avoided
        *[({}, {**ACTED, **STRAYED})] * 2,  # made worse
        *[(STRAYED, {**STRAYED, **ACTED})] * 3,
        *[({}, {})] * 9,  # nothing was felt
    )
    found = reacting_pairs.contrast(reacting_pairs.paired(table, RELEASE), reacting_measures.stray(10.0))
    assert (found.n, found.avoided, found.caused, found.acted) == (20, 6, 2, 11)
    assert (found.without.k, found.with_.k) == (9, 5)
    assert found.difference.value == pytest.approx(-4 / 20)
    assert found.p == pytest.approx(2 * (1 + 8 + 28) / 2**8)  # binomial, 2 or fewer of 8, both sides
    assert found.needed.value == pytest.approx(11 / 4)


def test_needed_is_the_reciprocal_of_the_difference() -> None:
    assert reacting_pairs.needed(Estimate(-0.1, -0.2, -0.05)) == pytest.approx((10.0, 5.0, 20.0))
    assert reacting_pairs.needed(Estimate(-0.1, -0.2, 0.01)).high == math.inf
    assert reacting_pairs.needed(Estimate(0.1, 0.05, 0.2)) == (math.inf, math.inf, math.inf)


def test_only_faults_that_changed_a_bit_are_paired() -> None:
    table = paired_runs(({}, ACTED), (STRAYED, ACTED))
    table.facts.loc[[0, 1], "activated"] = False
    assert len(reacting_pairs.paired(table, RELEASE).with_frame) == 1


def test_each_measure_sees_its_own_harm() -> None:
    table = runs(
        ({"peak_live_deviation_mm": 6.0}, {}),
        ({"peak_live_deviation_mm": 6.0, "twin_peak_live_deviation_mm": 6.0}, {}),  # the motion's, not the fault's
        ({"stray_mm": 6.0}, {}),
        ({"jump_tip": True}, {}),
        ({"tissue_depth_mm": 3.0, "twin_tissue_depth_mm": 2.5}, {}),
        ({"tissue_depth_mm": 3.0}, {}),
        ({}, {"harm": True}),
    )
    hits = {
        measure.name: np.flatnonzero(measure.hits(table.frame, table.facts)).tolist()
        for measure in (
            reacting_measures.live(5.0),
            reacting_measures.stray(5.0),
            reacting_measures.LEAPT,
            reacting_measures.DEEPER,
            reacting_measures.INJURY,
            reacting_measures.HARM,
        )
    }
    assert [*hits.values()] == [[0], [2], [3], [5], [2, 3, 5], [6]]


def test_no_table_holds_a_measure_that_is_not_fair() -> None:
    parts = {
        action: reacting_pairs.paired(paired_runs((STRAYED, ACTED), ({}, ACTED), action=action), action)
        for action in (RELEASE, SLOW, CORRECT)
    }
    shown = {(row[0], row[1]) for row in reacting_tables.reactions(parts).rows}
    slow, correct = reacting_tables.words(SLOW), reacting_tables.words(CORRECT)
    assert not any(who == slow and str(harm).startswith("strayed") for who, harm in shown)
    assert not any(who == correct and str(harm).startswith("off the model") for who, harm in shown)
    told = {str(row[0]): row[1:] for row in reacting_tables.fairness().rows}
    assert str(told["strayed by more than 5 mm"][1]).startswith("no")
    assert str(told["off the model by more than 5 mm, live"][2]).startswith("no")
    assert told["jump of the true tip"] == ("fair", "fair", "fair")


def timed(*rows: dict[str, Any]) -> Runs:
    return runs(*[(row, {}) for row in rows])


MOVED = {"moved_first_ms": 1400, "stray_mm": 11.0, "peak_live_deviation_mm": 12.0}


def test_leads_are_of_motion_and_of_the_faults_own_cue() -> None:
    table = timed(
        {**MOVED, "cue0_first_ms": 1100},
        {**MOVED, "cue0_first_ms": 1500},  # after the harm
        MOVED,  # never
        {**MOVED, "stray_mm": 1.0, "cue0_first_ms": 1100},  # stood while the model went on
        {**MOVED, "cue0_first_ms": 1100, "twin_cue0_first_ms": 1000},  # the motion's cue
        {"cue0_first_ms": 1100},  # no harm
    )
    lead = reacting_times.leads_ms(table, 0, 10.0)
    np.testing.assert_array_equal(lead, [300, -100, -np.inf, np.nan, -np.inf, np.nan])
    found = reacting_times.advance(table, 0, 3.0, 10.0)
    assert (found.lead.n, found.lead.before.k) == (4, 1)
    assert [rate.k for rate in found.late.values()] == [3, 3, 4]  # 150, 250, 400 ms: 300 ms are enough for two


def test_a_jump_has_its_own_time() -> None:
    table = timed({"jump_tip": True, "jump_tip_first_ms": 1050, "cue0_first_ms": 1040}, MOVED)
    np.testing.assert_array_equal(reacting_times.leads_ms(table, 0, None), [10, np.nan])


def test_only_runs_of_the_asked_size_are_timed() -> None:
    table = timed({reacting_times.LIMIT: 0.003}, {reacting_times.LIMIT: 0.01})
    assert reacting_times.of_size(table, 3.0).frame.index.tolist() == [0]


def test_who_had_time_was_spared() -> None:
    """Delay 200 ms: leads of 100 and 260 ms leave -100 and 60 ms."""
    off = {"peak_live_deviation_mm": 12.0}
    table = paired_runs(({}, {**ACTED, **off}), ({}, ACTED), ({}, ACTED))
    faults = [{**MOVED, "cue0_first_ms": 1300}, {**MOVED, "cue0_first_ms": 1140}, {}]
    found = reacting_times.left_by_time(timed(*faults), table, reacting_pairs.paired(table, RELEASE), 10.0)
    assert {name: counts for name, counts in found.items() if counts[0]} == {
        "none: too soon for this operator": (1, 1),
        "50 to 200 ms": (1, 0),
    }


def test_other_faults_cannot_be_timed() -> None:
    table = paired_runs(({}, ACTED), ({}, ACTED))
    pairs = reacting_pairs.paired(table, RELEASE)
    with pytest.raises(ValueError, match="same campaign"):
        reacting_times.left_by_time(timed({}), table, pairs, 10.0)
    with pytest.raises(ValueError, match="same campaign"):
        reacting_times.left_by_time(timed({}, {"fault0_start_ms": 7}), table, pairs, 10.0)


def test_classes_of_faults_are_told_by_name_and_speed() -> None:
    table = paired_runs(({"group": "library/B24"}, {"group": "library/B24"}), ({}, {}))
    table.facts.loc[0, ["harm", "harm_ms"]] = [True, 1120]
    pairs = reacting_pairs.paired(table, RELEASE)
    masks = {
        **reacting_pairs.by_design(pairs),
        **reacting_pairs.by_speed(pairs),
        **reacting_pairs.by_scenario(pairs),
        **reacting_pairs.by_layer(pairs),
    }
    told = {name: mine.tolist() for name, mine in masks.items() if mine.any()}
    assert told["hazards of the library"] == told["harm after 50 to 200 ms"] == [True, False]
    assert told["sampled faults"] == told["no harm"] == [False, True]
    assert told["scenario: sudden jump"] == [True, False]
    assert told["packets"] == [True, True]


def test_interruptions_are_counted_in_the_time_up_to_them() -> None:
    rows = [{"pedal_down_ms": 2000, "cue0_first_ms": 1500, "cue0_count": 3}, {"pedal_down_ms": 2000, "cue0_count": 0}]
    table = runs(*[({**row, reacting_free.SCALE: 0.1, "operator": "suture"}, {}) for row in rows])
    (found,) = reacting_free.free(table, (3.0,))
    assert (found.motions.k, found.motions.n) == (1, 2)
    assert found.first.hours == pytest.approx((500 + 2000) / 3.6e6)
    assert (found.first.count, found.pulses.count) == (1, 3)
    assert found.pulses.hours == pytest.approx(4000 / 3.6e6)


def test_the_drawings_draw() -> None:
    table = paired_runs((STRAYED, ACTED), ({}, ACTED), (STRAYED, {**STRAYED, **ACTED}))
    contrast = reacting_pairs.contrast(reacting_pairs.paired(table, RELEASE), reacting_measures.stray(10.0))
    rows = [drawings.Row(block, name, "lift", contrast) for block in ("a", "b") for name in ("x", "y")]
    advance = reacting_times.advance(timed({**MOVED, "cue0_first_ms": 1100}, MOVED), 0, 3.0, 10.0)
    for draw, panels in (
        (drawings.leads([advance]), 1),
        (drawings.rates(rows), 2),
        (drawings.differences(rows, "p"), 1),
    ):
        figure = plt.figure()
        draw(figure)
        assert len(figure.axes) == panels
        assert all(axis.get_title() for axis in figure.axes)
        plt.close(figure)


@pytest.mark.parametrize("variant", reacting_operator.STUDY.variants, ids=lambda v: v.name)
def test_every_variant_loads(variant: reacting_operator.Variant) -> None:
    config = loading.load(variant.campaign, variant.overrides)
    assert len({cue.threshold_m for cue in config.haptics.cues()}) == len(config.haptics.cues())


def test_the_limit_of_the_variants_cuts_at_the_library() -> None:
    config = loading.load(reacting_operator.CAMPAIGN, ("cross.reaction.action=[0, 1]",))
    sampled = design.expand(config)["group"].astype(str).str.startswith("sampled/").to_numpy()
    assert sampled[: 2 * reacting_operator.SAMPLED].all()
    assert not sampled[2 * reacting_operator.SAMPLED :].any()


def test_the_haptic_sets_are_those_of_the_tables() -> None:
    for name in (reacting_operator.CAMPAIGN, reacting_operator.FREE):
        thresholds = [1e3 * cue.threshold_m for cue in loading.load(name).haptics.cues()]
        assert thresholds == pytest.approx(reacting_operator.THRESHOLDS_MM)


def test_variants_of_the_operator_have_the_same_faults() -> None:
    few = ("cross.reaction.action=[0, 1]", "campaign.limit=400")
    inputs = ["group", "fault0_channel", "fault0_effect", "fault0_value", "fault0_start_ms", "fault0_duration_ms"]
    known = design.expand(loading.load(reacting_operator.CAMPAIGN, few))[inputs]
    for variants in reacting_operator.BLOCKS.values():
        for words, overrides in variants.values():
            other = design.expand(loading.load(reacting_operator.CAMPAIGN, (*few, *overrides)))[inputs]
            assert known.equals(other), words


@pytest.mark.slow
def test_the_study_runs(tmp_path: Path) -> None:
    found = running.run(reacting_operator.STUDY, tmp_path)
    value = {line.quantity: line.predicted.value for line in found.lines if line.predicted}
    assert value["3 mm off: came too soon for any reaction of 250 ms, cue at 3 mm"] == 100.0
    late = [value[f"{size:g} mm off: came too soon for any reaction of 250 ms, cue at 3 mm"] for size in (5, 10, 20)]
    assert late == sorted(late, reverse=True)
    assert value["lifting the pedal: strayed by more than 20 mm, points".removesuffix(", points")] < 0
    assert all(line.published is None for line in found.lines)
    spared = next(one for one in found.tables if one.title.startswith("Who was spared"))
    assert [row[1] == row[2] for row in spared.rows][:2] == [True, True]  # who had no time was not spared
    assert all(float(row[2]) <= float(row[1]) for row in spared.rows)
    assert (tmp_path / "reacting_operator" / "leads.svg").is_file()
