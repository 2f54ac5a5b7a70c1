"""Ctrl-C, SIGTERM and SIGHUP while threads are at work, or libraries are imported.

Python raises in the main thread wherever that happens to be. Where it has just taken a lock that
another thread needs, such as that of a `Future`, nobody gives the lock back, and the program waits
for ever; where a compiled module is being imported, that says it cannot be. One signal in a hundred
or two did either to a campaign. So a signal is held back, and raised where the main thread waits
for others or begins something new. Work that does not return for long, such as a compiler that
runs for minutes, ends with the process.
"""

from __future__ import annotations

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
"""How often who waits for a thread looks for a signal."""
GRACE_S = 10.0
"""Time that the main thread has from a signal to the end of its work; then the process ends."""

T = TypeVar("T")

_held: list[Callable[[], object]] = []
"""Calls of the handlers of signals that came. Only the main thread uses it."""


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Signals whose handlers are Python's wait for `point`, `result` or the end of
    this. In other threads than the main one it does nothing: no signal is raised there."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))
    }

    def hold(number: int, _: object) -> None:
        _held.append(lambda: before[signal.Signals(number)](number, None))

    try:
        with _handled_by(hold, before):
            yield
    finally:
        point()


def point() -> None:
    """Here a signal that was held back may raise: no lock is held that others need."""
    while _held and threading.current_thread() is threading.main_thread():
        _held.pop(0)()


def result(future: Future[T]) -> T:
    """`future.result()`; raises a signal that was held back, too."""
    while not future.done():
        point()
        concurrent.futures.wait((future,), EVERY_S)
    return future.result()


@contextlib.contextmanager
def exits(*numbers: signal.Signals) -> Iterator[None]:
    """These signals raise SystemExit with 128 + their number, unless they are ignored, as under
    nohup. In other threads than the main one it does nothing."""

    def leave(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    if (
        threading.current_thread() is not threading.main_thread()
    ):  # then signals are somebody else's
        yield
        return
    with _handled_by(
        leave, [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    ):
        yield


@contextlib.contextmanager
def until_interrupted() -> Iterator[list[int]]:
    """Ctrl-C and SIGTERM as a wish that a loop looks at, so that it ends between two ticks and
    closes what it opened: a list that each is appended to; the third raises KeyboardInterrupt. Main
    thread only."""
    signals: list[int] = []

    def note(number: int, _: object) -> None:
        signals.append(number)
        if len(signals) > 2:
            raise KeyboardInterrupt

    with _handled_by(note, (signal.SIGINT, signal.SIGTERM)):
        yield signals


@contextlib.contextmanager
def _handled_by(
    handler: Callable[[int, object], None], numbers: Iterable[signal.Signals]
) -> Iterator[None]:
    """Another handler of these signals, until the end of this."""
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
    """End the process, saying `message` and with exit code 128 + the signal's number, where a
    signal came and the main thread is still in here `grace_s` later. The work inside must leave
    nothing on disk that such an end would damage."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours, others = socket.socketpair()
    others.setblocking(False)
    before = signal.set_wakeup_fd(
        others.fileno(), warn_on_full_buffer=False
    )  # written to even if no Python runs
    threading.Thread(target=_watch, args=(ours, message, grace_s), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        others.close()  # which the watch sees


def _watch(ours: socket.socket, message: str, grace_s: float) -> None:
    with ours:
        while came := ours.recv(1):
            if came[0] in SIGNALS and not _left(ours, grace_s):
                os.write(
                    2, f"{message}\n".encode()
                )  # not by `print`, whose lock the main thread may hold
                os._exit(128 + came[0])


def _left(ours: socket.socket, within_s: float) -> bool:
    """Whether the other end is closed within so long, whatever else comes."""
    end = time.monotonic() + within_s
    while (rest := end - time.monotonic()) > 0.0:
        if select.select([ours], [], [], rest)[0] and not ours.recv(1):
            return True
    return False
