"""How many ticks could be left out if runs also ended where nothing can change any more? Prints a
Markdown table.

    python analysis/engines/settled.py quick hazard_library dsn16_b [--set campaign.observe_ms=1000]

Each campaign is run by engine simd. Beside each group of lanes the same lanes run once more without
their faults; both states are compared bit by bit after every tick. From some tick on no fault of a
run acts, and it is

merged   all that moves the robot is as in its golden run: numbers from which the plant's state is
ever computed at rest  the PLC has latched an E-stop, and the plant repeats its state stopped  the
PLC has latched an E-stop, whatever the plant does: the most that `at rest` could give
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any, ClassVar
from unittest import mock

import jax
import numpy as np

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import traced
from ravenjax.engines.cpu import engine, jit
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.cpu.group import LaneGroup
from ravenjax.engines.gpu.kernel import Form
from ravenjax.faults.fault import FaultSlot
from ravenjax.ir.time_loop import TimeLoop, split
from ravenjax.numbers import lazy

STAGES = "merged", "at rest", "stopped"
SLOT = [field.name for field in dataclasses.fields(FaultSlot)]


def moving(loop: TimeLoop, names: list[str]) -> set[int]:
    """The numbers of the state on which the plant ever depends; those of faults aside."""
    step, first = loop.step, loop.lane_inputs
    number = {i: op.detail - first for i, op in enumerate(step.operations) if op.name == "input"}
    found, new = set[int](), {k for k, name in enumerate(names) if name.startswith(".plant")}
    while new - found:
        found |= new
        read = {number.get(i, -1) for i in step.needed(step.outputs[k] for k in found)}
        new = {k for k in read if 0 <= k < loop.states}
    return {k for k in found if not names[k].startswith(".faults")}


class Watched(VectorCode):
    """Code that also finds out when its lanes settle."""

    names: ClassVar[list[str]] = []  # of the numbers of the state
    seen: ClassVar[
        list[np.ndarray]
    ] = []  # [6, lanes], of lanes: begin, end, whether there are faults, `STAGES`

    def __init__(self, loop: TimeLoop, shared: int, grouped: bool, *others: Any) -> None:
        super().__init__(loop, shared, grouped, *others)
        ticks = range(len(loop.step.inputs) - loop.lane_inputs - loop.states)
        parts = split(loop, range(shared) if grouped else (), ticks if grouped else ticks[:1])
        kept, moves = [*parts.lane_state, *parts.held_state], moving(loop, self.names)
        self.kept = [self.names[k] for k in kept]
        self.moving = [place for place, k in enumerate(kept) if k in moves]
        self.codes = range(shared + SLOT.index("code"), loop.lane_inputs, len(SLOT))

    def follow(self, lanes: Any, course: LaneCourse, progress: Any = None) -> list[np.ndarray]:
        """See `VectorCode`; golden runs, whose series goes out, are not watched."""
        if lanes.out is None:
            harmless = [
                np.zeros_like(x) if i in self.codes else x for i, x in enumerate(lanes.inputs)
            ]
            faulty = np.any([lanes.inputs[i] != 0 for i in self.codes], axis=0)
            with self._module.workspace() as space, self._module.workspace() as beside:
                both = (space, lanes), (beside, dataclasses.replace(lanes, inputs=harmless))
                groups = [LaneGroup(self.kernel, *one, len(course.begins), 1, 1) for one in both]
                self.seen.append(self._watch(groups, course, faulty.reshape(-1, self.width)))
        return super().follow(lanes, course, progress)

    def _watch(self, groups: list[LaneGroup], course: LaneCourse, faulty: np.ndarray) -> np.ndarray:
        for group in groups:
            group.go()
            if course.trunk is not None:
                together = dataclasses.replace(course, begins=np.full(len(faulty), course.first))
                self._go_on(group, together, course.trunk)
        own, golden = (
            group.state.view(np.uint32).reshape(len(faulty), len(self.kept), -1) for group in groups
        )
        plant = [k for k, name in enumerate(self.kept) if name.startswith(".plant")]
        active = [
            k
            for k, name in enumerate(self.kept)
            if name.startswith(".faults") and name.endswith(".active")
        ]
        assert active, (
            "no state of these effects tells when a fault acts: take a campaign with others beside"
            " them"
        )
        level, cause = self.kept.index(".plc.runlevel"), self.kept.index(".plc.trip_cause")
        ends, begins = (
            course.ends.reshape(faulty.shape),
            np.repeat(course.begins, self.width).reshape(faulty.shape),
        )
        merged, at_rest, stopped = (np.zeros_like(ends) for _ in range(3))
        for now in range(course.first, course.last):
            before = own[:, plant]
            for group in groups:
                group.turn(now)
                group.share(now, now + 1)
                for v in range(len(faulty)):
                    group.advance(v, now, now + 1)
                group.go()
            acts, here = own[:, active].any(axis=1), now < ends
            apart = (own != golden)[:, self.moving].any(axis=1)
            assert not (apart & ~acts & here & (merged <= now)).any(), (
                "equal without a fault, but not for good"
            )
            runs = (own[:, level] != 0) | (own[:, cause] == 0)
            changes = (own[:, plant] != before).any(axis=1)
            for tick, is_not in ((merged, apart), (at_rest, runs | changes), (stopped, runs)):
                tick[(is_not | acts) & here] = (
                    now + 2
                )  # the next tick has to run before anything is settled
        assert not merged[~faulty].any(), "a run without a fault is apart from itself"
        return np.stack([begins, ends, faulty, merged, at_rest, stopped]).reshape(6, -1)


def shares(lanes: np.ndarray, settled: np.ndarray, sizes: tuple[int, ...]) -> list[float]:
    """Of faulty runs those that settle; of their ticks those that go where so many lanes begin
    and end together.
    """
    result = [(settled < lanes[1])[lanes[2] > 0].mean()]
    for at in (np.arange(0, len(settled), size) for size in sizes):
        begins, ends = np.minimum.reduceat(lanes[0], at), np.maximum.reduceat(lanes[1], at)
        saved = np.maximum(0, ends - np.maximum(begins, np.maximum.reduceat(settled, at)))
        faulty = np.add.reduceat(lanes[2], at)
        result.append((saved @ faulty) / ((ends - begins) @ faulty))
    return result


def main() -> None:
    """Run and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaigns", nargs="+")
    parser.add_argument("--set", nargs="*", default=[])
    options, sizes = parser.parse_args(), (1, jit.host().width, Form().threads)
    print(
        "| campaign | faulty ticks | a run is | runs | each alone |",
        *(f"{n} lanes |" for n in sizes[1:]),
    )
    print("|---|---|---|---|---|---|---|")
    for name in options.campaigns:
        config = rj.load_campaign(name, options.set)
        program = traced.printable(plan.make_plan(config).program)
        with lazy.at_once():
            numbers = jax.tree_util.tree_leaves_with_path(
                program.loop.init(program.setup, program.params)
            )
        Watched.names, Watched.seen = [jax.tree_util.keystr(path) for path, _ in numbers], []
        with mock.patch.object(engine, "VectorCode", Watched):
            rj.run(config, engine="simd")
        struck = sorted(
            (some for some in Watched.seen if some[2].any()), key=lambda some: some[0].min()
        )
        lanes = np.concatenate(struck, axis=1)
        ticks = (lanes[1] - lanes[0]) @ lanes[2] / 1e6
        for what, settled in zip(STAGES, lanes[3:], strict=True):
            cells = [f"{100 * share:.2f} %" for share in shares(lanes, settled, sizes)]
            print(f"| {name} | {ticks:.1f} M | {what} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
