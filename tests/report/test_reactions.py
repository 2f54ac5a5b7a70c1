"""Pairs with and without a reaction, against plain arithmetic."""

import numpy as np
import pandas as pd
import pytest
import reacting_results as reacting

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import reaction
from ravenjax.stats.intervals import wilson_interval
from ravenjax.stats.paired import difference_of_counts, mcnemar_test

FAULTS = 300
FRAME = reacting.frame(FAULTS)
MANIFEST = reacting.manifest(len(FRAME))


def drawn(frame):
    return reaction.sample_runs(Runs.of(frame, MANIFEST))


def differences(frame, sampled=True):
    return reaction.compare_pairs(drawn(frame), lambda groups: sampled)


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
    assert (row.spared, row.caused) == ((without & ~with_).sum(), 0) and row.spared > 0
    assert row.change == difference_of_counts(0, row.spared, row.n)
    assert row.p == mcnemar_test(0, row.spared)


def test_faults_that_never_act_are_left_out():
    idle = (FRAME["fault0_site"] != "") & (FRAME["pair"] % 4 == 0)
    one_side = (FRAME["pair"] % 4 == 1) & (FRAME["param:reaction.action"] == 1)
    rows = differences(FRAME.assign(activated=FRAME["activated"] & ~idle & ~one_side))
    row = next(row for row in rows if row.action == "lift the pedal")
    left_out = sides(0, ["moved"])[0].index.to_numpy() % 4 == 0
    assert row.inactive == left_out.sum() > 0
    assert row.n + row.inactive == WHOLE["lift the pedal"].n


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


def test_rates_by_the_value_of_a_crossed_parameter():
    """With twice the friction, no fault in three moves the tip; who reacts is left out."""
    name = "param:plant.friction_scale"
    stiff = FRAME.assign(**{name: 2.0}, hazard=FRAME["hazard"].where(FRAME["pair"] % 3 > 0, "none"))
    both = pd.concat([FRAME.assign(**{name: 1.0}), stiff], ignore_index=True)
    first, other = reaction.crossed_rows(drawn(both), lambda groups: True)
    plain = FRAME[(FRAME["param:reaction.action"] == 0) & (FRAME["fault0_site"] != "")]
    plain = plain[plain["failed"] == ""]
    before = (plain["hazard"] == "unintended motion").to_numpy()
    after = before & (plain["pair"] % 3 > 0).to_numpy()
    for row, value, hits in ((first, 1.0, before), (other, 2.0, after)):
        rates = row.events["unintended motion"]
        assert (row.first, row.value, row.n) == (1.0, value, len(plain))
        assert rates.after == wilson_interval(int(hits.sum()), len(hits))
        assert rates.change == difference_of_counts(0, (before & ~hits).sum(), len(hits))
    assert other.events["unintended motion"].p == mcnemar_test(0, int((before & ~after).sum()))


def test_enumerated_faults_have_no_interval_and_no_test():
    for row in differences(FRAME, sampled=False):
        drawn_row = next(one for one in ROWS if (one.action, one.among) == (row.action, row.among))
        assert row.without.k == drawn_row.without.k and row.change.value == pytest.approx(
            drawn_row.change.value
        )
        ends = [row.without.low, row.with_.high, row.change.low, row.distance_mm.low]
        assert np.isnan([*ends, row.depth_mm.high, row.idle.low, row.p]).all()


def test_interruptions_of_fault_free_motion():
    frame = FRAME.assign(golden_tip_path_mm=np.arange(len(FRAME)) % 20 + 0.5)
    acting = frame["param:reaction.action"] == 1
    frame["golden_reaction_ms"] = np.where(acting & (frame["golden_tip_path_mm"] == 0.5), 900, -1)
    found = {one.action: one for one in reaction.count_interruptions(drawn(frame))}
    motions = (
        frame[acting]
        .groupby(["operator", "golden_tip_path_mm"], observed=True)["golden_reaction_ms"]
        .first()
    )
    assert found["lift the pedal"].motions == wilson_interval(
        int((motions >= 0).sum()), len(motions)
    )
    assert found["correct by eye"].motions.k == 0 and np.isnan(found["correct by eye"].lost_ms)
