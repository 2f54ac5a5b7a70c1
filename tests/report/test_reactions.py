"""Pairs with and without a reaction, against plain arithmetic."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import reacting_results as reacting

from ravenjax.report import facts as run_facts
from ravenjax.report import reaction_figures, reactions
from ravenjax.stats.intervals import wilson
from ravenjax.stats.paired import mcnemar, rate_difference

FAULTS = 300
FRAME = reacting.frame(FAULTS)
MANIFEST = reacting.manifest(len(FRAME))
FACTS = run_facts.of(FRAME, MANIFEST)
ROWS = reactions.differences(FRAME, FACTS)
WHOLE = {row.action: row for row in ROWS if row.among == "all faults"}


def sides(action, columns):
    """Frames with nobody who reacts and with `action`, of faults that are valid, in one order."""
    keep = (FRAME["fault0_site"] != "") & (FRAME["failed"] == "")
    table = FRAME[keep].assign(harm=FACTS["harm"])
    parts = [table[table["param:reaction.action"] == a].set_index("pair")[columns] for a in (0, action)]
    return parts[0], parts[1].loc[parts[0].index]


@pytest.mark.parametrize(("action", "told"), [(1, "lift the pedal"), (3, "correct by eye")])
def test_harm_with_and_without(action, told):
    without, with_ = (part["harm"].to_numpy(bool) for part in sides(action, ["harm"]))
    row = WHOLE[told]
    assert (row.n, row.without.k, row.with_.k) == (len(without), without.sum(), with_.sum())
    assert row.harm == rate_difference(with_, without) and row.harm.value < 0
    assert (row.spared, row.caused) == ((without & ~with_).sum(), 0) and row.spared > 0
    assert row.p == mcnemar(with_, without).p


def test_distance_spared_is_the_mean_of_pairs():
    without, with_ = (part["stray_mm"].to_numpy(float) for part in sides(1, ["stray_mm"]))
    row = WHOLE["lift the pedal"]
    assert row.distance == "stray_mm" and row.distance_mm.value == pytest.approx((with_ - without).mean())
    assert row.distance_mm.low < row.distance_mm.value < row.distance_mm.high < 0


def test_interrupted_for_nothing():
    without, with_ = sides(1, ["harm", "reaction_ms"])
    acted = (with_["reaction_ms"] >= 0).to_numpy()
    idle = acted & ~without["harm"].to_numpy(bool)
    assert WHOLE["lift the pedal"].reacted == wilson(int(acted.sum()), len(acted))
    assert WHOLE["lift the pedal"].idle == wilson(int(idle.sum()), int(acted.sum()))


def test_rows_by_layer_add_up():
    for told, whole in WHOLE.items():
        parts = [row for row in ROWS if row.action == told and row.among in set(FACTS["layer"])]
        assert sum(row.n for row in parts) == whole.n and sum(row.spared for row in parts) == whole.spared


def test_other_crossed_parameters_pair_within_their_value_and_get_rows():
    soft, stiff = FRAME.copy(), FRAME.copy()
    soft["param:plant.friction_scale"], stiff["param:plant.friction_scale"] = 0.7, 1.4
    stiff["moved_first_ms"], stiff["jump_code"] = -1, False
    frame = pd.concat([stiff, soft], ignore_index=True)
    facts = run_facts.of(frame, MANIFEST)
    rows = {row.among: row for row in reactions.differences(frame, facts) if row.action == "lift the pedal"}
    assert rows["plant.friction_scale = 1.4"].without.k == 0
    assert rows["plant.friction_scale = 0.7"].without == WHOLE["lift the pedal"].without
    assert rows["all faults"].n == 2 * WHOLE["lift the pedal"].n


def test_a_crossed_delay_shares_the_run_without_reaction():
    quick, slow = FRAME.copy(), FRAME[FRAME["param:reaction.action"] > 0].copy()
    quick["param:reaction.delay_ms"], slow["param:reaction.delay_ms"] = 150.0, 400.0
    slow["stray_mm"] = 99.0
    frame = pd.concat([quick, slow], ignore_index=True)
    facts = run_facts.of(frame, MANIFEST)
    rows = {row.among: row for row in reactions.differences(frame, facts) if row.action == "lift the pedal"}
    late, early = rows["reaction.delay_ms = 400"], rows["reaction.delay_ms = 150"]
    assert late.n == early.n == WHOLE["lift the pedal"].n and late.without == early.without
    assert late.distance_mm.value > 0 > early.distance_mm.value


def test_failed_partners_and_faults_run_twice():
    frame = FRAME.copy()
    faulty = (FRAME["fault0_site"] != "") & (FRAME["failed"] == "")
    lost = frame.loc[faulty & (frame["param:reaction.action"] == 0), "pair"].head(5)
    frame.loc[frame["pair"].isin(lost) & (frame["param:reaction.action"] == 0), "failed"] = "nan"
    facts = run_facts.of(frame, MANIFEST)
    row = next(row for row in reactions.differences(frame, facts) if row.among == "all faults")
    assert row.n == WHOLE["lift the pedal"].n - 5
    twice = pd.concat([FRAME, FRAME.assign(pair=FRAME["pair"] + 10_000)], ignore_index=True)
    facts = run_facts.of(twice, MANIFEST)
    row = next(row for row in reactions.differences(twice, facts) if row.among == "all faults")
    assert row.n == WHOLE["lift the pedal"].n


def test_interruptions_of_fault_free_motion():
    frame = FRAME.assign(twin_tip_path_mm=np.arange(len(FRAME)) % 20 + 0.5)
    acting = frame["param:reaction.action"] == 1
    frame["twin_reaction_ms"] = np.where(acting & (frame["twin_tip_path_mm"] == 0.5), 900, -1)
    facts = run_facts.of(frame, MANIFEST)
    found = {one.action: one for one in reactions.interruptions(frame, facts)}
    motions = frame[acting].groupby(["operator", "twin_tip_path_mm"], observed=True)["twin_reaction_ms"].first()
    assert found["lift the pedal"].motions == wilson(int((motions >= 0).sum()), len(motions))
    assert found["correct by eye"].motions.k == 0 and np.isnan(found["correct by eye"].lost_ms)


def test_pairs_need_both_sides():
    assert reactions.crossed(FRAME, FACTS)
    everybody = FRAME[FRAME["param:reaction.action"] == 1]
    assert not reactions.crossed(everybody, run_facts.of(everybody, MANIFEST))


def test_figures():
    import plotly.graph_objects as go

    text, height = reaction_figures.spared(ROWS)
    assert go.Figure(json.loads(text)).layout.height == height
    text, measure = reaction_figures.exceedance(FRAME, FACTS)
    figure = go.Figure(json.loads(text))
    assert measure == "strayed" and len(figure.data) == 3
    for trace, action in zip(figure.data, (0, 1, 3), strict=True):
        far = sides(action or 1, ["stray_mm"])[int(action > 0)]["stray_mm"].to_numpy()
        assert trace.y[0] == pytest.approx((far > trace.x[0]).mean(), abs=1e-6)
        assert len(trace.x) <= 201 and trace.y[-1] == pytest.approx(0, abs=1e-6)
