"""Tables as CSV."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from ravenjax.report import downloads
from ravenjax.report.sections.cues import Choice
from ravenjax.stats.intervals import wilson
from ravenjax.store.manifest import CueRecord


def read(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_rates_records_and_models_become_columns():
    rows = [
        {
            "group": 'a, "b"\n<c>',
            "share": wilson(3, 10),
            "cue": CueRecord(threshold_mm=3.0, kp_per_mm=0.1),
        }
    ]
    (row,) = read(downloads.text(rows))
    assert row["group"] == 'a, "b"\n<c>' and (row["share_k"], row["share_n"]) == ("3", "10")
    assert float(row["share_low"]) == wilson(3, 10).low
    assert row["cue_threshold_mm"] == "3.0" and row["cue_cap"] == ""


def test_what_is_not_known_is_empty_and_lists_are_left_out():
    rows = [
        {"a": math.nan, "b": None, "c": [1], "d": np.arange(3), "with_": np.float32(0.5)},
        {"e": 1},
    ]
    first, second = read(downloads.text(rows))
    assert first == {"a": "", "b": "", "with": "0.5", "e": ""} and second["e"] == "1"


def test_named_tuples_are_rows_and_none_make_no_file():
    (row,) = read(downloads.text([Choice("rule", None, 0, "2 or 3 mm", 7.5, "", float("nan"))]))
    assert row["rule"] == "rule" and row["row"] == "" and row["alike"] == "0"
    assert (row["possible"], row["hours"], row["least_mm"]) == ("2 or 3 mm", "7.5", "")
    assert downloads.text([]) == ""
