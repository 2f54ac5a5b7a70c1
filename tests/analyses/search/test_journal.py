"""Runs of a search on disk: taken over by the next start, whatever became of the last one."""

import numpy as np

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading, outcome
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
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


def test_a_damaged_part_is_set_aside_and_named(tmp_path):
    """Of three batches, each in a part of its own."""
    made = Evaluator(TEMPLATE, [outcome.parse_outcome("peak_golden_deviation_mm")], "simd")
    made.use_journal(Journal(tmp_path, "same"), 30, None)
    for rows in (slice(0, 10), slice(10, 12), slice(12, 30)):
        made(CASE[rows], VALUES[rows])
    first, second, last = parts.part_files(tmp_path / folder.PARTS)
    assert [parts.row_range(path) for path in (first, second, last)] == [(0, 9), (10, 11), (12, 29)]
    content = bytearray(last.read_bytes())
    content[len(content) // 2] ^= 1
    last.write_bytes(content)
    again = Journal(tmp_path, "same")
    (note,) = again.notes
    place = str(tmp_path / folder.SET_ASIDE / last.name)
    assert place in note and "start the same command again" in note
    assert not last.exists() and sum(map(len, again.tables)) == 12
