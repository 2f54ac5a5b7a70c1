"""Chunks that are to be computed elsewhere: handed out, taken back from workers that died, given up
in the end.

A chunk that was in the hands of a worker that died is under suspicion: from then on it is computed
alone, so that the next death can be laid at its door and at no other's.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ravenjax.campaign.progress.counts import Progress
from ravenjax.errors import UserError, listed

ATTEMPTS = 3
"""How often a chunk is tried before it is given up."""


class Handed(NamedTuple):
    """A chunk in a worker's hands."""

    rows: range
    alone: bool  # the worker should take nothing else beside it


class Attempts:
    """What is to be computed and how it goes; several threads may share it."""

    def __init__(self, chunks: Sequence[range], progress: Progress, workers: int) -> None:
        self._fresh, self._suspect = deque(chunks), deque[range]()
        self._out, self._delivered, self._workers = 0, 0, workers
        self._tries: dict[range, int] = {}
        self._lost: dict[range, str] = {}
        self._error: BaseException | None = None
        self._progress, self._change = progress, threading.Condition()

    def take(self, idle: bool) -> Handed | None:
        """The next chunk. None: nothing for now, and where the worker is idle, nothing ever
        again.
        """
        with self._change:
            while self._error is None:
                if self._fresh and (
                    idle or len(self._fresh) >= self._workers
                ):  # towards the end nobody hoards
                    self._out += 1
                    return Handed(self._fresh.popleft(), False)
                if idle and self._suspect:
                    self._out += 1
                    return Handed(self._suspect.popleft(), True)
                if not idle or not self._out:
                    return None
                self._change.wait()
            return None

    def delivered(self) -> None:
        """A chunk that was handed out is where it belongs."""
        with self._change:
            self._out -= 1
            self._delivered += 1
            self._change.notify_all()

    def failed(self, rows: range, why: str) -> None:
        """A chunk that was handed out did not come back: it is tried again, or given up and
        named.
        """
        with self._change:
            self._out -= 1
            self._tries[rows] = self._tries.get(rows, 0) + 1
            if self._tries[rows] < ATTEMPTS:
                self._suspect.append(rows)
                self._progress.note(f"rows {_named(rows)}: {why}; tried again")
            else:
                self._lost[rows] = why
                self._progress.lost({why: len(rows)})
                self._progress.note(
                    f"rows {_named(rows)}: {why}; given up after {ATTEMPTS} attempts"
                )
                if (
                    not self._delivered and self._error is None
                ):  # it is not the chunk, nothing works
                    self._error = self._refusal()
            self._change.notify_all()

    def stop(self, error: BaseException) -> None:
        """Nothing more is handed out; `conclude` raises `error`, the first of several."""
        with self._change:
            self._error = self._error or error
            self._change.notify_all()

    @property
    def stopped(self) -> bool:
        """Whether nothing more is handed out."""
        return self._error is not None

    def conclude(self) -> None:
        """Raise what ended the work early, or UserError for chunks that were given up."""
        if self._error is not None:
            raise self._error
        if self._lost:
            raise self._refusal()

    def _refusal(self) -> UserError:
        lost = listed(
            [f"rows {_named(rows)}: {why}" for rows, why in sorted(self._lost.items(), key=_first)]
        )
        rest = (
            "every other chunk is finished and kept"
            if self._delivered
            else "no chunk was finished by any worker"
        )
        return UserError(
            f"{len(self._lost)} chunk(s) failed {ATTEMPTS} times each; {rest}:\n{lost}\nStart the"
            " same command again to try these alone; with --executor local the error itself comes"
            " to light."
        )


def _named(rows: range) -> str:
    return f"{rows.start} to {rows.stop - 1}"


def _first(item: tuple[range, str]) -> int:
    return item[0].start
