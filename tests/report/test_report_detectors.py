"""Detectors against plain counts of the same rows."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax.report import detector_figures, detectors
from ravenjax.report import facts as run_facts
from ravenjax.report.runs import Runs
from ravenjax.stats.intervals import wilson
from ravenjax.store.manifest import Detector

RUNS = 900
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.frame(RUNS).assign(twin_tip_path_mm=np.arange(RUNS) % 50 + 0.5)  # 50 fault-free motions an operator
FRAME["twin_detector0_score"] = np.where(FRAME["twin_tip_path_mm"] < 3, 0.7, 0.4)  # over the lowest level in 3 of 50
FACTS = run_facts.of(FRAME, MANIFEST)
TABLE = Runs.of(FRAME, MANIFEST)
FOUND = detectors.alarms(TABLE, MANIFEST)
ROWS = {row.name: row for row in detectors.rows(TABLE, MANIFEST, FOUND)}
VALID = FRAME["failed"] == ""
HARM = ((FRAME["moved_first_ms"] >= 0) | FRAME["jump_code"]) & VALID


def test_every_detector_the_checks_and_the_cue():
    assert list(ROWS) == ["dsn16", "tip", "built-in checks", "haptic cue, 3 mm"]
    assert [level.level for level in ROWS["dsn16"].levels] == [0.5, 1.0, 2.0]
    assert ROWS["built-in checks"].roc is None and len(ROWS["built-in checks"].levels) == 1


@pytest.mark.parametrize("k", range(3))
def test_rates_of_a_level(k):
    level, first = ROWS["dsn16"].levels[k], FRAME[f"detector0_level{k}_first_ms"]
    alarm = VALID & (first >= 0)
    assert level.caught == wilson(int((alarm & HARM).sum()), int(HARM.sum()))
    assert level.harmless == wilson(int((alarm & ~HARM).sum()), int((VALID & ~HARM).sum()))
    assert level.precision == wilson(int((alarm & HARM).sum()), int(alarm.sum()))


def test_false_alarms_count_each_motion_once():
    free = FRAME.groupby(["operator", "twin_tip_path_mm"], observed=True)[
        ["twin_detector0_score", "twin_pedal_down_ms"]
    ].first()
    for level in ROWS["dsn16"].levels:
        expected = int((free["twin_detector0_score"] > level.level).sum())
        assert level.false is not None and level.false.count == expected
        assert level.false.hours == pytest.approx(free["twin_pedal_down_ms"].sum() / 3.6e6)
        assert level.false.low <= level.false.per_hour <= level.false.high
    assert [level.quiet for level in ROWS["dsn16"].levels] == [False, True, False]
    assert ROWS["built-in checks"].levels[0].false is None


def test_delay_and_lead_of_a_level():
    level = ROWS["dsn16"].levels[0]
    chosen = HARM & FRAME["activated"]
    alarm, harm = FRAME.loc[chosen, "detector0_level0_first_ms"], FACTS.loc[chosen, "harm_ms"]
    assert level.before == wilson(int(((alarm >= 0) & (alarm < harm)).sum()), int(chosen.sum()))
    delay = np.where(alarm >= 0, alarm - FRAME.loc[chosen, "first_active_ms"], np.inf)
    assert level.delay_ms.value == np.sort(delay)[int(np.ceil(len(delay) / 2)) - 1] == 30


def test_area_is_the_chance_to_rank_harm_higher():
    score = FRAME["detector0_score"].to_numpy()
    high, low = score[HARM], score[(VALID & ~HARM).to_numpy()]
    pairs = high[:, None] - low[None, :]
    area = ROWS["dsn16"].auc
    assert area is not None and area.value == pytest.approx(((pairs > 0) + 0.5 * (pairs == 0)).mean())
    assert area.low < area.value < area.high < 1


def test_knowledge_comes_from_quiet_levels_alone():
    noisy = next(one for one in FOUND if one.name == "dsn16" and one.level == 0.5)
    everything = [noisy._replace(quiet=True), *FOUND]
    more, less = (TABLE.count(f"{detectors.known(found)} >= 0") for found in (everything, FOUND))
    assert more > less


def test_no_curve_without_harm_or_without_a_second_fault():
    nothing = FRAME.assign(moved_first_ms=-1, jump_code=False)
    runs = Runs.of(nothing, MANIFEST)
    rows = detectors.rows(runs, MANIFEST, detectors.alarms(runs, MANIFEST))
    assert all(row.roc is None for row in rows)
    assert detector_figures.roc(rows) is None and detector_figures.precision_recall(rows) is None


def test_many_levels_are_thinned_and_the_quiet_one_stays():
    levels = tuple(np.linspace(0.1, 4, 40).tolist())
    columns = {
        f"detector0_level{k}_first_ms": np.where(FRAME["detector0_score"] > x, 900, -1) for k, x in enumerate(levels)
    }
    frame = pd.concat([FRAME.drop(columns=[c for c in columns if c in FRAME]), pd.DataFrame(columns)], axis=1)
    manifest = synthetic.manifest(RUNS, detectors=(Detector("many", "steps", "all", 1, levels), MANIFEST.detectors[1]))
    runs = Runs.of(frame, manifest)
    row = detectors.rows(runs, manifest, detectors.alarms(runs, manifest))[0]
    assert detectors.MOST_LEVELS <= len(row.levels) <= detectors.MOST_LEVELS + 1
    assert [level.level for level in row.levels if level.quiet] == [min(x for x in levels if x >= 0.7)]


def test_figures_are_valid_and_small():
    import plotly.graph_objects as go

    curves = detectors.curves(TABLE, MANIFEST, FOUND)
    rows = list(ROWS.values())
    for text in (
        detector_figures.roc(rows),
        detector_figures.precision_recall(rows),
        detector_figures.delays(curves, 3000),
        detector_figures.leads(curves),
    ):
        assert text is not None
        figure = go.Figure(json.loads(text))
        assert figure.data and max(len(trace.x) for trace in figure.data) <= 2 * 201
