"""Handles Ctrl-C, SIGTERM and SIGHUP safely in a program with threads. Python raises the exception
of a signal in the main thread, at any instruction. If the main thread has just taken a lock that
another thread needs, such as that of a `Future`, nobody releases the lock and the program hangs. If
a compiled module is being imported, the import fails. About one signal in 100 to 200 caused one of
these errors in a campaign.

Therefore a signal is delayed. Its exception is raised when the main thread waits for other threads
or begins a new step. If neither happens within `GRACE_S`, for example because a compiler runs for
minutes, the process ends.
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
POLL_PERIOD_S = 0.05
"""Period with which a waiting main thread checks for a signal, s."""
GRACE_S = 10.0
"""Time between a signal and the end of the process, if the main thread does not end before, s."""

T = TypeVar("T")

_delayed_calls: list[Callable[[], object]] = []
"""A call of the handler for each signal that has arrived. Only the main thread uses this list."""


@contextlib.contextmanager
def delay_signals() -> Iterator[None]:
    """Within a `with` block, delay signals until a call of `check_interruption` or
    `wait_for_result`, or until the end of the block. Only signals with a Python handler are
    delayed. Outside the main thread, where Python handles no signals, this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # The handler of an ignored signal is no function.
    handlers = {
        number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))
    }

    def delay(number: int, _: object):
        _delayed_calls.append(lambda: handlers[signal.Signals(number)](number, None))

    try:
        with _install_handler(delay, handlers):
            yield
    finally:
        check_interruption()


def check_interruption() -> None:
    """Handle delayed signals, which may raise an exception. The caller must own no shared lock."""
    while _delayed_calls and threading.current_thread() is threading.main_thread():
        # The call is removed first, because it may raise an exception.
        _delayed_calls.pop(0)()


def wait_for_result(future: Future[T]) -> T:
    """Return `future.result()`, and handle delayed signals while waiting."""
    while not future.done():
        check_interruption()
        concurrent.futures.wait((future,), POLL_PERIOD_S)
    return future.result()


@contextlib.contextmanager
def exit_on_signals(*numbers: signal.Signals) -> Iterator[None]:
    """Raise SystemExit with code 128 + the number of a signal when one of these signals arrives.
    Ignored signals (as under nohup) stay ignored. Outside the main thread this does nothing.
    """

    def request_exit(number: int, _: object):
        raise SystemExit(128 + number)

    # Python allows signal handlers to be set only in the main thread.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handled = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    with _install_handler(request_exit, handled):
        yield


@contextlib.contextmanager
def until_interrupted() -> Iterator[list[int]]:
    """Yield a list to which the number of each Ctrl-C or SIGTERM is appended. A loop can check the
    list between two ticks, and close its files. The third signal raises KeyboardInterrupt. Use this
    context manager only in the main thread.
    """
    signals = []

    def append_signal(number: int, _: object):
        signals.append(number)
        if len(signals) > 2:
            raise KeyboardInterrupt

    with _install_handler(append_signal, (signal.SIGINT, signal.SIGTERM)):
        yield signals


@contextlib.contextmanager
def _install_handler(
    handler: Callable[[int, object], None], numbers: Iterable[signal.Signals]
) -> Iterator[None]:
    """Install another handler for these signals until the end of the block."""
    previous_handlers = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in previous_handlers:
            signal.signal(number, handler)
        yield
    finally:
        for number, previous_handler in previous_handlers.items():
            signal.signal(number, previous_handler)


@contextlib.contextmanager
def limit_shutdown_time(message: str, grace_s: float = GRACE_S) -> Iterator[None]:
    """End the process if the main thread is still in this block `grace_s` seconds after a signal.
    The process then prints `message` and exits with code 128 + the number of the signal. The exit
    may interrupt any instruction of the block, so the block must write its files accordingly.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    # Python's C code writes the signal's number to this socket, even while no Python code runs.
    previous_fd = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_enforce_exit, args=(receiver, message, grace_s), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(previous_fd)
        # The thread ends when the socket is closed.
        sender.close()


def _enforce_exit(receiver: socket.socket, message: str, grace_s: float):
    # Ends the process if the block of `limit_shutdown_time` runs for grace_s after a signal. The
    # receiver gets a byte with the number of each signal of the process.
    with receiver:
        while received := receiver.recv(1):
            if received[0] in SIGNALS and not _closed_within(receiver, grace_s):
                # `print` could block, because the main thread may hold its lock.
                os.write(2, f"{message}\n".encode())
                os._exit(128 + received[0])


def _closed_within(receiver: socket.socket, limit_s: float) -> bool:
    """Return whether the other end of the socket is closed within `limit_s` seconds."""
    end_s = time.monotonic() + limit_s
    while (remaining_s := end_s - time.monotonic()) > 0.0:
        # A socket whose other end is closed is readable and contains no byte.
        if select.select([receiver], [], [], remaining_s)[0] and not receiver.recv(1):
            return True
    return False
