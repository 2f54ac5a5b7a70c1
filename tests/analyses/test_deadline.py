"""Deadlines against every tick tried, actions against faults that do the same, and the summary
against NumPy.
"""

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

import ravenjax as rj
from ravenjax import cli
from ravenjax.analyses.deadline import Actor, FaultActions
from ravenjax.report import page
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import deadline
from ravenjax.stats.intervals import wilson_interval
from ravenjax.store.access import explained

JOINTS = rj.load_campaign("quick").robot.joints
BLOCKS = [{"name": name, "fault": [{"value": {"uniform": [0, 1]}}]} for name in synthetic.BLOCKS]
FRAME, RECORD = synthetic.frame(900), synthetic.manifest(900)
DRAWN = RECORD.model_copy(update={"config": {**RECORD.config, "group": BLOCKS}})


def fault(site, channel, value, start, duration: Any = "end"):
    return {"site": site, "channel": channel, "effect": "overwrite", "value": value} | {
        "start_ms": start,
        "duration_ms": duration,
    }


def campaign(groups, **more):
    settings = {"name": "acted", "duration_s": 1.0, **more}
    return rj.load_campaign({"campaign": settings, "operator": {"motion": "suture"}, **groups})


@pytest.mark.slow
def test_an_action_is_the_fault_that_does_the_same():
    effect, at = 700, 712
    push = fault("usb_out", "shoulder", 9000, effect, 40)
    plain = campaign({"group": [{"name": "g", "fault": [push]}]})
    before = rj.simulate(plain, 0)["boards_cnt"].sel(arm="gold").values[effect - 1]
    same = {
        "estop": [fault("buttons", "estop", 1, at)],
        "stop": [fault("parameter", "control.overdrive.max_inst_dac", 0, at, 1)],
        "hold": [
            fault("usb_out", joint, int(x), at) for joint, x in zip(JOINTS, before, strict=True)
        ],
    }
    groups = [{"name": name, "fault": [push, *more]} for name, more in same.items()]
    reacting = {"group": [{"name": "pedal", "fault": [push]}], "reaction": {"delay_ms": 20}}
    lifted = rj.run(campaign(reacting), engine="simd")
    expected = pd.concat([lifted, rj.run(campaign({"group": groups}), engine="simd")])
    actor = Actor(plain, "simd")
    numbers = np.array([actor.actions[name] for name in expected["group"]])
    lanes = FaultActions(np.zeros(4, int), numbers, np.full(4, effect), np.full(4, 800))
    ours = actor.run(lanes, np.array([lifted["reaction_ms"].iloc[0], at, at, at]))
    for column in ("peak_golden_deviation_mm", "tip_path_mm", "largest_step_mm"):
        assert ours[column].tolist() == expected[column].tolist(), column
    assert len(set(ours["tip_path_mm"].tolist())) == 4 and lifted["reaction_ms"].iloc[0] > effect
    unchanged = actor.run(lanes._replace(action=0 * numbers), np.full(4, at))
    usual = rj.run(plain, engine="simd")
    converted = {"cable_overload", "tip_distance_mm", "tissue_depth_mm"}
    for column in (unchanged.keys() & usual.columns) - converted:
        np.testing.assert_array_equal(unchanged[column][0], usual[column].iloc[0])


@pytest.mark.slow
def test_the_table_of_a_campaign_is_that_of_every_tick(tmp_path, capsys):
    drawn = {
        "name": "dac",
        "design": "random",
        "runs": 24,
        "fault": [
            fault("usb_out", ["shoulder", "elbow"], {"uniform": [-20000, 20000]}, 600, [16, 64])
        ],
    }
    rj.run(campaign({"group": [drawn]}), out=tmp_path, engine="simd")
    assert cli.main(["deadline", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    table: Any = explained.read_deadlines(tmp_path)
    results: Any = rj.open_results(tmp_path).to_pandas().set_index("run_id")
    harmful = results[results["hazard"] == "unintended motion"]
    assert set(table["run"]) == set(harmful.index)
    assert said["harmful"] == len(harmful) > 5
    actor, ticks = Actor.of_folder(tmp_path), np.arange(90)
    acted = table[table["action"] != "cue"].set_index(["run", "action"])
    for run, row in harmful.iterrows():
        start, end = row["first_active_ms"], row["unintended_first_ms"]
        at = start + ticks[: end - start + 1]
        for name, number in actor.actions.items():
            lanes = FaultActions(*(np.full(len(at), x) for x in (row["index"], number, start, end)))
            prevents = np.flatnonzero(~actor.harmful(lanes, at))
            found = acted.loc[(run, name)]
            assert found["deadline_ms"] == prevents.max(initial=-1), (run, name)
    late = table.pivot(index="run", columns="action", values="deadline_ms")
    assert (late["pedal"] - 250 == late["cue"]).all() and table["visible_ms"].min() >= 0


def made_up(seed=0) -> Any:
    """Made-up deadlines of all harmful faults, for two actions."""
    random = np.random.default_rng(seed)
    facts = Runs.of(FRAME, DRAWN)
    rows = facts.table.rows(
        "SELECT run_id FROM results JOIN facts USING (row)"
        " WHERE sample AND faulty AND facts.unintended"
    )
    runs = np.array([run for (run,) in rows])
    parts = []
    for action, most in (("pedal", 90), ("stop", 30)):
        late = random.integers(-1, most, len(runs)).astype(float)
        seen = np.where(random.random(len(runs)) < 0.7, random.integers(0, 40, len(runs)), np.nan)
        parts.append(
            pd.DataFrame({"run": runs, "action": action, "deadline_ms": late, "visible_ms": seen})
        )
    whole = pd.concat(parts, ignore_index=True).assign(effect_ms=500, monotone=True)
    whole["margin_ms"] = whole["deadline_ms"] - whole["visible_ms"]
    return whole.assign(harms_alone=False)


def test_the_summary_is_that_of_numpy():
    table = made_up()
    summary = deadline.summarize_deadlines(Runs.of(FRAME, DRAWN), table)
    assert summary.counted == "faults" and not summary.lacking
    for row in summary.of("")[""]:
        mine = table[table["action"] == row.action]
        late, n = mine["deadline_ms"].to_numpy(), len(mine)
        assert row.preventable == wilson_interval(int((late >= 0).sum()), n)
        latest = max(x for x in np.unique(late) if (late >= x).mean() >= deadline.GOAL)
        assert row.goal_ms.value == latest and row.goal_ms.low <= latest <= row.goal_ms.high
        assert row.goal == wilson_interval(int((late >= latest).sum()), n)
        assert row.in_time == wilson_interval(int((mine["margin_ms"] >= 0).sum()), n)
    for kind in ("site", "group"):
        rows = [row for rows in summary.of(kind).values() for row in rows]
        assert sum(row.preventable.n for row in rows) == len(table)


@pytest.mark.slow
def test_the_report_has_the_section(monkeypatch, tmp_path):
    monkeypatch.setattr(
        explained, "read_rows", lambda path, *_: made_up() if "deadline" in str(path) else None
    )
    text = page.render_report(Runs.of(FRAME, DRAWN), DRAWN, tmp_path)
    assert '<section id="deadline">' in text and "prevents" in text
