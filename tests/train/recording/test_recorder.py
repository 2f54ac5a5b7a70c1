"""The recorder as a process: what it writes, and what is left of it when it is killed."""

import json
import multiprocessing
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import waiting
from mcap.reader import make_reader

from ravenjax.errors import StoreError
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.store.ring import EVENT_BYTES, Ring, put_json
from ravenjax.train.protocol import FrameLayout
from ravenjax.train.recording import reader, recorder

pytestmark = pytest.mark.slow

LAYOUT = FrameLayout.of(("gold", "green"))
HEADER = {
    "arms": ["gold", "green"],
    "name": "synthetic",
    "seed": 7,
    "started": "2026-01-02T03:04:05.678+00:00",
}


def row_of(number):
    """Any row: a number of its own in each place, so that a shifted or torn one is seen."""
    row = (np.arange(LAYOUT.size) * 0.25 + number).astype(np.float32)
    row[LAYOUT.places["tick"]] = number
    return row


class Session:
    """Rings and a recorder of them."""

    def __init__(self, folder, capacity=4096):
        self.folder = folder
        self.frames = Ring.create(capacity, 4 * LAYOUT.size)
        self.events = Ring.create(256, EVENT_BYTES)
        given = self.frames.name, self.events.name, LAYOUT.names(), folder, HEADER, dict
        context = multiprocessing.get_context("spawn")
        self.process = context.Process(target=recorder.record_session, args=given, daemon=True)

    def write(self, count):
        for _ in range(count):
            self.frames.put(row_of(self.frames.written).view(np.uint8))

    def start(self):
        self.process.start()
        self.wait(lambda: (self.folder / session_log.FILE).exists())

    def wait(self, condition):
        waiting.until(lambda: condition() or self.process.exitcode not in (None, 0))
        assert condition(), "the recorder did not do it"

    def close(self):
        if self.process.is_alive():
            self.process.kill()
        if self.process.pid:
            self.process.join(waiting.DEADLINE_S)
        self.frames.close()
        self.events.close()


@pytest.fixture
def session(tmp_path):
    opened = Session(tmp_path / "session")
    yield opened
    opened.close()


def test_a_session_is_recorded_to_the_last_row(session):
    session.start()
    told = description.read_session(session.folder)
    assert told["ended"] is None and told["seed"] == 7
    for i in range(10):
        session.write(50)
        put_json(session.events, {"tick": session.frames.written, "kind": "target", "target": i})
        time.sleep(0.01)
    put_json(session.events, {"tick": 500, "kind": "end", "reason": "time"})
    session.process.join(waiting.DEADLINE_S)
    assert session.process.exitcode == 0
    found = reader.read_recording(session.folder)
    assert found.complete and found.lost_bytes == 0 and found.header["name"] == "synthetic"
    np.testing.assert_array_equal(found.numbers, np.arange(500))
    np.testing.assert_array_equal(found.rows, np.stack([row_of(i) for i in range(500)]))
    np.testing.assert_array_equal(
        found["gold/tip"][:, 1], found.rows[:, LAYOUT.places["gold/tip"].start + 1]
    )
    assert [one.get("target") for one in found.events] == [*range(10), None]
    told = description.read_session(session.folder)
    assert told["ended"] > told["started"]
    assert told["summary"]["recording"] == {
        "rows": 500,
        "seconds": 0.5,
        "lost_rows": 0,
        "events": 11,
        "late_ticks": int(row_of(499)[LAYOUT.places["late_ticks"].start]),
    }


def test_rows_that_came_too_fast_are_told_and_leave_a_gap(tmp_path):
    session = Session(tmp_path / "session", capacity=64)
    try:
        session.write(1000)
        session.start()
        session.write(10)
        session.process.terminate()
        session.process.join(waiting.DEADLINE_S)
        found = reader.read_recording(session.folder)
        first = int(found.numbers[0])
        assert first >= 1000 - 64 and found.numbers[-1] == 1009
        np.testing.assert_array_equal(found.rows[0], row_of(first))
        lost = sum(one["rows"] for one in found.events if one["kind"] == "lost_rows")
        assert lost + len(found.rows) == 1010
        assert description.read_session(session.folder)["summary"]["recording"]["lost_rows"] == lost
    finally:
        session.close()


def holds_a_message(log):
    try:
        return next(mcap_records.scan_records(log).messages(), None) is not None
    except StoreError:
        return False  # its first bytes are on their way


def waited_s(process):
    """How long a process has stood ready without a processor, s; 0 where the system does not
    tell.
    """
    try:
        return int(Path(f"/proc/{process.pid}/schedstat").read_text().split()[1]) * 1e-9
    except OSError:
        return 0.0


class Metronome(threading.Thread):
    """Writes a row a millisecond, and notes how late the machine ever let it."""

    def __init__(self, session):
        super().__init__(daemon=True)
        self.session, self.stop, self.stall = session, threading.Event(), 0.0

    def run(self):
        start = last = time.monotonic()
        while not self.stop.is_set():
            now = time.monotonic()
            self.stall, last = max(self.stall, now - last), now
            self.session.write(int((now - start) * 1000) - self.session.frames.written)
            time.sleep(0.0005)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 3))]
)
def test_a_kill_at_any_moment_loses_at_most_50_ms(tmp_path, seed):
    random = np.random.default_rng(seed)
    for attempt in range(4):
        session = Session(tmp_path / f"session{attempt}")
        try:
            session.start()
            log = session.folder / session_log.FILE
            session.write(1)
            session.wait(lambda log=log: holds_a_message(log))  # the recorder has begun
            metronome = Metronome(session)
            waited = waited_s(session.process)
            metronome.start()
            moment = 300 + 500 * random.random()  # ms, as the rows count them
            waiting.until(
                lambda at=moment, frames=session.frames: frames.written > at, every_s=0.001
            )
            waited = waited_s(session.process) - waited
            os.kill(session.process.pid, signal.SIGKILL)
            there = session.frames.written
            metronome.stop.set()
            metronome.join()
            session.process.join(waiting.DEADLINE_S)
            assert session.process.exitcode == -signal.SIGKILL
            told = mcap_records.recover_records(log)
            found = reader.read_recording(session.folder)
            assert found.complete and not session_log.read_session_log(log).complete
            np.testing.assert_array_equal(found.numbers, np.arange(len(found.rows)))
            np.testing.assert_array_equal(
                found.rows, np.stack([row_of(i) for i in range(len(found.rows))])
            )
            assert told.seconds == pytest.approx((len(found.rows) - 1) * 1e-3, abs=1e-9)
            with open(told.path, "rb") as file:
                seeking = make_reader(file)
                counts = seeking.get_summary().statistics.channel_message_counts
                topics = {
                    one.topic: counts.get(number, 0)
                    for number, one in seeking.get_summary().channels.items()
                }
                metadata = {one.name: one.metadata for one in seeking.iter_metadata()}
            assert topics["/ravenjax/signals"] == len(found.rows)
            assert topics["/arm1/measured_js"] == -(-len(found.rows) // 10)
            assert json.loads(metadata["ravenjax"]["header"])["seed"] == 7
            assert description.read_session(session.folder)["ended"] is None
        finally:
            session.close()
        if (
            metronome.stall < 0.015 and waited < 0.015
        ):  # else the machine had no time for either: not the recorder's loss
            assert there - len(found.rows) <= 50
            return
    pytest.skip(
        "this machine is too busy to keep a millisecond's time: nothing can be said of 50 ms on it"
    )
