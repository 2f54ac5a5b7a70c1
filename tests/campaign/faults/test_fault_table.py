"""The fault table's columns, and the same as a DataFrame."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest
from pandas.util import hash_array

from ravenjax.campaign import loading, plan
from ravenjax.campaign.faults import design, run_id
from ravenjax.campaign.faults.fault_table import FaultTable

FAULT = {
    "site": "usb_out",
    "channel": ["elbow", "wrist"],
    "effect": ["offset", "scale"],
    "value": [1, 2, 3],
    "start_ms": 20,
}
CONFIG = {
    "campaign": {"name": "t", "duration_s": 1.0},
    "group": [
        {"name": "one", "fault": [FAULT]},
        {"name": "free", "parameters": {"plant.mass_scale": [0.9, 1.1]}},
    ],
}


@pytest.fixture(scope="module")
def config():
    return loading.from_dict(CONFIG)


@pytest.fixture(scope="module")
def rows(config):
    return design.rows(config)


def test_a_frame_has_the_same_columns_and_comes_back(config, rows):
    frame = rows.frame()
    assert list(frame) == list(rows) and len(frame) == len(rows) == 14
    assert frame["fault0_site"].dtype == "category" and frame["run_id"].dtype == np.uint64
    assert frame.equals(design.expand(config)) and FaultTable.of(frame).frame().equals(frame)
    assert "seed" in rows and "nothing" not in rows


@pytest.mark.parametrize(
    "some", [slice(3, 9), slice(None, None, -2), np.array([5, 0, 5]), np.arange(14) % 3 == 1]
)
def test_rows_are_those_of_the_frame(rows, some):
    wanted = rows.frame().iloc[some].reset_index(drop=True)
    assert rows.take(some).frame().equals(wanted)
    assert len(rows.take(some)) == len(wanted)


def test_columns_are_replaced_in_their_places(rows):
    other = rows.replaced(index=np.arange(14) * 2)
    assert list(other) == list(rows) and other.numbers("index")[-1] == 26
    assert rows.numbers("index")[-1] == 13


def test_numbers_are_no_words_and_words_no_numbers(rows):
    with pytest.raises(AssertionError):
        rows.numbers("group")
    with pytest.raises(AssertionError):
        rows.words("seed")


def test_a_table_travels(rows):
    assert pickle.loads(pickle.dumps(rows)).frame().equals(rows.frame())


def test_a_plan_has_both_forms(config):
    ready = plan.make_plan(config)
    assert ready.table.equals(ready.rows.frame()) and ready.runs == len(ready.table)


def test_ids_are_those_of_pandas_hash():
    numbers = np.random.default_rng(1).integers(0, 2**64, 10_000, np.uint64)
    before = numbers.copy()
    np.testing.assert_array_equal(run_id.mixed(numbers), hash_array(numbers))
    np.testing.assert_array_equal(numbers, before)


def test_golden_runs_are_numbered_as_they_come():
    rng = np.random.default_rng(2)
    varied = {
        "a": rng.integers(0, 4, 500).astype(np.float32),
        "same": np.ones(500),
        "b": rng.integers(0, 9, 500),
    }
    keys = pd.Series(list(zip(*varied.values(), strict=True)))
    np.testing.assert_array_equal(plan._golden_runs(varied, 500), pd.factorize(keys)[0])
    assert plan._golden_runs({}, 3).tolist() == [0, 0, 0]
