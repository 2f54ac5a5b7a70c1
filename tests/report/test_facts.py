"""What is derived of each run, against a plain count and on rows made by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax import robots
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.runs import Runs
from ravenjax.robots.raven2.declaration import LAYERS, SITES
from ravenjax.vocabulary.robot import OTHER_LAYER

FRAME = synthetic.frame(600)


def test_every_layer_has_a_name_and_a_site():
    assert {site.layer for site in SITES.values()} == set(LAYERS)
    robot = robots.find(robots.DEFAULT)
    assert robot.layer("usb_out") == "USB out, motors" and robot.layer("dac of old") == OTHER_LAYER


def quiet(runs):
    """Rows of faults that do nothing, one golden run."""
    never = {
        name: -1
        for name in FRAME
        if name.endswith("_first_ms") and not name.startswith(("applied", "golden_"))
    }
    never |= {
        "response": "silent",
        "response_cause": "",
        "response_ms": -1,
        "told_ms": -1,
        "first_active_ms": 200,
    }
    never |= {"failed": "", "halted_ms": 4, "golden_halted_ms": 4, "activated": True}
    return FRAME[FRAME["fault0_site"] != ""].head(runs).assign(**never).reset_index(drop=True)


def test_the_gravest_hazard_is_the_runs_and_only_its_time_is_told():
    frame = quiet(6)
    frame["unintended_first_ms"] = [500, -1, -1, -1, -1, 500]
    frame["loss_first_ms"] = [300, 700, -1, -1, -1, -1]
    frame["false_report_first_ms"] = [250, 250, 250, 250, -1, -1]
    frame["halted_ms"] = [
        900,
        900,
        205,
        204,
        4,
        4,
    ]  # golden run: 4, so that 205 is 201 more and 204 is 200
    frame["failed"] = ["", "", "", "", "", "nan"]
    facts = run_facts.derive(synthetic.judged(frame))
    assert facts["hazard"].tolist() == [
        "unintended motion",
        "loss of motion",
        "loss of motion",
        "false report",
        "none",
        "",
    ]
    assert facts["unintended_ms"].tolist() == [500, -1, -1, -1, -1, -1]
    assert facts["loss_ms"].tolist() == [-1, 700, -1, -1, -1, -1]
    assert facts["misreport_ms"].tolist() == [-1, -1, -1, 250, -1, -1]
    assert facts["halted"].tolist() == [False, False, True, False, False, False]


def test_who_stops_the_robot_loses_no_motion_by_it():
    frame = quiet(2).assign(
        halted_ms=[2000, 2000], response=["stopped", "flagged"], response_ms=300, told_ms=300
    )
    assert run_facts.derive(synthetic.judged(frame))["outcome"].tolist() == ["stopped", "flagged"]
    assert run_facts.derive(synthetic.judged(frame))["hazard"].tolist() == [
        "none",
        "loss of motion",
    ]


def test_a_limit_tells_nobody_so_the_motion_evades():
    frame = quiet(4).assign(
        unintended_first_ms=500, response=["silent", "limited", "flagged", "stopped"]
    )
    facts = run_facts.derive(synthetic.judged(frame))
    assert facts["evaded"].tolist() == [True, True, False, False]
    assert facts["told"].tolist() == [False, False, True, True]


def test_a_cue_that_the_golden_run_has_too_tells_nothing():
    frame = quiet(4).assign(
        cue0_first_ms=[100, 100, 100, -1], golden_cue0_first_ms=[-1, 100, 101, 50]
    )
    assert run_facts.warned(frame, 0).tolist() == [100, -1, 100, -1]
    facts = run_facts.derive(synthetic.judged(frame))
    assert facts["warned_ms"].tolist() == [100, -1, 100, -1] and facts["cue_ms"].tolist() == [
        100,
        100,
        100,
        -1,
    ]
    assert facts["cued"].tolist() == [True, False, True, False]


def test_first_of_several_times():
    frame = quiet(3).assign(cue0_first_ms=[-1, 5, 7], told_ms=[3, -1, 9], response_ms=[-1, -1, 8])
    runs = Runs.of(synthetic.judged(frame), synthetic.manifest(3))
    found = runs.table.rows(
        f"SELECT {run_facts.first_sql('cue_ms', 'told_ms', 'response_ms')} FROM facts ORDER BY row"
    )
    assert found == [(3,), (5,), (7,)]
    assert runs.table.rows(f"SELECT DISTINCT {run_facts.first_sql('-1', '-1')} FROM facts") == [
        (-1,)
    ]


def test_crossed_runs_are_one_fault_and_one_of_them_is_the_sample():
    frame = reacting.frame(80)
    facts = run_facts.of(frame, reacting.manifest(len(frame)))
    assert facts["distinct"].nunique() == 80
    assert facts["action"].tolist() == [0] * 80 + [1] * 80 + [3] * 80
    assert facts["plain"].tolist() == [True] * 80 + [False] * 160
    valid = ~facts["failed"]
    assert (
        facts["sample"].sum() == valid[:80].sum() and not facts.loc[facts["sample"], "failed"].any()
    )


def test_who_reacts_without_being_told_otherwise_follows_the_campaign():
    frame = reacting.frame(40)
    frame.loc[frame["param:reaction.action"] == 1, "param:reaction.action"] = np.nan
    facts = run_facts.of(frame, reacting.manifest(len(frame)))
    assert facts["action"].tolist() == [0] * 40 + [1] * 40 + [3] * 40
    everybody = frame.assign(**{"param:reaction.action": 1.0})
    assert run_facts.of(everybody, reacting.manifest(len(frame)))["plain"].all()


def test_repeats_with_other_random_numbers_are_one_fault():
    given = [c for c in FRAME if c.startswith(("fault", "param:")) or c == "operator"]
    frame = FRAME.head(10).copy()
    frame[given] = frame.loc[[0] * 10, given].to_numpy()
    frame["failed"] = ["nan", *[""] * 9]
    facts = run_facts.derive(frame)
    assert facts["distinct"].nunique() == 1 and facts["sample"].tolist() == [
        False,
        True,
        *[False] * 8,
    ]


def test_fault_free_motions_that_are_one_computation_count_once():
    frame = FRAME.head(40).assign(operator="suture", golden_tip_path_mm=np.repeat([30.0, 31.0], 20))
    free = run_facts.golden_runs(frame, run_facts.derive(frame)["plain"].to_numpy(bool))
    assert len(free) == 2
    assert run_facts.hours(free) == 2 * 2800 / 3.6e6
    frame = frame.assign(operator=np.where(np.arange(40) % 2, "suture", "circle"))
    assert len(run_facts.golden_runs(frame, run_facts.derive(frame)["plain"].to_numpy(bool))) == 4


def test_an_index_that_is_no_count_is_kept():
    frame = FRAME.sample(100, random_state=1)
    facts = run_facts.derive(frame)
    pd.testing.assert_index_equal(facts.index, frame.index)
    assert facts["sample"].sum() == (frame["failed"] == "").sum()
