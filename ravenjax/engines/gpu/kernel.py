"""A split time loop as one CUDA C module, and how the buffers of its kernels are laid out.

shared_begin    state of each group from its inputs; one thread a group shared_run      some ticks
of each group: advances its state, writes a row of numbers a tick lane_begin      state of each lane
from its inputs; one thread a lane lane_branch     state of the lanes of some warps from snapshots
lane_run        the same ticks of each lane, reading its group's rows, from where its block begins
to the lane's own end lane_finish     results of each lane group_snapshot  copies the state of the
first group; one thread a number lane_snapshot   copies the state of the first lane; one thread a
number

A lane that has ended waits for the others of its block. What it shares with its group goes on, so
its last tick leaves those numbers of the group's state that its results need in `saved`: a row has
them, too.

Every number takes a 32-bit word. Lanes come in whole blocks of threads, and the lanes of a warp are
of one group. Inputs, `saved` and results of lanes are [number, lane], their state is [block,
number, thread]; buffers of groups are [group, number], rows [group, tick, number]. What goes in and
out in each tick is [tick, number, lane], or [group, tick, number] where it is alike in a group.
"""

from __future__ import annotations

import collections
import dataclasses

from ravenjax.engines.gpu.cuda import PRELUDE, CudaPrinter
from ravenjax.ir.program import Program
from ravenjax.ir.regions import arrange
from ravenjax.ir.time_loop import Split

WARP = 32
VECTOR = 4
"""Words that one instruction moves."""

_MOST_PLAIN = 128
"""Words of state in device memory; with more, accesses are assembly: 2 % slower, but compiled in
2 s, not in 13.
"""

_POINTERS = """\
typedef const unsigned* __restrict__ Words;
typedef unsigned* __restrict__ Room;
typedef const int* __restrict__ Groups;
typedef const uint4* __restrict__ Fours;
// A word in device memory. As assembly, accesses keep their order, and no pass spends ten seconds on their addresses.
struct Far {
  unsigned* at;
#ifdef __CUDA_ARCH__
  __device__ operator unsigned() const {
    unsigned x;
    asm volatile("ld.global.u32 %0, [%1];" : "=r"(x) : "l"(at));
    return x;
  }
  __device__ void operator=(unsigned x) { asm volatile("st.global.u32 [%0], %1;" ::"l"(at), "r"(x)); }
#else
  operator unsigned() const { return *at; }
  void operator=(unsigned x) { *at = x; }
#endif
};
"""  # noqa: E501


@dataclasses.dataclass(frozen=True)
class Form:
    """How `lane_run` uses a multiprocessor, which is to hold one block of it.

    No number of the state lives in a register from one tick to the next: registers are for what a
    tick computes. Measured (analysis/engines/gpu.md).
    """

    threads: int = 384  # of a block; 168 registers each
    shared_words: int = (
        148  # words of a thread's state in shared memory, at most; the others stay in device memory
    )
    # statements across which the compiler may move memory accesses, or it holds too much at once
    region: int = 1000
    # operations of a tick from which warps begin it together, to share fetched instructions
    in_step_from: int = 5000

    @property
    def bounds(self) -> str:
        """What holds the compiler to as many registers as a block of so many threads may have."""
        return f"__launch_bounds__({self.threads}, 1)"


@dataclasses.dataclass(frozen=True)
class KernelSource:
    """The module's text and its buffers, in words of a lane or group."""

    text: str
    form: Form
    inputs: tuple[str, ...]  # types
    results: tuple[str, ...]  # types
    outputs: tuple[str, ...]  # types of what goes out in each tick
    tick_inputs: int  # numbers that enter each tick, the tick's own number aside
    state: int
    group_state: int
    saved: int
    row: int
    shared_bytes: int  # of a block's shared memory


def print_loop(split: Split, form: Form, given_by_group: bool) -> KernelSource:
    """Print `split`; given_by_group: what enters a tick is alike in a group. Raises
    NotImplementedError for float64.
    """
    return _CudaModule(split, form, given_by_group).source()


