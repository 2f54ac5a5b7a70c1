"""The fault table's columns, and the same as a DataFrame."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
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
