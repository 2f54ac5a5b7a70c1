"""A compiled time loop: runs a group of lanes through some ticks, vector after vector of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np

from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.group import LaneGroup, at
from ravenjax.engines.cpu.kernel import FUNCTIONS, VectorKernel, print_kernel
from ravenjax.engines.cpu.target import CodeTarget
from ravenjax.engines.interface import Progress
from ravenjax.engines.lanes import Lanes, Trunk, spacing
from ravenjax.ir.time_loop import TimeLoop, split

CHUNK = 500
"""Ticks between two looks at the next vector of lanes: a group's rows for so many stay in the
second-level cache.
"""
AT_ONCE = 2**18
"""Ticks of vectors that compiled code runs in one call, about: tenths of a second, so that
progress can be told.
"""


@dataclasses.dataclass(frozen=True)
class LaneCourse:
    """From which tick to which the lanes of a group run."""

    begins: np.ndarray  # int [vectors], ticks of snapshots of `trunk`; 0: from the beginning
    ends: np.ndarray  # int [lanes], the first tick that is not run
    trunk: Trunk | None = None  # the golden run from which they go on

    @property
    def first(self) -> int:
        """The first tick that any lane runs."""
        return int(self.begins.min())

    @property
    def last(self) -> int:
        """The first tick that none runs."""
        return int(self.ends.max())

    @property
    def vector_ticks(self) -> int:
        """Ticks that all vectors run together."""
        return int((self.ends.reshape(len(self.begins), -1).max(axis=1) - self.begins).sum())


class VectorCode:
    """`loop` compiled for `width` lanes side by side.

    grouped: the first `shared` inputs of its lanes, and what enters a tick, are alike. The tick's
    own number always is.
    """

    def __init__(
        self,
        loop: TimeLoop,
        shared: int,
        grouped: bool,
        width: int,
        objects: jit.Objects | None = None,
        printed: Callable[[Callable[[], VectorKernel]], VectorKernel] = lambda make: make(),
        target: CodeTarget | None = None,
    ) -> None:
        """printed: the kernel as it was printed before, or `make()`. target: this machine's CPU
        if left out.
        """
        target = target or jit.host()
        ticks = range(len(loop.step.inputs) - loop.lane_inputs - loop.states)
        self.grouped, self.width = grouped, width

        def make() -> VectorKernel:
            parts = split(loop, range(shared) if grouped else (), ticks if grouped else ticks[:1])
            return print_kernel(parts, width, target.features)

        self.kernel = printed(make)
        self._module = target.compiled(self.kernel.text, FUNCTIONS, objects)

    @property
    def outputs(self) -> int:
        """Numbers that go out in a tick."""
        return self.kernel.outputs

    def run(self, lanes: Lanes, ticks: int, progress: Progress | None = None) -> list[np.ndarray]:
        """Run one group from the beginning; its results, each [lanes]."""
        size = len(lanes.inputs[0]) if lanes.inputs else self.width
        return self.follow(
            lanes,
            LaneCourse(np.zeros(size // self.width, np.int64), np.full(size, ticks)),
            progress,
        )

    def follow(
        self, lanes: Lanes, course: LaneCourse, progress: Progress | None = None
    ) -> list[np.ndarray]:
        """Run one group along `course`; its results, each [lanes]."""
        vectors = len(course.begins)
        marks, mark = np.unique(course.ends, return_inverse=True)
        pairs, place = np.unique(
            np.stack([np.repeat(np.arange(vectors), self.width), mark], axis=1),
            axis=0,
            return_inverse=True,
        )
        of_vector = np.searchsorted(pairs[:, 0], np.arange(1, vectors))
        stops = [
            part.tolist() for part in np.split(pairs[:, 1], of_vector)
        ]  # marks at which lanes of a vector end
        row_of = {(v, m): row for row, (v, m) in enumerate(pairs.tolist())}
        with self._module.workspace() as space:
            group = LaneGroup(self.kernel, space, lanes, vectors, CHUNK, len(pairs))
            shared = space.buffer(len(marks), self.kernel.group_state.bytes)
            ends, begins, done = marks.tolist(), course.begins.tolist(), 0
            if course.trunk is not None:
                group.go()
                self._go_on(group, course, course.trunk)
            for first in range(course.first, course.last, CHUNK):
                until = min(first + CHUNK, course.last)
                group.turn(first)
                now = first
                for m, end in enumerate(ends):
                    if first < end <= until:
                        group.share(now, end, at(shared, m))
                        now = end
                if now < until:
                    group.share(now, until)
                for v, begin in enumerate(begins):
                    now = before = max(first, begin)
                    for m in stops[v]:
                        stop = min(ends[m], until)
                        if now < stop:
                            group.advance(v, now, stop)
                            now = stop
                        if first < ends[m] <= until:
                            group.finish(v, row_of[v, m], at(shared, m))
                    done += max(0, now - before)
                if done >= AT_ONCE or until == course.last:
                    group.go()
                    if progress is not None and done:
                        progress(done * self.width)
                    done = 0
            columns = group.columns()
        if len(pairs) == vectors:
            return columns
        mine = place.reshape(-1) * self.width + np.tile(np.arange(self.width), vectors)
        return [column[mine] for column in columns]

    def trunk(self, lanes: Lanes, last: int, ends: np.ndarray) -> tuple[Trunk, list[np.ndarray]]:
        """Run a vector of lanes that are all the same golden run.

        Its snapshots before tick `last`, and its results at each of `ends` (ascending), each
        [ends].
        """
        state_words = self._state_words[0]
        shared_words = self.kernel.group_state.bytes // 4
        every = spacing(last, len(state_words) + shared_words)
        with self._module.workspace() as space:
            group = LaneGroup(self.kernel, space, lanes, 1, every, max(1, len(ends)))
            state, shared = (a.view(np.uint32)[0] for a in (group.state, group.group_state))
            snapshots = Trunk.room(every, max(1, -(-last // every)), shared_words, len(state_words))
            row_of = {end: row for row, end in enumerate(ends.tolist())}
            now = 0
            for mark in sorted({*range(0, last, every), *row_of}):
                for first in range(now, mark, every):
                    until = min(first + every, mark)
                    group.turn(first)
                    group.share(first, until)
                    group.advance(0, first, until)
                now = mark
                if mark in row_of:
                    group.finish(0, row_of[mark])
                if mark < last and mark % every == 0:
                    group.go()
                    snapshots.lane[mark // every], snapshots.group[mark // every] = (
                        state[state_words],
                        shared,
                    )
            group.go()
            return snapshots, [column[:: self.width][: len(ends)] for column in group.columns()]

    @cached_property
    def _state_words(self) -> np.ndarray:
        """[width, words]: where each lane's words of the state stand."""
        return np.stack([self.kernel.state.words(lane) for lane in range(self.width)])

    def _go_on(self, group: LaneGroup, course: LaneCourse, golden_run: Trunk) -> None:
        """Put vectors where their golden run was at `course.begins`, and what they share where
        it was at the first.
        """
        if course.first:
            group.group_state.view(np.uint32)[0] = golden_run.group[
                course.first // golden_run.every
            ]
        states = group.state.view(np.uint32)
        for v, begin in enumerate(course.begins.tolist()):
            if begin:
                states[v][self._state_words] = golden_run.lane[begin // golden_run.every]
