"""Pairs with and without a reaction, against plain arithmetic."""

from __future__ import annotations

import naive_facts
import numpy as np
import pandas as pd
import pytest
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import reaction
from ravenjax.report.sections.reaction import pairs
from ravenjax.stats.comparison.paired import mcnemar, rate_difference
from ravenjax.stats.intervals import wilson

FAULTS = 300
FRAME = reacting.frame(FAULTS)
MANIFEST = reacting.manifest(len(FRAME))


def drawn(frame):
    return pairs.drawn(Runs.of(frame, MANIFEST))


def differences(frame, sampled=True):
    part = drawn(frame)
    return pairs.differences(part.frame, part.facts, lambda groups: sampled)


ROWS = differences(FRAME)
WHOLE = {row.action: row for row in ROWS if row.among == "all faults"}


def sides(action, columns):
    """Frames with nobody who reacts and with `action`, of faults that are valid, in one order."""
    keep = (FRAME["fault0_site"] != "") & (FRAME["failed"] == "")
    far = FRAME[["unintended_mm", "unintended_off_mm"]].max(axis=1)
    table = FRAME[keep].assign(moved=FRAME["unintended_first_ms"] >= 0, excursion_mm=far)
    parts = [
        table[table["param:reaction.action"] == a].set_index("pair")[columns] for a in (0, action)
    ]
    return parts[0], parts[1].loc[parts[0].index]


@pytest.mark.parametrize(("action", "told"), [(1, "lift the pedal"), (3, "correct by eye")])
def test_unintended_motions_with_and_without(action, told):
    without, with_ = (part["moved"].to_numpy(bool) for part in sides(action, ["moved"]))
    row = WHOLE[told]
    assert (row.n, row.without.k, row.with_.k) == (len(without), without.sum(), with_.sum())
    assert row.change == rate_difference(with_, without) and row.change.value < 0
    assert (row.spared, row.caused) == ((without & ~with_).sum(), 0) and row.spared > 0
    assert row.p == mcnemar(with_, without).p


def test_distance_spared_is_the_mean_of_pairs():
    without, with_ = (part["excursion_mm"].to_numpy(float) for part in sides(1, ["excursion_mm"]))
    row = WHOLE["lift the pedal"]
    assert row.distance_mm.value == pytest.approx((with_ - without).mean())
    assert row.distance_mm.low < row.distance_mm.value < row.distance_mm.high < 0


def test_interrupted_for_nothing():
    without, with_ = sides(1, ["moved", "reaction_ms"])
    acted = (with_["reaction_ms"] >= 0).to_numpy()
    idle = acted & ~without["moved"].to_numpy(bool)
    assert WHOLE["lift the pedal"].reacted == wilson(int(acted.sum()), len(acted))
    assert WHOLE["lift the pedal"].idle == wilson(int(idle.sum()), int(acted.sum()))


def test_rows_by_layer_add_up():
    for told, whole in WHOLE.items():
        parts = [
            row
            for row in ROWS
            if row.action == told and row.among in {*naive_facts.LAYERS, "other"}
        ]
        assert (
            sum(row.n for row in parts) == whole.n
            and sum(row.spared for row in parts) == whole.spared
        )


def test_other_crossed_parameters_pair_within_their_value_and_get_rows():
    soft, stiff = FRAME.copy(), FRAME.copy()
    soft["param:plant.friction_scale"], stiff["param:plant.friction_scale"] = 0.7, 1.4
    stiff["unintended_first_ms"] = -1
    stiff = synthetic.judged(stiff)
    frame = pd.concat([stiff, soft], ignore_index=True)
    rows = {row.among: row for row in differences(frame) if row.action == "lift the pedal"}
    assert rows["plant.friction_scale = 1.4"].without.k == 0
    assert rows["plant.friction_scale = 0.7"].without == WHOLE["lift the pedal"].without
    assert rows["all faults"].n == 2 * WHOLE["lift the pedal"].n


def test_pairs_of_one_fault_count_as_one_unit():
    """Three copies of every pair say no more than one does."""
    parts = [FRAME.assign(**{"param:plant.friction_scale": value}) for value in (0.7, 1.0, 1.4)]
    rows = {
        row.among: row
        for row in differences(pd.concat(parts, ignore_index=True))
        if row.action == "lift the pedal"
    }
    whole, once = rows["all faults"], WHOLE["lift the pedal"]
    assert whole.n == 3 * once.n and whole.spared == 3 * once.spared
    for name in ("change", "distance_mm", "without"):
        wide, plain = getattr(whole, name), getattr(once, name)
        assert wide.value == pytest.approx(plain.value)
        assert wide.high - wide.low == pytest.approx(plain.high - plain.low, rel=0.2)
    assert whole.p == pytest.approx(once.p)  # one step of three pairs exchanges as one of one


