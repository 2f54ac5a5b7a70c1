"""Starts the page and the recorder of a session as processes, and reports when they end."""

import contextlib
import multiprocessing
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train import page, recording

STARTING_S = 60.0  # The longest time that the page or the recorder may take to start or to answer


class Helper:
    """A process that imports its modules before its options are known."""

    def __init__(self, stack: contextlib.ExitStack, target: Callable[..., None], *given: Any):
        """target: called in the process with a connection and `given`. The connection delivers the
        options and takes the answer. stack: ends the process.
        """
        self.connection, process_end = multiprocessing.Pipe()
        stack.callback(self.connection.close)
        self.process = spawn_process(stack, target, process_end, *given)
        # Only the process holds its end, so that `recv` fails when the process has ended.
        process_end.close()

    def send(self, options: Any) -> None:
        """Send the process its options. Raises UserError if the process has ended."""
        try:
            self.connection.send(options)
        except OSError:
            raise self._end_error() from None

    def receive_answer(self) -> Any:
        """Return the process's answer to its options. Raises UserError if it takes longer than
        STARTING_S, or if the process has ended.
        """
        if not self.connection.poll(STARTING_S):
            raise UserError(f"a process of the session did not start within {STARTING_S:g} s")
        try:
            return self.connection.recv()
        except (EOFError, ConnectionResetError):
            raise self._end_error() from None

    def _end_error(self) -> UserError:
        self.process.join(STARTING_S)
        return UserError(
            f"a process of the session ended with code {self.process.exitcode}; its message is"
            " above"
        )


@contextlib.contextmanager
def leave_realtime_cpu() -> Iterator[None]:
    """Start processes on all CPUs but that of the realtime loop, if there are several."""
    cpus = os.sched_getaffinity(0)
    # A process inherits the CPUs of the thread that starts it.
    os.sched_setaffinity(0, cpus - {max(cpus)} or cpus)
    try:
        yield
    finally:
        os.sched_setaffinity(0, cpus)


class SessionHelpers:
    """The page and the recorder. They start before the session imports its modules."""

    @leave_realtime_cpu()
    def __init__(self, stack: contextlib.ExitStack, listening: socket.socket | None):
        """stack: ends the processes. listening: socket of `page.open_port`; None: no page."""
        self.page, self.port = None, 0
        if listening is not None:
            # The socket closes in this process. The page's process has a copy.
            with listening:
                self.port = listening.getsockname()[1]
                self.page = Helper(stack, page.run_when_told, listening)
        self.recorder = Helper(stack, recording.run_when_told)

    def show_progress(self, step: str, say: Callable[[str], None]) -> None:
        """Show in the terminal and on the page which step of the start is under way."""
        say(step)
        if self.page is not None:
            self.page.send(step)


def spawn_process(
    stack: contextlib.ExitStack, target: Callable[..., None], *given: Any
) -> BaseProcess:
    """Start a process that ignores Ctrl-C, and that `stack` ends. It calls `target(*given)`. The
    process is spawned, because JAX does not survive a fork.
    """
    # As python -P: the process does not import a file such as tempfile.py in the current folder.
    os.environ["PYTHONSAFEPATH"] = "1"
    process = multiprocessing.get_context("spawn").Process(target=target, args=given, daemon=True)
    # With `__file__`, the process would also import the file of the running command.
    command = vars(sys.modules["__main__"])
    file = command.pop("__file__", None)
    # SIGINT is blocked while the process starts, so that the child never has it unblocked. The
    # resource tracker unblocks signals when it starts, so it must run beforehand.
    resource_tracker.ensure_running()
    earlier_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier_mask)
        if file:
            command["__file__"] = file

    def end():
        process.terminate()
        process.join(5.0)
        if process.is_alive():
            process.kill()

    stack.callback(end)
    return process


def recorder_error(recording: BaseProcess) -> str | None:
    """Return a message if the recorder has ended before the session; None while it runs."""
    if recording.is_alive() or recording.exitcode == 0:
        return None
    return f"the recorder ended with code {recording.exitcode}: the session continues unrecorded"
