"""What is derived of each run, against a plain count and on rows made by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax.report import facts as run_facts
from ravenjax.report import layers
from ravenjax.robot.sites import SITES
from ravenjax.stages import reaction

FRAME = synthetic.frame(600)


def test_layers_and_actions_are_those_of_the_robot():
    assert {site.name: site.layer for site in SITES.values()} == layers.OF_SITE
    assert {site.layer for site in SITES.values()} == set(layers.LAYERS)
    assert {name: n for n, name in enumerate(run_facts.ACTIONS)} == reaction.ACTIONS
    assert layers.name("usb_out") == "USB out, motors" and layers.name("dac of old") == layers.OTHER


def test_harm_is_the_first_of_a_stray_and_a_jump_that_the_twin_has_not():
    frame = FRAME.head(6).copy()
    frame["failed"] = ["", "", "", "", "", "nan"]
    frame["moved_first_ms"] = [500, 500, -1, 500, -1, 500]
    frame["twin_moved_first_ms"] = [-1, 400, -1, 600, 300, -1]
    frame["jump_code"] = [True, False, True, False, False, True]
    frame["jump_code_first_ms"] = [450, -1, 700, -1, -1, 450]
    facts = run_facts.derive(frame)
    assert facts["harm_ms"].tolist() == [450, -1, 700, 500, -1, -1]
    assert facts["harm"].tolist() == [True, False, True, True, False, False]
    assert facts["moved_ms"].tolist() == [500, -1, -1, 500, -1, -1]


def test_a_cue_that_the_twin_has_too_tells_nothing():
    frame = FRAME.head(4).assign(cue0_first_ms=[100, 100, 100, -1], twin_cue0_first_ms=[-1, 100, 101, 50])
    assert run_facts.warned(frame, 0).tolist() == [100, -1, 100, -1]


def test_first_of_several_times_in_any_type():
    times = [np.array([-1, 5, 7], np.int32), np.array([3, -1, 9], np.int64), np.array([-1, -1, 8], np.int16)]
    assert run_facts.first_of(*times).tolist() == [3, 5, 7]
    assert run_facts.first_of(np.array([-1], np.int32)).tolist() == [-1]


def test_crossed_runs_are_one_fault_and_one_of_them_is_the_sample():
    frame = reacting.frame(80)
    facts = run_facts.of(frame, reacting.manifest(len(frame)))
    assert facts["distinct"].nunique() == 80
    assert facts["action"].tolist() == [0] * 80 + [1] * 80 + [3] * 80
    assert facts["plain"].tolist() == [True] * 80 + [False] * 160
    valid = ~facts["failed"]
    assert facts["sample"].sum() == valid[:80].sum() and not facts.loc[facts["sample"], "failed"].any()


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
    assert facts["distinct"].nunique() == 1 and facts["sample"].tolist() == [False, True, *[False] * 8]


def test_fault_free_motions_that_are_one_computation_count_once():
    frame = FRAME.head(40).assign(operator="suture", twin_tip_path_mm=np.repeat([30.0, 31.0], 20))
    free = run_facts.motions(frame, run_facts.derive(frame))
    assert len(free) == 2
    assert run_facts.hours(free) == 2 * 2800 / 3.6e6
    frame = frame.assign(operator=np.where(np.arange(40) % 2, "suture", "circle"))
    assert len(run_facts.motions(frame, run_facts.derive(frame))) == 4


def test_an_index_that_is_no_count_is_kept():
    frame = FRAME.sample(100, random_state=1)
    facts = run_facts.derive(frame)
    pd.testing.assert_index_equal(facts.index, frame.index)
    assert facts["sample"].sum() == (frame["failed"] == "").sum()
