"""Handles Ctrl-C, SIGTERM and SIGHUP safely in a program with threads.

Python raises the exception of a signal in the main thread, at any instruction. If the main thread
has just taken a lock that another thread needs, such as that of a `Future`, nobody releases the
lock and the program hangs. If a compiled module is being imported, the import fails. About one
signal in 100 to 200 caused one of these errors in a campaign.

Therefore a signal is delayed. Its exception is raised when the main thread waits for other threads
or begins a new step. Code that does not return for a long time, such as a compiler that runs for
minutes, ends with the process.
"""

import concurrent.futures
import contextlib
import os
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EVERY_S = 0.05
"""Period with which a waiting main thread checks for a signal, s."""
GRACE_S = 10.0
"""Time between a signal and the end of the process, if the main thread does not end before, s."""

T = TypeVar("T")

_held: list[Callable[[], object]] = []
"""Handlers to call for the signals that have arrived. Only the main thread uses this list."""


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Delay signals until `check_interruption`, `wait_for_result` or the end of the block.

    Only signals with a Python handler are delayed. Outside the main thread this does nothing,
    because Python handles signals only in the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))
    }

    def hold(number: int, _: object):
        _held.append(lambda: before[signal.Signals(number)](number, None))

    try:
        with _handled_by(hold, before):
            yield
    finally:
        check_interruption()


def check_interruption() -> None:
    """Handle delayed signals, which may raise an exception.

    Call this only while the main thread owns no lock that another thread needs.
    """
    while _held and threading.current_thread() is threading.main_thread():
        _held.pop(0)()


def wait_for_result(future: Future[T]) -> T:
    """Return `future.result()`, and handle delayed signals while waiting."""
    while not future.done():
        check_interruption()
        concurrent.futures.wait((future,), EVERY_S)
    return future.result()


@contextlib.contextmanager
def exit_on_signals(*numbers: signal.Signals) -> Iterator[None]:
    """Raise SystemExit with code 128 + the number of a signal when one of these signals arrives.

    Ignored signals (as under nohup) stay ignored. Outside the main thread this does nothing.
    """

    def leave(number: int, _: object):
        raise SystemExit(128 + number)

    # Python allows signal handlers to be set only in the main thread.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with _handled_by(
        leave, [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    ):
        yield


@contextlib.contextmanager
def until_interrupted() -> Iterator[list[int]]:
    """Yield a list to which each Ctrl-C or SIGTERM is appended.

    A loop can check the list between two ticks, and close its files. The third signal raises
    KeyboardInterrupt. Use this only in the main thread.
    """
    signals = []

    def note(number: int, _: object):
        signals.append(number)
        if len(signals) > 2:
            raise KeyboardInterrupt

    with _handled_by(note, (signal.SIGINT, signal.SIGTERM)):
        yield signals


@contextlib.contextmanager
def _handled_by(
    handler: Callable[[int, object], None], numbers: Iterable[signal.Signals]
) -> Iterator[None]:
    """Install another handler for these signals until the end of the block."""
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in before:
            signal.signal(number, handler)
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextlib.contextmanager
def ended_in_time(message: str, grace_s: float = GRACE_S) -> Iterator[None]:
    """End the process if the main thread is still in this block `grace_s` seconds after a signal.

    The process then prints `message` and exits with code 128 + the number of the signal. Files that
    the block writes must not be damaged by this.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours, others = socket.socketpair()
    others.setblocking(False)
    # The C signal handler writes to this socket even if no Python code runs.
    before = signal.set_wakeup_fd(others.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(ours, message, grace_s), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        # The watching thread sees that the socket is closed.
        others.close()


def _watch(ours: socket.socket, message: str, grace_s: float):
    # Runs in a thread: ends the process if the main thread does not react to a signal in time.
    with ours:
        while received := ours.recv(1):
            if received[0] in SIGNALS and not _closed_within(ours, grace_s):
                # `print` could block, because the main thread may hold its lock.
                os.write(2, f"{message}\n".encode())
                os._exit(128 + received[0])


def _closed_within(ours: socket.socket, within_s: float) -> bool:
    """Return whether the other end of the socket is closed within `within_s` seconds."""
    end = time.monotonic() + within_s
    while (rest := end - time.monotonic()) > 0.0:
        if select.select([ours], [], [], rest)[0] and not ours.recv(1):
            return True
    return False
