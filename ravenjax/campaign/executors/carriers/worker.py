"""A worker process of executor `processes`: `python -m ravenjax.campaign.executors.carriers.worker
FD CPUS`.

FD is one end of a socket pair. The head comes first, then shares; back go ("compiled", s),
("ticks", done, due), ("finished", Finished), ("failed", rows, why), ("refused", why), and every
`ALIVE_S` seconds ("alive",), whatever else is under way: who says nothing at all is stopped. The
standard input holds nothing: once it ends, the coordinator is gone, and so is this process.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

EVERY_S = 0.25
"""Time between two messages about ticks."""
ALIVE_S = 2.0
"""Time between two signs of life."""


def main() -> None:
    """Serve until the coordinator hangs up."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches every process; the coordinator decides
    os.sched_setaffinity(0, map(int, sys.argv[2].split(",")))  # before any thread pool is sized
    threading.Thread(target=_leave_with_the_coordinator, daemon=True).start()
    connection = Connection(int(sys.argv[1]))
    post = _Post(connection)
    threading.Thread(target=_live, args=(post,), daemon=True).start()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        _serve(connection, post)
    os._exit(0)  # threads of engines may still run; there is nobody left to wait for


def _live(post: _Post) -> None:
    """Give signs of life until nobody is there to see them."""
    with contextlib.suppress(OSError):
        while True:
            post.send("alive")
            time.sleep(ALIVE_S)


def _serve(connection: Connection, post: _Post) -> None:
    from ravenjax.campaign.executors.remote import Bench, Head, Share
    from ravenjax.errors import UserError

    head: Head = connection.recv()
    try:
        bench = Bench(head, _relay(post))
    except UserError as error:
        post.send("refused", str(error))
        return
    shares: queue.Queue[Share] = queue.Queue()

    def listen() -> None:
        try:
            while True:
                shares.put(connection.recv())
        except (EOFError, OSError):
            os._exit(0)

    threading.Thread(target=listen, daemon=True).start()

    def finish(rows: range, *computed: Any) -> None:
        try:
            post.send("finished", bench.finish(*computed))
        except Exception as error:  # whatever it is, the coordinator must hear of it
            post.send("failed", rows, _told(error))

    with ThreadPoolExecutor(1) as behind:
        last: Future[None] | None = None
        while True:
            share = shares.get()
            try:
                computed = bench.compute(share)
            except Exception as error:
                post.send("failed", share.rows, _told(error))
                continue
            if last is not None:
                last.result()
            last = behind.submit(finish, share.rows, *computed)


def _leave_with_the_coordinator() -> None:
    os.read(0, 1)
    os._exit(1)


class _Post:
    """Messages to the coordinator, from any thread."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._lock = connection, threading.Lock()

    def send(self, *message: Any) -> None:
        with self._lock:
            self._connection.send(message)


def _relay(post: _Post) -> Any:
    """Counters that tell the coordinator."""
    from ravenjax.campaign.progress.counts import Progress

    class Relay(Progress):
        """What it counts goes to the coordinator, now and then."""

        done = due = 0
        last_report = 0.0

        def began(self, compile_s: float) -> None:
            post.send("compiled", compile_s)

        def more_due(self, ticks: int) -> None:
            with self._lock:
                self.due += ticks

        def ticks(self, ticks: int) -> None:
            with self._lock:
                self.done += ticks
                now = time.monotonic()
                if now - self.last_report < EVERY_S:
                    return
                message = "ticks", self.done, self.due
                self.done, self.due, self.last_report = 0, 0, now
            post.send(*message)

    return Relay("", 0, 0, 1, None)


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".strip().splitlines()[0][:300]


if __name__ == "__main__":
    main()