def test_enumerated_faults_have_no_interval_and_no_test():
    for row in differences(FRAME, sampled=False):
        drawn_row = next(one for one in ROWS if (one.action, one.among) == (row.action, row.among))
        assert row.without.k == drawn_row.without.k and row.change.value == pytest.approx(
            drawn_row.change.value
        )
        ends = (
            row.without.low,
            row.with_.high,
            row.change.low,
            row.distance_mm.low,
            row.depth_mm.high,
            row.idle.low,
        )
        assert np.isnan([*ends, row.p]).all()
    chart = reaction.spared(differences(FRAME, sampled=False))
    assert all(len(mark.x) and np.isnan(mark.x_low).all() for mark in chart.marks)


def test_a_crossed_delay_shares_the_run_without_reaction():
    quick, slow = FRAME.copy(), FRAME[FRAME["param:reaction.action"] > 0].copy()
    quick["param:reaction.delay_ms"], slow["param:reaction.delay_ms"] = 150.0, 400.0
    slow["unintended_off_mm"] = 99.0
    frame = pd.concat([quick, slow], ignore_index=True)
    rows = {row.among: row for row in differences(frame) if row.action == "lift the pedal"}
    late, early = rows["reaction.delay_ms = 400"], rows["reaction.delay_ms = 150"]
    assert late.n == early.n == WHOLE["lift the pedal"].n and late.without == early.without
    assert late.distance_mm.value > 0 > early.distance_mm.value


def test_failed_partners_and_faults_run_twice():
    frame = FRAME.copy()
    faulty = (FRAME["fault0_site"] != "") & (FRAME["failed"] == "")
    lost = frame.loc[faulty & (frame["param:reaction.action"] == 0), "pair"].head(5)
    frame.loc[frame["pair"].isin(lost) & (frame["param:reaction.action"] == 0), "failed"] = "nan"
    row = next(row for row in differences(frame) if row.among == "all faults")
    assert row.n == WHOLE["lift the pedal"].n - 5
    twice = pd.concat([FRAME, FRAME.assign(pair=FRAME["pair"] + 10_000)], ignore_index=True)
    row = next(row for row in differences(twice) if row.among == "all faults")
    assert row.n == WHOLE["lift the pedal"].n


def test_interruptions_of_fault_free_motion():
    frame = FRAME.assign(golden_tip_path_mm=np.arange(len(FRAME)) % 20 + 0.5)
    acting = frame["param:reaction.action"] == 1
    frame["golden_reaction_ms"] = np.where(acting & (frame["golden_tip_path_mm"] == 0.5), 900, -1)
    part = drawn(frame)
    found = {one.action: one for one in pairs.interruptions(part.frame, part.facts)}
    motions = (
        frame[acting]
        .groupby(["operator", "golden_tip_path_mm"], observed=True)["golden_reaction_ms"]
        .first()
    )
    assert found["lift the pedal"].motions == wilson(int((motions >= 0).sum()), len(motions))
    assert found["correct by eye"].motions.k == 0 and np.isnan(found["correct by eye"].lost_ms)


def test_pairs_need_both_sides():
    assert drawn(FRAME).crossed
    assert not drawn(FRAME[FRAME["param:reaction.action"] == 1].reset_index(drop=True)).crossed


def test_figures():
    chart = reaction.spared(ROWS)
    places = {
        (mark.name, round(y)): x
        for mark in chart.marks
        for x, y in zip(mark.x, mark.y, strict=True)
    }
    for row in ROWS:
        if np.isfinite(row.distance_mm.low):
            assert places[row.action, chart.y.names.index(row.among)] == row.distance_mm.value
            assert chart.x.low <= row.distance_mm.low and row.distance_mm.high <= chart.x.high
    part = drawn(FRAME)
    chart = reaction.exceedance(part.frame, part.facts)
    assert len(chart.marks) == 3
    for curve, action in zip(chart.marks, (0, 1, 3), strict=True):
        far = sides(action or 1, ["excursion_mm"])[int(action > 0)]["excursion_mm"].to_numpy()
        for at in (curve.x[0], 1.0, 3.0, 5.0):
            assert curve.at(at)[0] == pytest.approx((far > at).mean(), abs=0.005)
        assert len(curve.x) <= 450 and curve.y[-1] == pytest.approx(0, abs=1e-6)
