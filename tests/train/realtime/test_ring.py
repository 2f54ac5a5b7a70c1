"""Rings: what was written is read in order, by another process too; what was overwritten is
told.
"""

import multiprocessing

import numpy as np
import pytest
import waiting
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.store.ring import EVENT_BYTES, Ring, put_json, read_json


@pytest.fixture
def ring():
    made = Ring.create(8, 12)
    yield made
    made.close()


def put(ring, number):
    ring.put(np.full(ring.row_bytes // 4, number, np.float32).view(np.uint8))


def numbers(rows):
    return rows.view(np.float32)[:, 0].tolist()


@given(written=st.integers(0, 40), first=st.integers(0, 45), limit=st.none() | st.integers(0, 10))
def test_a_reader_gets_what_it_asked_for_or_learns_what_is_gone(written, first, limit):
    ring = Ring.create(8, 12)
    try:
        for number in range(written):
            put(ring, number)
        start, rows = ring.read(first, limit)
        found = numbers(rows)
        assert found == list(range(start, start + len(found)))  # never an invented or a doubled row
        assert start == max(first, written - 7, 0) and start + len(found) <= max(written, start)
        assert len(found) == max(0, min(written - start, 8 if limit is None else limit))
    finally:
        ring.close()


def _sum(name, result):
    ring = Ring.attach(name)
    result.put(numbers(ring.read(0)[1]))
    ring.close()


def test_another_process_reads_the_same(ring):
    for number in range(3):
        put(ring, number)
    context = multiprocessing.get_context("spawn")
    result = context.Queue()
    process = context.Process(target=_sum, args=(ring.name, result))
    process.start()
    assert result.get(timeout=waiting.DEADLINE_S) == [0, 1, 2]
    process.join(10)
    put(ring, 3)  # the ring is still there: it is its creator's
    assert ring.written == 4


def test_events_are_dicts_again_and_one_that_is_too_long_is_refused():
    ring = Ring.create(4, EVENT_BYTES)
    try:
        put_json(ring, {"tick": 1, "kind": "note", "text": "zwölf"})
        put_json(ring, {"tick": 2, "kind": "cue"})
        assert list(read_json(ring.read(0)[1])) == [
            {"tick": 1, "kind": "note", "text": "zwölf"},
            {"tick": 2, "kind": "cue"},
        ]
        with pytest.raises(ValueError, match="'note' has"):
            put_json(ring, {"kind": "note", "text": "x" * EVENT_BYTES})
        assert ring.written == 2
    finally:
        ring.close()
