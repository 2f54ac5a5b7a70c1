"""What an executor is: chunks of a plan in, each chunk's finished part out, in whatever order.

A chunk is a range of rows. Wherever it is computed, its rows are the same, and so are the bytes of
its part. Only the coordinator, the process that the user started, ever touches the result folder:
others hand it the bytes of finished parts, which it writes aside, flushes, renames and records. So
no worker needs to see the folder, one that dies or comes back from the dead cannot spoil it, and
whatever a disk refuses is met in one place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress.counts import Progress
from ravenjax.engines.interface import Engine

T = TypeVar("T")

Pack = Callable[[Mapping[str, Any]], T]
"""Makes what is kept of a chunk from the columns of its rows. It travels to where the chunk is
computed.
"""


@dataclass(frozen=True, eq=False)
class FinishedChunk(Generic[T]):
    """A chunk whose rows are all computed."""

    rows: range
    packed: T  # what `Work.pack` made of its columns
    failures: dict[str, int]  # runs without a valid outcome, by cause


@dataclass(frozen=True, eq=False)
class Work(Generic[T]):
    """What there is to compute, and where to put it."""

    ready: Plan
    engine: Engine
    pack: Pack[T]
    deliver: Callable[
        [FinishedChunk[T]], None
    ]  # may be called from several threads at once; what it raises ends the work
    progress: Progress


class Executor(Protocol):
    """Computes chunks."""

    @property
    def name(self) -> str:
        """As `--executor` takes it."""
        ...

    @property
    def workers(self) -> int | None:
        """Processes or tasks side by side, as asked for; None: as many as there is room for."""
        ...

    def run(self, work: Work[Any], chunks: Sequence[range]) -> None:
        """Compute and deliver every chunk, each exactly once.

        A chunk that fails time and again does not hold up the others: UserError names it and why
        once they are delivered. What ends the work early (a signal, an error of `deliver`) leaves
        what is delivered as it is.
        """
        ...
