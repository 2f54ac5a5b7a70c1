"""Kinds of faults: by the names of groups."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ravenjax.campaign import loading
from ravenjax.campaign.inspection import draws
from ravenjax.stats.bootstrap.units import FEW
from ravenjax.studies.framework import kinds

GROUPS = ["library/C01-above", "library/C01-below", "library/B24", "sampled/encoder", "sampled/torque", "quick"]


def test_cases_of_a_hazard_are_one_kind_and_families_are_strata():
    assert kinds.names(GROUPS).tolist() == ["C01", "C01", "B24", "sampled/encoder", "sampled/torque", "quick"]
    assert kinds.families(GROUPS).tolist() == ["library"] * 3 + ["sampled"] * 2 + [""]
    among = kinds.of(pd.Series(GROUPS, dtype="category"))
    assert among.count == 5 and among.stratum.tolist() == [0, 0, 1, 1, 2]


def test_few_kinds_are_said_to_be_few():
    assert kinds.count(kinds.of(GROUPS)) == "5 kinds, few"
    assert kinds.count(kinds.of([f"sampled/{k}" for k in range(FEW)])) == f"{FEW} kinds"
    assert kinds.count(kinds.of(["a"])) == "1 kind, few"


def test_a_group_draws_its_faults_or_enumerates_them():
    config = loading.load("quick.toml")
    drawn = draws.groups(config)
    by_name = {group.name: group for group in config.group}
    assert {"dac_unchecked", "packet_offset"} <= drawn
    assert "console_scale" not in drawn and by_name["console_scale"].design == "grid"
    assert "fault_free" not in drawn  # nothing that strikes
    assert draws.groups(loading.load("uncertain_robot.toml")) == {
        group.name for group in loading.load("uncertain_robot.toml").group if group.fault
    }  # listed values, picked at random


def test_drawn_operators_make_no_drawn_faults():
    config = loading.load("reacting_operator.toml")  # every run has a reaction time that was drawn
    assert "library/B24" not in draws.groups(config)
    assert np.isin(["sampled/encoder", "library/B11"], sorted(draws.groups(config))).all()