class _CudaModule:
    def __init__(self, split: Split, form: Form, given_by_group: bool) -> None:
        loop = split.loop
        self.split, self.form, self.given_by_group = split, form, given_by_group
        self.step, self.begin, self.finish = loop.step, loop.begin, loop.finish
        self.inputs, self.states = loop.lane_inputs, loop.states
        self.tick_inputs = len(loop.step.inputs) - loop.lane_inputs - loop.states - 1
        self.outputs = loop.step.outputs[loop.states :]
        self.saved = self._finish_reads()
        self.in_row = self._row_order()
        self.row = -(-len(self.in_row) // VECTOR) * VECTOR
        self.far, self.in_shared = self._kept()
        self.lane_state = (*self.far, *self.in_shared)
        for program in (self.step, self.begin, self.finish):
            if "float64" in {operation.dtype for operation in program.operations}:
                raise NotImplementedError(
                    "a program with float64 numbers; CUDA kernels keep every number in 32 bits"
                )

    def source(self) -> KernelSource:
        kernels = [
            self._shared_begin(),
            self._shared_run(),
            self._lane_begin(),
            self._lane_run(),
            self._lane_finish(),
        ]
        kernels += [self._lane_branch(), self._snapshot("group", len(self.split.shared_state), 1)]
        kernels += [self._snapshot("lane", len(self.lane_state), self.form.threads)]

        def types(program: Program, numbers: tuple[int, ...]) -> tuple[str, ...]:
            return tuple(program.operations[i].dtype for i in numbers)

        return KernelSource(
            text="\n".join([PRELUDE, _POINTERS, *kernels]),
            form=self.form,
            inputs=self.begin.inputs,
            results=types(self.finish, self.finish.outputs),
            outputs=types(self.step, self.outputs),
            tick_inputs=self.tick_inputs,
            state=len(self.lane_state),
            group_state=len(self.split.shared_state),
            saved=len(self.saved),
            row=self.row,
            shared_bytes=-(-len(self.in_shared) // VECTOR) * VECTOR * 4 * self.form.threads,
        )

    # --- words ---

    def _words(self, program: Program, inputs: str, state: dict[int, str]) -> dict[int, str]:
        """Words of a program's inputs: those of the lane by template, the state's by number."""
        numbers = {i: op.detail for i, op in enumerate(program.operations) if op.name == "input"}
        words = {i: inputs.format(k) for i, k in numbers.items() if k < self.inputs}
        return words | {
            i: state[k - self.inputs] for i, k in numbers.items() if k - self.inputs in state
        }

    def _of_this_tick(self, template: str) -> tuple[dict[int, str], dict[int, str]]:
        """Words of what enters a tick, and the text of the tick's number."""
        first = self.inputs + self.states
        at = {
            i: op.detail - first for i, op in enumerate(self.step.operations) if op.name == "input"
        }
        words = {i: template.format(k - 1) for i, k in at.items() if k > 0}
        return words, {i: "now" for i, k in at.items() if k == 0}

    @staticmethod
    def _of_lane(name: str) -> str:
        """Template of the words of a lane's inputs or results."""
        return f"{name}[{{}} * (size_t)lanes]"

    def _at_lane(self, *names: str) -> list[str]:
        """Moves pointers to the thread's lane: of its inputs or results by name, and of its
        state.
        """
        return [
            "  const int lane = blockIdx.x * blockDim.x + threadIdx.x;",
            *(f"  {name} += lane;" for name in names),
            (
                f"  state += (size_t)blockIdx.x * {len(self.lane_state) * self.form.threads} +"
                " threadIdx.x;"
            ),
        ]

    def _at_group(self, **numbers: int | str) -> list[str]:
        """Moves pointers of groups' buffers to the thread's group."""
        moved = [f"  {name} += (size_t)group * {count};" for name, count in numbers.items()]
        return [
            "  const int group = blockIdx.x * blockDim.x + threadIdx.x;",
            "  if (group >= groups) return;",
            *moved,
        ]

    def _reads(self) -> tuple[collections.Counter[int], dict[int, int]]:
        """How often the loop of a lane reads each operation of a step, and where first."""
        times, first = collections.Counter[int](), dict[int, int]()
        for place, i in enumerate(self.split.lane):
            for o in self.step.operations[i].operands:
                times[o] += 1
                first.setdefault(o, place)
        return times, first

    def _kept(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Numbers of a lane's state that are kept in device memory (those read least) and in shared
        memory.

        Both in the order of first use: neighbours are read together.
        """
        times, first = self._reads()
        at = {
            op.detail - self.inputs: i
            for i, op in enumerate(self.step.operations)
            if op.name == "input"
        }
        numbers = (*self.split.lane_state, *self.split.held_state)
        order = sorted(numbers, key=lambda k: times[at.get(k, -1)])
        far = max(0, len(order) - self.form.shared_words)
        parts = (
            sorted(part, key=lambda k: first.get(at.get(k, -1), -1))
            for part in (order[:far], order[far:])
        )
        return tuple(next(parts)), tuple(next(parts))

    def _row_order(self) -> tuple[int, ...]:
        """The numbers of a row: those that a tick reads in the order of first use, then what is
        saved besides.
        """
        _, first = self._reads()
        after = {self.step.outputs[k] for k in self.saved}.difference(self.split.row)
        return (*sorted(self.split.row, key=lambda i: first.get(i, -1)), *sorted(after))

    def _finish_reads(self) -> tuple[int, ...]:
        """Numbers of a group's state that the results of its lanes need."""
        operations = (self.finish.operations[i] for i in self.finish.needed())
        read = {op.detail - self.inputs for op in operations if op.name == "input"}
        return tuple(k for k in self.split.shared_state if k in read)

    def _state_in_loop(self) -> dict[int, str]:
        """The word that holds each number of a lane's state in the loop; four of a thread are
        neighbours.
        """
        template = "state[{} * {}]" if len(self.far) <= _MOST_PLAIN else "Far{{state + {} * {}}}"
        places = {
            k: template.format(position, self.form.threads) for position, k in enumerate(self.far)
        }
        for position, k in enumerate(self.in_shared):
            group, member = divmod(position, VECTOR)
            places[k] = f"room[{group * self.form.threads * VECTOR + member}]"
        return places

    def _stored(self, position: int) -> str:
        """The word of a number of a lane's state in device memory."""
        return f"state[{position} * {self.form.threads}]"

    # --- kernels ---

    def _shared_begin(self) -> str:
        printer = CudaPrinter()
        state = {k: f"state[{position}]" for position, k in enumerate(self.split.shared_state)}
        results = [(self.begin.outputs[k], word) for k, word in state.items()]
        sources = self._words(self.begin, "inputs[{}]", {})
        printer.run(self.begin, self.begin.needed(i for i, _ in results), sources, results)
        start = self._at_group(inputs=self.inputs, state=len(state))
        return _kernel(
            "shared_begin", "Words inputs, Room state, int groups", [*start, *printer.lines]
        )

    def _shared_run(self) -> str:
        printer = CudaPrinter("    ")
        step, split = self.step, self.split
        state = {k: f"s{position}" for position, k in enumerate(split.shared_state)}
        words, tick_values = self._of_this_tick(f"given[(size_t)tick * {self.tick_inputs} + {{}}]")
        sources = self._words(step, "inputs[{}]", state) | words
        results = [(step.outputs[k], word) for k, word in state.items()]
        results += [(i, f"row[{position}]") for position, i in enumerate(self.in_row)]
        order = arrange(step.operations, split.shared, [i for i, _ in results])
        printer.run(step, order, sources, results, "tables", tick_values)
        start = self._at_group(
            inputs=self.inputs,
            state=len(state),
            given=f"count * {self.tick_inputs}",
            row=f"count * {self.row}",
        )
        body = [
            *start,
            *(
                f"  unsigned {word} = state[{position}];"
                for position, word in enumerate(state.values())
            ),
            f"  for (int tick = 0; tick < count; ++tick, row += {self.row}) {{",
            "    const int now = first + tick;",
            *printer.lines,
            "  }",
            *(f"  state[{position}] = {word};" for position, word in enumerate(state.values())),
        ]
        parameters = (
            "Words inputs, Room state, Words tables, Words given, Room row, int groups, int first,"
            " int count"
        )
        return _kernel("shared_run", parameters, body, f"__launch_bounds__({WARP})")

    def _lane_begin(self) -> str:
        printer = CudaPrinter()
        results = [
            (self.begin.outputs[k], self._stored(place)) for place, k in enumerate(self.lane_state)
        ]
        sources = self._words(self.begin, self._of_lane("inputs"), {})
        printer.run(self.begin, self.begin.needed(i for i, _ in results), sources, results)
        return _kernel(
            "lane_begin",
            "Words inputs, Room state, int lanes",
            [*self._at_lane("inputs"), *printer.lines],
            self.form.bounds,
        )

    def _lane_run(self) -> str:
        step, split, form = self.step, self.split, self.form
        state = self._state_in_loop()
        inputs = self._words(step, "in{}", state)
        packed, prologue_words, prologue = self._held(inputs)

        printer = CudaPrinter("    ")
        words, tick_values = self._of_this_tick(
            f"given[((size_t)tick * {self.tick_inputs} + {{}}) * lanes + lane]"
        )
        rows = {
            i: f"row[{position // VECTOR}].{'xyzw'[position % VECTOR]}"
            for position, i in enumerate(self.in_row)
        }
        sources = inputs | ({} if self.given_by_group else words) | rows | prologue_words
        results = [(step.outputs[k], state[k]) for k in split.lane_state]
        results += [(i, f"o{position}") for position, i in enumerate(self.outputs)]
        order = arrange(step.operations, split.lane, [i for i, _ in results])
        printer.run(step, order, sources, results, "tables", tick_values)
        for at in range(len(printer.lines) // form.region * form.region, 0, -form.region):
            printer.lines.insert(at, '    asm volatile("" ::: "memory");')

        used = {
            op.detail for op in step.operations if op.name == "input" and op.detail < self.inputs
        }
        first = len(self.far)
        near = [
            (state[k], self._stored(first + position)) for position, k in enumerate(self.in_shared)
        ]
        out = [
            f"      out[((size_t)tick * {len(self.outputs)} + {k}) * lanes + lane] = o{k};"
            for k in range(len(self.outputs))
        ]
        at_row = f"groups[lane / {WARP}] * (size_t)count"
        place = {i: position for position, i in enumerate(self.in_row)}
        after = [f"((const unsigned*)row)[{place[self.step.outputs[k]]}]" for k in self.saved]
        body = [
            (
                "  const int begin = spans[2 * blockIdx.x] > first ? spans[2 * blockIdx.x] - first"
                " : 0;"
            ),
            (
                "  const int last = spans[2 * blockIdx.x + 1] - first, end = last < count ? last :"
                " count;"
            ),
            "  if (begin >= end) return;",
            *self._at_lane("inputs", "saved"),
            "  const int own_end = ends[lane] - first;",
            "  extern __shared__ __align__(16) unsigned block_room[];",
            f"  unsigned* room = block_room + threadIdx.x * {VECTOR};",
            *(
                f"  const unsigned in{k} = {self._of_lane('inputs').format(k)};"
                for k in sorted(used)
            ),
            *(f"  {word} = {stored};" for word, stored in near),
            *prologue,
            "  const Fours rows = row;",
            f"  row += ({at_row} + begin) * {self.row // VECTOR};",
            f"  for (int tick = begin; tick < end; ++tick, row += {self.row // VECTOR}) {{",
            *(["    __syncthreads();"] if len(split.lane) >= form.in_step_from else []),
            "    if (tick >= own_end) continue;",
            *(
                f'    asm volatile("" : "+r"({name}));  // the bits are to stay in one register'
                for name in packed
            ),
            "    const int now = first + tick;",
            *(f"    unsigned o{k};" for k in range(len(self.outputs))),
            *printer.lines,
            *(["    if (out) {", *out, "    }"] if out else []),
            "  }",
            *(f"  {stored} = {word};" for word, stored in near),
            "  if (own_end <= begin || own_end > count) return;",
            f"  row = rows + ({at_row} + own_end - 1) * {self.row // VECTOR};",
            *(
                f"  saved[{position} * (size_t)lanes] = {word};"
                for position, word in enumerate(after)
            ),
        ]
        parameters = (
            "Words inputs, Room state, Words tables, Words given, Fours row, Groups groups, Groups"
            " spans, Groups ends, Room saved, Room out, int lanes, int first, int count"
        )
        return _kernel("lane_run", parameters, body, form.bounds)

    def _held(self, inputs: dict[int, str]) -> tuple[list[str], dict[int, str], list[str]]:
        """Words packed with the truth values that the loop reads, the word of each held number,
        and the statements.
        """
        printer = CudaPrinter()
        numbers = self.split.prologue_results
        printer.run(self.step, self.split.prologue, inputs, [(i, f"k{i}") for i in numbers])
        lines = [f"  unsigned k{i};" for i in numbers] + printer.lines
        words_of = {i: f"k{i}" for i in numbers}
        truths = [i for i in numbers if self.step.operations[i].dtype == "bool"]
        names = []
        for p in range(0, len(truths), 32):
            names.append(f"held{p // 32}")
            pack = truths[p : p + 32]
            lines.append(
                f"  unsigned {names[-1]} ="
                f" {' | '.join(f'k{i} << {bit}' for bit, i in enumerate(pack))};"
            )
            words_of.update({i: f"{names[-1]} & 0x{1 << bit:x}u" for bit, i in enumerate(pack)})
        return names, words_of, lines

    def _lane_finish(self) -> str:
        printer = CudaPrinter()
        state = {k: self._stored(place) for place, k in enumerate(self.lane_state)}
        state |= {
            k: self._of_lane("saved").format(position) for position, k in enumerate(self.saved)
        }
        sources = self._words(self.finish, self._of_lane("inputs"), state)
        template = self._of_lane("results")
        results = [(i, template.format(position)) for position, i in enumerate(self.finish.outputs)]
        printer.run(self.finish, self.finish.needed(), sources, results)
        start = self._at_lane("inputs", "saved", "results")
        parameters = "Words inputs, Words state, Words saved, Room results, int lanes"
        return _kernel("lane_finish", parameters, [*start, *printer.lines], self.form.bounds)

    def _lane_branch(self) -> str:
        words, threads = len(self.lane_state), self.form.threads
        body = [
            f"  const int own = snapshot[(blockIdx.x * {threads} + threadIdx.x) / {WARP}];",
            "  if (own < 0) return;",
            *self._at_lane()[1:],
            f"  snapshots += (size_t)own * {words};",
            f"  for (int k = 0; k < {words}; ++k) state[k * {threads}] = snapshots[k];",
        ]
        return _kernel(
            "lane_branch", "Words snapshots, Groups snapshot, Room state", body, self.form.bounds
        )

    @staticmethod
    def _snapshot(what: str, words: int, stride: int) -> str:
        """Copies the first of the states that stand in words `stride` apart."""
        body = [
            "  const int k = blockIdx.x * blockDim.x + threadIdx.x;",
            f"  if (k < {words}) snapshots[(size_t)row * {words} + k] = state[k * {stride}];",
        ]
        return _kernel(f"{what}_snapshot", "Words state, Room snapshots, int row", body)


def _kernel(name: str, parameters: str, body: list[str], bounds: str = "") -> str:
    return "\n".join(
        [f'extern "C" __global__ void {bounds} {name}({parameters})', "{", *body, "}", ""]
    )
