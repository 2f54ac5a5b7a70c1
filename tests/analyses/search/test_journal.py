"""Runs of a search on disk: taken over by the next start, whatever became of the last one."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading, outcome
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
from ravenjax.errors import StoreError
from ravenjax.store import folder, parts

FAULT = {
    "site": "usb_out",
    "channel": ["shoulder", "elbow"],
    "effect": "offset",
    "start_ms": 250,
    "duration_ms": 9,
}
TEMPLATE = Template(
    loading.from_dict(
        {
            "campaign": {"name": "kept", "duration_s": 0.3, "seed": 3},
            "operator": {"motion": "reach"},
            "search": {"kind": "rare", "event": "peak_golden_deviation_mm >= 1", "runs": 100},
            "group": [{"name": "dac", "fault": [FAULT | {"value": {"uniform": [0, 9000]}}]}],
        }
    ).campaign
)
CASE, VALUES = np.tile([0, 1], 15), np.arange(30.0)[:, None] * 600


def searching(out) -> Evaluator:
    """An evaluator that keeps its runs in `out`."""
    made = Evaluator(TEMPLATE, [outcome.parse_outcome("peak_golden_deviation_mm")], "simd")
    made.keep_in(Journal(out, "same"), 30, None)
    return made


def ask(evaluator) -> np.ndarray:
    """Three batches, and what they return."""
    return np.concatenate(
        [
            evaluator(CASE[rows], VALUES[rows])
            for rows in (slice(0, 10), slice(10, 12), slice(12, 30))
        ]
    )


def stored(search):
    """Rows that this start of the search has stored."""
    status = search.progress.status
    return status.done - status.earlier


@pytest.fixture
def kept(tmp_path):
    """A folder with three batches, each in a part of its own; what they returned; their rows."""
    made = searching(tmp_path)
    found = ask(made)
    assert stored(made) == 30 and len(np.unique(found)) > 20
    assert [parts.row_range(path) for path in parts.part_files(tmp_path / folder.PARTS)] == [
        (0, 9),
        (10, 11),
        (12, 29),
    ]
    return tmp_path, found, made.rows()


def test_a_damaged_part_is_set_aside_and_named(kept):
    out, _, _ = kept
    last = parts.part_files(out / folder.PARTS)[2]
    content = bytearray(last.read_bytes())
    content[len(content) // 2] ^= 1
    last.write_bytes(content)
    (note,) = Journal(out, "same").notes
    assert (
        str(out / folder.SET_ASIDE / last.name) in note and "start the same command again" in note
    )
    assert not last.exists()


def test_a_disk_that_refuses_is_told_of(tmp_path, monkeypatch):
    def full(*_):
        raise StoreError("no space left")

    made = searching(tmp_path)
    monkeypatch.setattr(parts, "put_part", full)
    with pytest.raises(StoreError, match="no space left"):
        ask(made)
    monkeypatch.undo()
    again = searching(tmp_path)
    assert again.held == 0
    ask(again)
    assert stored(again) == 30
