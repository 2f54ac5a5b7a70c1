"""Chunks in other hands: handed out once, taken back, tried alone, given up and named; nobody
waits for nothing.
"""

from __future__ import annotations

import random
import threading

import pytest

from ravenjax.campaign.executors.carriers.attempts import ATTEMPTS, Attempts
from ravenjax.campaign.progress.counts import Progress
from ravenjax.errors import UserError

CHUNKS = [range(10 * k, 10 * k + 10) for k in range(8)]


def fresh(workers=2, chunks=CHUNKS):
    return Attempts(chunks, Progress("", 80, 80, 1, None), workers)


def test_each_chunk_is_handed_out_once_and_towards_the_end_nobody_hoards():
    attempts, taken = fresh(), []
    while (one := attempts.take(idle=False)) is not None:
        taken.append(one.rows)
    assert taken == CHUNKS[:-1], "the last is left for whoever is idle"
    one = attempts.take(idle=True)
    assert one is not None and one.rows == CHUNKS[-1] and not one.alone


def test_a_chunk_that_failed_is_tried_alone_after_the_others():
    attempts = fresh(workers=1)
    first = attempts.take(idle=True)
    attempts.failed(first.rows, "worker killed by SIGKILL")
    others = []
    while (one := attempts.take(idle=True)) is not None and not one.alone:
        others.append(one.rows)
        attempts.delivered()
    assert others == CHUNKS[1:] and one.rows == CHUNKS[0]
    attempts.delivered()
    assert attempts.take(idle=True) is None
    attempts.conclude()


def test_a_chunk_that_always_fails_is_given_up_by_name_and_the_others_are_not():
    told = []
    progress = Progress("", 80, 80, 1, told.append)
    attempts, delivered = Attempts(CHUNKS, progress, 1), []
    while (one := attempts.take(idle=True)) is not None:
        if one.rows.start == 30:
            attempts.failed(one.rows, "worker killed by SIGSEGV")
        else:
            delivered.append(one.rows)
            attempts.delivered()
    assert delivered == [rows for rows in CHUNKS if rows.start != 30]
    with pytest.raises(
        UserError,
        match=rf"(?s)1 chunk\(s\) failed {ATTEMPTS} times.*rows 30 to 39: worker .* SIGSEGV",
    ):
        attempts.conclude()
    progress.tell("stopped")
    assert told[-1].failures == {"worker killed by SIGSEGV": 10}
    assert len(told[-1].notes) == ATTEMPTS and "given up" in told[-1].notes[-1]


def test_where_no_worker_ever_finishes_anything_not_every_chunk_is_tried():
    attempts, tries = fresh(workers=1), 0
    while (one := attempts.take(idle=True)) is not None:
        tries += 1
        attempts.failed(one.rows, "worker ended with code 1")
    assert tries < ATTEMPTS * len(CHUNKS)
    with pytest.raises(UserError, match="no chunk was finished by any worker"):
        attempts.conclude()


def test_an_idle_worker_waits_for_what_another_may_give_back():
    attempts = fresh(workers=1, chunks=CHUNKS[:1])
    one = attempts.take(idle=True)
    got = []
    waiting = threading.Thread(target=lambda: got.append(attempts.take(idle=True)))
    waiting.start()
    attempts.failed(one.rows, "worker killed by SIGKILL")
    waiting.join(10.0)
    assert got[0].rows == CHUNKS[0] and got[0].alone


def test_stopping_wakes_who_waits_and_the_first_reason_counts():
    attempts = fresh(workers=1, chunks=CHUNKS[:1])
    attempts.take(idle=True)
    got = []
    waiting = threading.Thread(target=lambda: got.append(attempts.take(idle=True)))
    waiting.start()
    attempts.stop(OSError("full"))
    attempts.stop(OSError("later"))
    waiting.join(10.0)
    assert got == [None] and attempts.stopped
    with pytest.raises(OSError, match="full"):
        attempts.conclude()


@pytest.mark.parametrize("seed", range(20))
def test_many_workers_that_die_at_random_deliver_everything_once(seed):
    chance, delivered, lock = random.Random(seed), [], threading.Lock()
    attempts = fresh(workers=3)
    deaths = dict.fromkeys(CHUNKS, 0)

    def worker():
        held = []
        while True:
            while len(held) < 2 and not any(one.alone for one in held):
                one = attempts.take(idle=not held)
                if one is None:
                    break
                held.append(one)
            if not held:
                return
            with lock:
                dies = chance.random() < 0.3 and all(
                    deaths[one.rows] < ATTEMPTS - 1 for one in held
                )
                if dies:
                    for one in held:
                        deaths[one.rows] += 1
            if dies:
                for one in held:
                    attempts.failed(one.rows, "died")
                held.clear()
            else:
                with lock:
                    delivered.append(held.pop(0).rows)
                attempts.delivered()

    threads = [threading.Thread(target=worker) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20.0)
    attempts.conclude()
    assert sorted(delivered, key=lambda rows: rows.start) == CHUNKS
