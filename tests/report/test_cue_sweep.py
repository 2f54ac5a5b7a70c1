"""The cue sweep against plain counts, and what the data choose."""

from __future__ import annotations

import json

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report import cue_figure, cue_sweep
from ravenjax.report import facts as run_facts
from ravenjax.report.runs import Runs
from ravenjax.stats.intervals import wilson

RUNS = 900
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.frame(RUNS).assign(twin_tip_path_mm=np.arange(RUNS) % 40 + 0.5)
LOW = [k for k, cue in enumerate(MANIFEST.cues) if cue.threshold_mm == 1.0]
for _k in LOW:  # at 1 mm every tenth motion has a cue without any fault, late
    FRAME[f"twin_cue{_k}_first_ms"] = np.where(FRAME["twin_tip_path_mm"] % 10 == 0.5, 700, -1)
FACTS = run_facts.of(FRAME, MANIFEST)
ROWS = {row.number: row for row in cue_sweep.rows(Runs.of(FRAME, MANIFEST), MANIFEST)}
VALID = (FRAME["failed"] == "").to_numpy()
HARM = FACTS["harm"].to_numpy() & FRAME["activated"].to_numpy()


@pytest.mark.parametrize("k", range(len(synthetic.CUES)))
def test_a_set_against_a_plain_count(k):
    cue, twin = FRAME[f"cue{k}_first_ms"].to_numpy(), FRAME[f"twin_cue{k}_first_ms"].to_numpy()
    told = (cue >= 0) & ~((twin >= 0) & (twin <= cue)) & (cue >= FRAME["first_active_ms"])
    assert ROWS[k].missed == wilson(int((HARM & ~told).sum()), int(HARM.sum()))
    free = FRAME.groupby(["operator", "twin_tip_path_mm"], observed=True)[f"twin_cue{k}_first_ms"].first()
    assert ROWS[k].false == wilson(int((free >= 0).sum()), len(free))
    assert ROWS[k].per_hour is not None and ROWS[k].per_hour.count == ROWS[k].false.k
    before = HARM & told & (cue < FACTS["harm_ms"])
    assert (ROWS[k].before.k, ROWS[k].before.n) == (int(before.sum()), int(HARM.sum()))
    assert ROWS[k].force == pytest.approx(float(FRAME.loc[HARM & told, f"cue{k}_peak_force"].median()))


def test_a_cue_that_the_twin_has_is_missed():
    assert any((FRAME["cue2_first_ms"] >= 700) & HARM & (FRAME["twin_cue2_first_ms"] == 700))
    quiet = FRAME.assign(**{f"twin_cue{k}_first_ms": -1 for k in LOW})
    rows = {row.number: row for row in cue_sweep.rows(Runs.of(quiet, MANIFEST), MANIFEST)}
    assert rows[2].missed.k < ROWS[2].missed.k


def test_best_sets_are_beaten_by_none():
    rows = list(ROWS.values())
    for row in rows:
        beaten = any(
            other.missed.value <= row.missed.value
            and other.false.value <= row.false.value
            and (other.missed.value, other.false.value) != (row.missed.value, row.false.value)
            for other in rows
        )
        assert row.best == (not beaten)


def test_the_data_choose_the_cheapest():
    rows = list(ROWS.values())
    found = cue_sweep.choices(rows)
    assert found and all(one.row is not None for one in found)
    one = next(one for one in found if one.rule.startswith("a missed hazard weighs as much as 1"))
    assert one.row is not None
    cheapest = min(row.missed.value + row.false.value for row in rows)
    assert one.row.missed.value + one.row.false.value == cheapest
    last = found[-1]
    assert last.row is not None and last.row.per_hour is not None and last.row.per_hour.per_hour <= 60


def test_no_set_keeps_an_impossible_rule():
    loud = FRAME.assign(**{f"twin_cue{k}_first_ms": 5 for k in range(len(MANIFEST.cues))})
    found = cue_sweep.choices(cue_sweep.rows(Runs.of(loud, MANIFEST), MANIFEST))
    assert [one.row for one in found if one.rule.startswith("at most")] == [None]


def test_sets_come_by_threshold():
    made = [row.cue.threshold_mm for row in cue_sweep.rows(Runs.of(FRAME, MANIFEST), MANIFEST)]
    assert made == sorted(made)


def test_figure():
    import plotly.graph_objects as go

    text = cue_figure.tradeoff(list(ROWS.values()))
    assert text is not None
    figure = go.Figure(json.loads(text))
    assert sum(len(trace.x) for trace in figure.data[1:]) == len(ROWS)
    calm = FRAME.assign(moved_first_ms=-1, jump_code=False)
    assert cue_figure.tradeoff(cue_sweep.rows(Runs.of(calm, MANIFEST), MANIFEST)) is None
