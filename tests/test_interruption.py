"""Signals while threads are at work: no lock is left behind, and every wait ends."""

import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

from ravenjax import interruption


class Asked(BaseException):
    """What the handlers here raise."""


@pytest.fixture(autouse=True)
def handlers():
    """SIGTERM and Ctrl-C raise `Asked`, as those of a program may."""

    def ask(number, _):
        raise Asked(number)

    before = {number: signal.signal(number, ask) for number in (signal.SIGTERM, signal.SIGINT)}
    yield ask
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def raised_with_the_lock_held(monkeypatch):
    """A signal comes when the main thread has just taken a lock with a condition, the first time
    that it does.
    """
    plain, came = threading.Condition.__enter__, list[int]()

    def enter(self):
        taken = plain(self)
        if not came and threading.current_thread() is threading.main_thread():
            came.append(1)
            signal.raise_signal(signal.SIGTERM)
        return taken

    monkeypatch.setattr(threading.Condition, "__enter__", enter)


def is_free(future: Future) -> bool:
    """Whether another thread can take the lock of a future."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(
            lambda: future._condition.acquire(timeout=1.0) and not future._condition.release()
        ).result()


def test_a_signal_that_was_held_back_leaves_no_lock(raised_with_the_lock_held):
    future: Future[int] = Future()
    with pytest.raises(Asked), interruption.delay_signals():
        interruption.wait_for_result(future)
    assert is_free(future)


def test_results_and_errors_come_through():
    with interruption.delay_signals(), ThreadPoolExecutor(2) as pool:
        slow = pool.submit(lambda: time.sleep(3 * interruption.POLL_PERIOD_S) or 7)
        assert interruption.wait_for_result(slow) == 7
        broken = pool.submit(lambda: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            interruption.wait_for_result(broken)


def test_what_came_is_raised_at_the_end_and_the_handlers_are_back(handlers):
    reached = False
    with pytest.raises(Asked, match=str(signal.SIGINT.value)), interruption.delay_signals():
        signal.raise_signal(signal.SIGINT)
        reached = True
    assert reached and signal.getsignal(signal.SIGINT) is handlers is signal.getsignal(
        signal.SIGTERM
    )
    interruption.check_interruption()  # and it is raised once


def test_a_signal_leaves_with_its_number_unless_it_is_ignored(handlers):
    hangup = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruption.exit_on_signals(signal.SIGHUP, signal.SIGTERM):
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(SystemExit, match=str(128 + signal.SIGTERM)):
                signal.raise_signal(signal.SIGTERM)
    finally:
        assert (
            signal.getsignal(signal.SIGTERM) is handlers
            and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        )
        signal.signal(signal.SIGHUP, hangup)


def test_a_loop_is_wished_to_end_and_the_third_wish_is_an_order(handlers):
    with interruption.until_interrupted() as wishes:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        assert wishes == [signal.SIGINT, signal.SIGTERM]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is handlers is signal.getsignal(signal.SIGTERM)


STUBBORN = """
import signal, sys, time
from ravenjax import interruption
signal.signal(signal.SIGTERM, lambda *_: None)
with interruption.limit_shutdown_time("that was long enough", 0.5):
    print("in", flush=True)
    end = time.monotonic() + float(sys.argv[1])
    while time.monotonic() < end:
        time.sleep(0.05)
print("out", flush=True)
time.sleep(1.0)
"""


def ended(within_s: float) -> tuple[int, str, str]:
    """Exit code, output and errors of a process that heeds no signal for so long."""
    process = subprocess.Popen(
        [sys.executable, "-c", STUBBORN, str(within_s)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "in\n"
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def test_what_heeds_no_signal_is_ended():
    assert ended(600.0) == (128 + signal.SIGTERM, "", "that was long enough\n")
