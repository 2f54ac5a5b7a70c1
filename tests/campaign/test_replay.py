"""Finding a run by what a user types."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.campaign import replay
from ravenjax.errors import UserError

IDS = np.array([0xAB00000000000001, 0xAB10000000000000, 0x1234567890123456, 0x12], np.uint64)


@pytest.mark.parametrize(
    ("typed", "index"),
    [(2, 2), ("2", 2), ("ab1", 1), ("ab00000000000001", 0), ("1234567890123456", 2), ("0000000000000012", 3)],
)
def test_a_run_is_found_by_index_id_or_beginning(typed, index):
    assert replay.find(IDS, typed) == index


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (4, "runs 0..3"),
        (-1, "runs 0..3"),
        ("99", "runs 0..3"),
        ("ab", "2 runs begin so"),
        ("abc", "no run has this id"),
        ("", "no run has this id"),
        ("zz", "no run has this id"),
    ],
)
def test_what_is_no_run_is_named(typed, told):
    with pytest.raises(UserError, match=f"run '?{typed}'?: .*{told}"):
        replay.find(IDS, typed)
