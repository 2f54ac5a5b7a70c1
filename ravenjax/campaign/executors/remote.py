"""A chunk outside the process that planned it: what travels there, and how its rows are computed.

A worker gets the `Head` once, all that the runs of a campaign share, and then a `Share` a chunk:
its rows of the fault table and of the arrays, some 100 B a run. It plans nothing and never holds
more than two chunks.
"""

from __future__ import annotations

import dataclasses
import socket
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.campaign import assembly, compile_cache
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors.chunk import finished
from ravenjax.campaign.executors.protocol import FinishedChunk, Pack, Work
from ravenjax.campaign.faults.fault_table import FaultTable
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress.counts import Progress
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.store import manifest


@dataclasses.dataclass(frozen=True, eq=False)
class Head:
    """What every chunk of a campaign has in common."""

    ready: Plan  # without rows
    engine: str
    device: str
    pack: Pack[Any]
    chunk: int  # rows of the largest chunk
    code_hash: str
    versions: Mapping[str, str]


class Share(NamedTuple):
    """A chunk's rows of a plan; see `Plan`."""

    rows: range
    table: FaultTable
    faults: dict[str, np.ndarray]
    varied: dict[str, np.ndarray]
    golden: np.ndarray


def head(work: Work[Any], chunks: Sequence[range]) -> Head:
    """The head of these chunks."""
    none = share(work.ready, range(0))
    return Head(
        ready=_with(work.ready, none),
        engine=work.engine.name,
        device=work.engine.device,
        pack=work.pack,
        chunk=max(map(len, chunks)),
        code_hash=manifest.code_hash(work.ready.config.robot),
        versions=manifest.package_versions(),
    )


def share(ready: Plan, rows: range) -> Share:
    """The rows of a chunk."""
    here = slice(rows.start, rows.stop)
    return Share(
        rows,
        ready.rows.take(here),
        {name: values[here] for name, values in ready.faults.items()},
        {path: values[here] for path, values in ready.varied.items()},
        ready.golden[here],
    )


class Bench:
    """Where a worker computes: compiled once, for its first chunk, then chunk after chunk."""

    def __init__(self, given: Head, progress: Progress, threads: int | None = None) -> None:
        """threads: blocks side by side, None for what the engine likes.

        Raises UserError where this process would not compute what the coordinator would.
        """
        compile_cache.enable()
        precision = given.ready.program.setup.precision
        self._head, self._progress, self._threads = given, progress, threads
        self._engine = selection.select(given.engine, precision, compile_cache.objects())
        _require_same(given, self._engine.device)
        self._computation: Computation | None = None

    def compute(self, given: Share) -> tuple[Plan, assembly.PartRows]:
        """The outcomes of a chunk, and the plan of its rows alone: what `chunk.finished` takes."""
        ready = _with(self._head.ready, given)
        if self._computation is None:
            self._computation = Computation(
                ready, self._engine, self._progress, self._head.chunk, self._threads
            )
            self._computation.compile()
        rows = [range(ready.runs)]
        return ready, next(assembly.parts(rows, self._computation.of(ready).blocks(rows)))

    def finish(self, ready: Plan, part: assembly.PartRows) -> FinishedChunk[Any]:
        """`chunk.finished`, of what `compute` returned."""
        return finished(ready, part, self._head.pack)


def _with(ready: Plan, rows: Share) -> Plan:
    return dataclasses.replace(
        ready, rows=rows.table, faults=rows.faults, varied=rows.varied, golden=rows.golden
    )


def _require_same(given: Head, device: str) -> None:
    here = {
        "code": manifest.code_hash(given.ready.config.robot)[:16],
        "device": _kinds(device),
    } | dict(manifest.package_versions())
    there = {"code": given.code_hash[:16], "device": _kinds(given.device)} | dict(given.versions)
    other = [
        f"{name}: {here.get(name)} there, {there.get(name)} at the coordinator"
        for name in sorted(here.keys() | there.keys())
        if here.get(name) != there.get(name)
        and not (name == "device" and here[name] <= there[name])
    ]
    if other:
        raise UserError(
            f"the worker on {socket.gethostname()} would not compute the same: {'; '.join(other)}. "
            "Install the same versions there, and use one kind of device for one campaign."
        )


def _kinds(device: str) -> frozenset[str]:
    """The kinds of devices of an engine's words, of which there may be several: '2 x A, B'."""
    return frozenset(word.partition(" x ")[2] or word for word in device.split(", "))
