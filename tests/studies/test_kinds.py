"""Kinds of faults: by the names of groups."""

import pandas as pd

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
