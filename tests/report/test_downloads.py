"""Tables as CSV."""

from __future__ import annotations

import csv
import io

from ravenjax.report import downloads
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
