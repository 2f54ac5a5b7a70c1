"""The clock: ticks are a period apart by the monotonic clock, however long they take; what is
late is counted.
"""

import itertools
import subprocess
import sys

import pytest

from ravenjax.train.realtime import clock
from ravenjax.train.realtime.clock import PERIOD_NS, Clock


@pytest.fixture
def fake(monkeypatch):
    """A clock that passes while someone sleeps or `spend`s, and a little with each look at it."""

    class Fake:
        now = 5_000_000_000

        def monotonic_ns(self):
            self.now += 20
            return self.now

        def sleep(self, seconds):
            self.now += round(seconds * 1e9)

        def spend(self, us):
            self.now += us * 1000

    fake = Fake()
    monkeypatch.setattr(clock, "time", fake)
    return fake


def test_ticks_begin_a_period_apart_whatever_they_cost(fake):
    paced, begun = Clock(), []
    for cost in (10, 900, 0, 999, 50):
        paced.wait()
        begun.append(fake.now)
        fake.spend(cost)
        paced.done()
    assert [b - a for a, b in itertools.pairwise(begun)] == [PERIOD_NS] * 4
    assert paced.timing.late == 0 and paced.timing.ticks == 5
    assert paced.timing.percentile("compute", 0.5) == 50 and paced.compute_us == 50


def test_a_long_tick_makes_the_next_ones_late_until_it_is_made_up_for(fake):
    paced = Clock()
    paced.wait()
    fake.spend(3500)
    paced.done()
    lateness = []
    for _ in range(5):
        paced.wait()
        lateness.append(paced.lateness_us)
        paced.done()
    assert lateness == [2500, 1500, 500, 0, 0]
    assert paced.timing.late == 2 and paced.timing.skipped == 0


def test_after_a_long_sleep_the_schedule_moves_on_instead(fake):
    paced = Clock()
    paced.wait()
    fake.spend(10_000_000)  # the lid was closed
    paced.done()
    paced.wait()
    paced.done()
    assert paced.timing.skipped == 9999 and paced.timing.late == 1
    paced.wait()
    assert paced.lateness_us == 0


GIVEN_BACK = """
import contextlib, os, time
from ravenjax.train import processes
from ravenjax.train.realtime import clock

def now():
    return os.sched_getaffinity(0), os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

before = now()
with processes.leave_realtime_cpu():
    others = now()[0]
with clock.use_realtime_priority() as granted:
    print(granted)
    assert len(now()[0]) == 1 and not (others != before[0] and others & now()[0])
assert now() == before
with contextlib.ExitStack() as stack:
    with processes.leave_realtime_cpu():
        helper = processes.spawn_process(stack, time.sleep, 60)
    assert os.sched_getaffinity(helper.pid) == others and now() == before
"""


def test_what_is_asked_of_the_system_is_given_back():
    done = subprocess.run(
        [sys.executable, "-c", GIVEN_BACK], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert any(word in done.stdout for word in ("always awake", "SCHED_FIFO", "normal priority"))
