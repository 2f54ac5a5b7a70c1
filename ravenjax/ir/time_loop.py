"""Splits the program of a tick into parts, so that no number is computed more often than necessary.

Many robots (lanes) run the same program in every tick. Lanes with the same shared inputs form a
group. There are three parts:

    shared   numbers that change with the tick and are equal in all lanes of a group. They are
             computed once per tick and group, and the lanes read them from a row.
    held     numbers that differ between lanes and are constant in time. They are computed once per
             lane, before the loop.
    lane     all other numbers. They are computed once per tick and lane.

The numbers of the state are split by fixpoint iteration: a number is shared unless it depends on a
number that differs between lanes. A number that no output needs is removed.
"""

import dataclasses
from collections.abc import Iterable, Set

from ravenjax.ir.program import Program

LANE, TICK = 1, 2
"""Bits for what a number depends on: it differs between lanes, it changes from tick to tick."""
_FREE = ("neg", "bitcast")
"""Operations without cost. Each lane computes them, because reading a row would cost more."""


@dataclasses.dataclass(frozen=True)
class TimeLoop:
    """Programs that compute a run: `begin` the first state, `step` one tick, `finish` the results.
    Inputs of `begin` are the lane's inputs. Inputs of `step` are the lane's inputs, the state, and
    the inputs of the tick; its outputs are the new state and the outputs of the tick. Inputs of
    `finish` are the lane's inputs and the state.
    """

    begin: Program
    step: Program
    finish: Program

    @property
    def lane_inputs(self) -> int:
        """Number of inputs of a lane."""
        return len(self.begin.inputs)

    @property
    def states(self) -> int:
        """Number of numbers in the state."""
        return len(self.begin.outputs)

    @property
    def tick_inputs(self) -> range:
        """Indices of the inputs of a tick, from 0; the first is the tick's number."""
        return range(len(self.step.inputs) - self.lane_inputs - self.states)


Numbers = tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Split:
    """The operations of `loop.step` that each part of the loop computes, by their numbers."""

    loop: TimeLoop
    lane_state: Numbers  # Numbers of the state that each lane stores.
    held_state: Numbers  # Numbers of the state that never change, but differ between lanes.
    shared_state: Numbers  # Numbers of the state that a group stores once.
    shared: Numbers  # operations of the shared part
    prologue: Numbers  # operations done once per lane
    lane: Numbers  # operations done each tick in each lane
    row: Numbers  # shared operations whose results lanes read
    prologue_results: Numbers  # Operations of the prologue whose results the loop reads.


def split_lanes(loop: TimeLoop, shared: int, grouped: bool) -> Split:
    """Return the parts of `loop` for lanes with the same tick. grouped: the lanes also have equal
    inputs of the tick, and equal first `shared` lane inputs.
    """
    step, lane_inputs = loop.step, loop.lane_inputs
    live = _live_state(loop)
    reads_of = {k: i for i, k in step.reads.items()}
    constant = {k for k in live if step.outputs[k] == reads_of.get(lane_inputs + k)}
    lanes = {i: 0 if grouped and i < shared else LANE for i in range(lane_inputs)}
    begins = _dependencies(loop.begin, lanes)
    state = {k: begins[loop.begin.outputs[k]] | (0 if k in constant else TICK) for k in live}
    for i in loop.tick_inputs:
        lanes[lane_inputs + loop.states + i] = TICK | (0 if grouped or i == 0 else LANE)
    while True:
        lanes |= {lane_inputs + k: bits for k, bits in state.items()}
        depends = _dependencies(step, lanes)
        new = state | {k: state[k] | depends[step.outputs[k]] for k in live - constant}
        if new == state:
            break
        state = new
    results = [step.outputs[k] for k in sorted(live)] + list(step.outputs[loop.states :])
    needed = step.needed(results)
    lane_operations = {i for i in needed if depends[i] == LANE | TICK}
    row, reads = set(), set()
    queue = [o for i in sorted(lane_operations) for o in step.operations[i].operands]
    queue += step.outputs[loop.states :]
    queue += [step.outputs[k] for k in live if state[k] == LANE | TICK]
    while queue:
        i = queue.pop()
        name = step.operations[i].name
        if i in lane_operations or name == "constant":
            continue
        if name in _FREE:
            lane_operations.add(i)
            queue.extend(step.operations[i].operands)
        elif depends[i] & LANE and name != "input":
            reads.add(i)
        elif not depends[i] & LANE:
            row.add(i)
    shared_state = tuple(k for k in sorted(live) if not state[k] & LANE)
    return Split(
        loop,
        tuple(k for k in sorted(live) if state[k] == LANE | TICK),
        tuple(k for k in sorted(live) if state[k] == LANE),
        shared_state,
        tuple(step.needed([*row, *(step.outputs[k] for k in shared_state)])),
        tuple(step.needed(reads)),
        tuple(i for i in needed if i in lane_operations and step.operations[i].name != "input"),
        tuple(sorted(row)),
        tuple(sorted(reads)),
    )


def _dependencies(program: Program, of_input: dict[int, int]) -> list[int]:
    """Return what each operation depends on, a sum of the bits LANE and TICK. of_input: index of an
    input -> its bits; inputs that are missing have 0.
    """
    depends = []
    for operation in program.operations:
        # `detail` of an input is its index.
        bits = of_input.get(operation.detail, 0) if operation.name == "input" else 0
        for operand in operation.operands:
            bits |= depends[operand]
        depends.append(bits)
    return depends


def _live_state(loop: TimeLoop) -> Set[int]:
    """Return the indices of the state on which a result depends, in this or a later tick."""
    step = loop.step

    def list_state_reads(program: Program, needed: Iterable[int]):
        # Inputs are those of the lane, then the state, then those of the tick.
        reads = program.reads
        indices = {reads[i] - loop.lane_inputs for i in needed if i in reads}
        return indices.intersection(range(loop.states))

    live = list_state_reads(loop.finish, loop.finish.needed())
    # Adds what the outputs and the new state need. In `step.outputs`, the new state comes first.
    while True:
        needed = step.needed([*(step.outputs[k] for k in live), *step.outputs[loop.states :]])
        new = live | list_state_reads(step, needed)
        if new == live:
            return live
        live = new
