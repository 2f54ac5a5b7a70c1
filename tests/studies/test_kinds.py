"""Kinds of faults: by the names of groups."""

from __future__ import annotations

import pandas as pd

from ravenjax.stats.bootstrap.units import FEW
from studies import kinds

GROUPS = [
    "library/C01-above",
    "library/C01-below",
    "library/B24",
    "sampled/encoder",
    "sampled/torque",
    "quick",
]


def test_cases_of_a_hazard_are_one_kind_and_families_are_strata():
    assert kinds.names(GROUPS).tolist() == [
        "C01",
        "C01",
        "B24",
        "sampled/encoder",
        "sampled/torque",
        "quick",
    ]
    assert kinds.families(GROUPS).tolist() == ["library"] * 3 + ["sampled"] * 2 + [""]
    among = kinds.of(pd.Series(GROUPS, dtype="category"))
    assert among.count == 5 and among.stratum.tolist() == [0, 0, 1, 1, 2]


def test_few_kinds_are_said_to_be_few():
    assert kinds.count(kinds.of(GROUPS)) == "5 kinds, few"
    assert kinds.count(kinds.of([f"sampled/{k}" for k in range(FEW)])) == f"{FEW} kinds"
    assert kinds.count(kinds.of(["a"])) == "1 kind, few"
