"""Work on slices of many rows: nothing of it shows in what comes out."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design, run_id, slices, table
from ravenjax.errors import UserError


@pytest.mark.parametrize("rows", [1, 7, 8, 9, 64, 65])
def test_columns_of_slices_are_joined_in_order(monkeypatch, rows):
    monkeypatch.setattr(slices, "ROWS", 8)
    source = np.random.default_rng(1).random((rows, 3))

    def columns(some):
        return {
            "whole": source[some],
            "first": source[some, 0].astype(np.float32),
            "all": np.int8(4),
        }

    got = slices.joined(columns, rows)
    assert np.array_equal(got["whole"], source) and got["whole"].dtype == np.float64
    assert (
        np.array_equal(got["first"], source[:, 0].astype(np.float32))
        and got["first"].dtype == np.float32
    )
    assert got["all"] == 4 and np.ndim(got["all"]) == 0


CAMPAIGN = """
[campaign]
name = "sliced"
seed = 5
duration_s = 1.0
[parameters]
"nominal.ki" = { uniform = [0.1, 0.2] }
[[group]]
name = "drawn"
design = "random"
runs = 70
repeats = 3
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow"]
effect = ["overwrite", "stuck"]
value = { uniform = [-20000, 20000] }
start_ms = { uniform = [0, 900] }
duration_ms = 10
[[group.fault]]
site = "encoder"
channel = "shoulder"
effect = "offset"
value = 4
start_ms = { choice = [1, 2] }
duration_ms = [5, 7]
[[group]]
name = "grid"
[group.cross]
"nominal.kd" = [0.1, 0.2]
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow", "insertion"]
effect = "overwrite"
value = { list = [1, 2, 3] }
start_ms = { uniform = [0, 900] }
duration_ms = 10
[[group]]
name = "listed"
design = "list"
[[group.fault]]
site = "usb_out"
channel = "elbow"
effect = "overwrite"
value = 3
start_ms = { uniform = [0, 900] }
duration_ms = 4
[[group.run]]
[[group.run]]
fault = [{ value = 9 }]
"""


def table_of(tmp_path, text=CAMPAIGN):
    (tmp_path / "campaign.toml").write_text(text)
    config = loading.load(tmp_path / "campaign.toml")
    rows = design.rows(config)
    injection = table.injection(rows, config.robot)
    return rows.frame(), injection, table.arrays(rows, injection)


def test_a_fault_table_is_the_same_whatever_the_slices(monkeypatch, tmp_path):
    whole, injection, arrays = table_of(tmp_path)
    monkeypatch.setattr(slices, "ROWS", 11)
    sliced, other_injection, other_arrays = table_of(tmp_path)
    assert len(whole) > 200 and whole.dtypes.equals(sliced.dtypes) and whole.equals(sliced)
    assert injection == other_injection
    for name, values in arrays.items():
        assert values.dtype == other_arrays[name].dtype and np.array_equal(
            values, other_arrays[name]
        ), name


def test_the_first_value_that_cannot_be_is_named_whatever_the_slices(monkeypatch, tmp_path):
    text = CAMPAIGN.replace("uniform = [-20000, 20000]", "uniform = [-90000, 90000]")
    words = []
    for rows in (slices.ROWS, 11):
        monkeypatch.setattr(slices, "ROWS", rows)
        with pytest.raises(UserError) as error:
            table_of(tmp_path, text)
        words.append(str(error.value))
    assert words[0] == words[1] and "fault[0].value" in words[0]


def test_copies_of_ids_are_found_whatever_the_slices(monkeypatch):
    rng = np.random.default_rng(3)
    values = {"a": rng.integers(0, 200, 1000).astype(float)}
    whole = run_id.of("common", {}, values)
    monkeypatch.setattr(slices, "ROWS", 16)
    assert np.array_equal(whole, run_id.of("common", {}, values)) and len(np.unique(whole)) == 1000
