"""Executor `processes`: worker processes of this machine, each on cores or a GPU of its own.

They are started anew, never forked: what was imported or begun here (JAX, CUDA, threads) is none of
theirs, nor is the user's script run again. One thread here serves each: it hands out two chunks at
a time, so that the worker computes one while the other is packed and sent, and takes them back when
the worker dies, or gives no sign of life: one that was stopped is as good as dead, and is killed
and replaced.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ravenjax import interruption
from ravenjax.campaign.executors import remote
from ravenjax.campaign.executors.carriers import placement
from ravenjax.campaign.executors.carriers.attempts import Attempts, Handed
from ravenjax.campaign.executors.carriers.placement import Seat
from ravenjax.campaign.executors.protocol import Work
from ravenjax.errors import UserError

HELD = 2
"""Chunks in the hands of a worker."""
PATIENCE = 6
"""Waits without a sign of life after which a worker counts as dead."""
WAIT_S = 5.0
"""Of one wait. They are counted, so that a machine that slept, coordinator and all, has missed
but one of them.
"""
_HOME = Path(__file__).resolve().parents[4]
"""Folder of the package: workers import this one, wherever they are started."""


class Processes:
    """See `protocol.Executor`."""

    name = "processes"

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers

    def run(self, work: Work[Any], chunks: Sequence[range]) -> None:
        """See `protocol.Executor`."""
        gpus = placement.visible_gpus(_gpus()) if work.engine.name == "cuda" else []
        seats = placement.seats(self.workers, gpus)[: len(chunks)]
        attempts = Attempts(chunks, work.progress, len(seats))
        work.progress.tell("compile")
        work.progress.workers = len(seats)
        head = remote.head(work, chunks)
        servants = [_Servant(seat, head, work, attempts) for seat in seats]
        with interruption.held_back(), ThreadPoolExecutor(len(servants)) as pool:
            try:
                for _ in interruption.completed(
                    [pool.submit(servant.serve) for servant in servants]
                ):
                    if attempts.stopped:
                        break
            except (
                BaseException
            ) as error:  # a signal, for one: what is finished is delivered, then all is over
                attempts.stop(error)
                raise
            finally:
                for servant in servants:
                    servant.end()
        attempts.conclude()


class _Servant:
    """The thread that serves one worker, and the worker."""

    def __init__(self, seat: Seat, head: remote.Head, work: Work[Any], attempts: Attempts) -> None:
        self._seat, self._head, self._work, self._attempts = seat, head, work, attempts
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._silent = False

    def serve(self) -> None:
        """Until there is nothing left to do."""
        chunks: list[Handed] = []
        try:
            while self._fill(chunks):
                message = self._receive()
                if message is None:
                    self._bury(chunks)
                else:
                    self._handle(chunks, *message)
        except BaseException as error:
            self._attempts.stop(error)
        finally:
            self.end()

    def end(self) -> None:
        """End the worker at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _fill(self, chunks: list[Handed]) -> bool:
        """Hand out what the worker should hold; whether it holds anything."""
        while len(chunks) < HELD and not any(one.alone for one in chunks):
            chunk = self._attempts.take(idle=not chunks)
            if chunk is None:
                break
            chunks.append(chunk)
            self._send(chunk)
        return bool(chunks) and not self._attempts.stopped

    def _send(self, taken: Handed) -> None:
        try:
            if self._connection is None:
                self._start()
                assert self._connection is not None
                self._connection.send(self._head)
            self._connection.send(remote.share(self._work.ready, taken.rows))
        except BlockingIOError:  # it takes nothing; a message that was sent by halves is the last
            self._silent = True
        except OSError:
            pass  # it died: receiving will tell

    def _receive(self) -> tuple[Any, ...] | None:
        """The next message; None where the worker died or gives no sign of life."""
        assert self._connection is not None
        try:
            for _ in range(0 if self._silent else PATIENCE):
                if self._connection.poll(WAIT_S):
                    return self._connection.recv()
        except BlockingIOError:  # in the middle of a message
            pass
        except (EOFError, OSError):
            return None
        self._silent = True
        return None

    def _handle(self, held: list[Handed], kind: str, *rest: Any) -> None:
        progress = self._work.progress
        if kind == "ticks":
            done, due = rest
            progress.more_due(due)
            progress.ticks(done)
        elif kind == "compiled":
            progress.began(*rest)
        elif kind == "finished":
            (finished,) = rest
            self._work.deliver(finished)
            self._release(held, finished.rows)
            self._attempts.delivered()
        elif kind == "failed":
            rows, why = rest
            self._release(held, rows)
            self._attempts.failed(rows, why)
        elif kind == "refused":
            raise UserError(*rest)

    def _release(self, held: list[Handed], rows: range) -> None:
        held[:] = [one for one in held if one.rows != rows]

    def _bury(self, held: list[Handed]) -> None:
        """Take back what a dead worker held, or a silent one, which is killed."""
        assert self._process is not None and self._connection is not None
        self._connection.close()
        silent = self._silent and self._process.poll() is None
        self._process.kill()
        code = self._process.wait()
        why = f"worker gave no sign of life for {PATIENCE * WAIT_S:g} s" if silent else _cause(code)
        self._process = self._connection = None
        self._silent = False
        if not self._attempts.stopped:
            for one in held:
                self._attempts.failed(one.rows, why)
        held.clear()

    def _start(self) -> None:
        mine, its = socket.socketpair()
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):  # of a message that was begun
            mine.setsockopt(
                socket.SOL_SOCKET, option, struct.pack("ll", round(PATIENCE * WAIT_S), 0)
            )
        paths = [str(_HOME), *filter(None, [os.environ.get("PYTHONPATH")])]
        with its:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "ravenjax.campaign.executors.carriers.worker",
                    str(its.fileno()),
                    _list(self._seat.cpus),
                ],
                env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | self._seat.environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                pass_fds=[its.fileno()],
            )
        self._connection = Connection(mine.detach())


def _list(cpus: Sequence[int]) -> str:
    return ",".join(map(str, cpus))


def _cause(code: int) -> str:
    """Why a worker died, from its exit code."""
    if code >= 0:
        return f"worker ended with code {code}"
    name = signal.Signals(-code).name if -code in signal.valid_signals() else str(-code)
    return f"worker killed by {name}" + (" (too little memory?)" if -code == signal.SIGKILL else "")


def _gpus() -> int:
    from ravenjax.engines.gpu import device as cuda_device

    return len(cuda_device.devices())
