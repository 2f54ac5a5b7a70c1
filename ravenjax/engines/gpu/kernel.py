"""Generates the kernels that run a time loop on a GPU, as one CUDA C module.

A lane is one robot, computed by one thread. Robots with equal parameters form a group, and a warp
has lanes of one group. Numbers that are equal in a group are computed once. The kernels are:

    shared_begin    computes the first state of each group from its inputs; one thread per group
    shared_run      advances each group by some ticks and writes one row of numbers per tick
    lane_begin      computes the first state of each lane from its inputs; one thread per lane
    lane_branch     replaces the state of lanes that start from a snapshot; one snapshot per warp
    lane_run        advances each lane by the same ticks and reads its group's row in each tick
    lane_finish     writes the results of each lane
    group_snapshot  copies the state of the first group; one thread per number
    lane_snapshot   copies the state of the first lane; one thread per number

For example, 100 faults of one golden run may be 100 lanes of one group. `shared_run` computes 500
ticks of the shared numbers and writes 500 rows. `lane_run` computes the 100 lanes and reads these
rows. The results of a lane need the group's numbers of the lane's last tick, which may come before
the group's last tick. Therefore `lane_run` copies these numbers to the buffer `saved`.

This file also defines the layout of the buffers. Every number takes a 32-bit word. Lanes fill whole
blocks of threads. Inputs, `saved` and results of lanes have the shape [number, lane], and the state
of lanes has [block, number, thread]. Buffers of groups have [group, number], and rows have [group,
tick, number]. Inputs and outputs of each tick have the shape [tick, number, lane], or [group, tick,
number] if they are equal in a group.
"""

import collections
import dataclasses
from pathlib import Path

from ravenjax import resources
from ravenjax.engines.gpu.cuda import CudaPrinter
from ravenjax.engines.printing import LoopPrinting
from ravenjax.ir.time_loop import Split

WARP = 32
VECTOR = 4
"""Number of 32-bit words that one instruction loads or stores."""

_MAX_PLAIN_WORDS = 128
"""Most words of state that plain C accesses. Assembly is 2 % slower; it compiles in 2, not 13 s."""


@dataclasses.dataclass(frozen=True)
class Form:
    """Settings of kernel `lane_run`, with which one block of threads fills a multiprocessor. The
    state is in memory between ticks, so that all registers serve the computation of a tick. The
    values are measured (analysis/engines/gpu.md).
    """

    threads: int = 384  # per block, with 168 registers each
    # Largest number of words of a thread's state in shared memory; the others are in device memory.
    shared_words: int = 148
    # Number of statements across which memory accesses may move. More need too many registers.
    region: int = 1000
    # Least number of operations of a tick for which all warps begin the tick together, because
    # they then share fetched instructions.
    in_step_from: int = 5000


@dataclasses.dataclass(frozen=True)
class KernelSource:
    """The module's text and the layout of its buffers, in words per lane or group."""

    text: str
    results: tuple[str, ...]  # types
    outputs: int  # number of outputs of each tick
    tick_inputs: int  # number of inputs of each tick, without the tick's number
    state: int
    group_state: int
    saved: int
    row: int
    shared_bytes: int  # of a block's shared memory


def print_loop(split: Split, form: Form, given_by_group: bool) -> KernelSource:
    """Generate the module of `split`. given_by_group: inputs of ticks are equal in a group."""
    return _CudaModule(split, form, given_by_group).source()


class _CudaModule(LoopPrinting[str]):
    def __init__(self, split: Split, form: Form, given_by_group: bool):
        super().__init__(split)
        self.form, self.given_by_group = form, given_by_group
        # Numbers of inputs of a lane and of a tick. The tick's number is not counted.
        self.inputs, self.tick_inputs = split.loop.lane_inputs, len(split.loop.tick_inputs) - 1
        self.saved = self._finish_reads()
        self.in_row = self._row_order()
        # Words of a row, in whole vectors.
        self.row = -(-len(self.in_row) // VECTOR) * VECTOR
        self.in_device_memory, self.in_shared = self._divide_state()
        self.lane_state = (*self.in_device_memory, *self.in_shared)
        for program in (self.step, self.begin, self.finish):
            if "float64" in {operation.dtype for operation in program.operations}:
                raise NotImplementedError(
                    "the program has float64 numbers, but CUDA kernels have numbers of 32 bits"
                )

    def source(self) -> KernelSource:
        # Returns the module's text with the sizes of its buffers.
        folder = Path(__file__).parent
        text = resources.render_text(
            folder / "kernel.cu.j2",
            prelude=resources.render_text(folder / "prelude.cu.j2"),
            # Registers are limited to what a block of this many threads may have.
            bounds=f"__launch_bounds__({self.form.threads}, 1)",
            threads=self.form.threads,
            warp=WARP,
            vector=VECTOR,
            inputs=self.inputs,
            tick_inputs=self.tick_inputs,
            group_words=len(self.split.shared_state),
            lane_words=len(self.lane_state),
            row_words=self.row,
            outputs=len(self.outputs),
            shared_begin=self._shared_begin(),
            shared_run=self._shared_run(),
            lane_begin=self._lane_begin(),
            lane_finish=self._lane_finish(),
            **self._lane_run(),
        )
        return KernelSource(
            text=text,
            results=tuple(self.finish.operations[i].dtype for i in self.finish.outputs),
            outputs=len(self.outputs),
            tick_inputs=self.tick_inputs,
            state=len(self.lane_state),
            group_state=len(self.split.shared_state),
            saved=len(self.saved),
            row=self.row,
            shared_bytes=-(-len(self.in_shared) // VECTOR) * VECTOR * 4 * self.form.threads,
        )

    def _input_words(self, template: str) -> list[str]:
        return [template.format(k) for k in range(self.inputs)]

    def _tick_input_words(self, template: str):
        """Return operation -> word in memory, and for the tick's number operation -> variable."""
        words = {i: template.format(k - 1) for i, k in self.tick_reads.items() if k}
        return words, {i: "now" for i, k in self.tick_reads.items() if not k}

    @staticmethod
    def _lane_word(name: str) -> str:
        # Returns a template of C code for a word of this lane; {} takes the word's number.
        return f"{name}[{{}} * (size_t)lanes]"

    def _count_reads(self):
        """Return operation -> how often a lane's tick reads it, and -> where it does so first."""
        read_counts, first_readers = collections.Counter[int](), dict[int, int]()
        for position, i in enumerate(self.split.lane):
            for operand in self.step.operations[i].operands:
                read_counts[operand] += 1
                first_readers.setdefault(operand, position)
        return read_counts, first_readers

    def _divide_state(self):
        """Return the numbers of a lane's state in device memory, and those in shared memory.
        Numbers are indices in the state. Shared memory, which is faster but small, has those that a
        tick reads most often. Both are in the order of first use, because one instruction loads
        VECTOR consecutive words.
        """
        read_counts, first_readers = self._count_reads()
        # Index in the state -> operation of `step` that loads this number. In `step.reads`, the
        # state follows the inputs of the lane.
        loads = {k - self.inputs: i for i, k in self.step.reads.items()}
        numbers = (*self.split.lane_state, *self.split.held_state)
        # -1 stands for no operation: a tick may not load the number.
        read_count = {k: read_counts[loads.get(k, -1)] for k in numbers}
        first_use = {k: first_readers.get(loads.get(k, -1), -1) for k in numbers}
        by_reads = sorted(numbers, key=read_count.__getitem__)
        device_words = max(0, len(numbers) - self.form.shared_words)
        parts = by_reads[:device_words], by_reads[device_words:]
        in_device, in_shared = (tuple(sorted(part, key=first_use.__getitem__)) for part in parts)
        return in_device, in_shared

    def _row_order(self):
        """Return the operations of a row: those that a tick reads, then those only for results."""
        _, first = self._count_reads()
        only_saved = {self.step.outputs[k] for k in self.saved}.difference(self.split.row)
        return (*sorted(self.split.row, key=lambda i: first.get(i, -1)), *sorted(only_saved))

    def _finish_reads(self):
        """Return the indices of a group's state on which the results of its lanes depend."""
        reads = self.finish.reads
        indices = {reads[i] - self.inputs for i in self.finish.needed() if i in reads}
        return tuple(k for k in self.split.shared_state if k in indices)

    def _state_in_loop(self):
        """Return the C code of each word of a thread's state in the loop, by index in the state.
        Array `state` in device memory has the shape [word, thread], and array `room` in shared
        memory [vector, thread, VECTOR]. Both pointers point to the first word of this thread.
        """
        # For many words in device memory, class `Far` of kernel.cu.j2 compiles faster than plain C.
        is_plain = len(self.in_device_memory) <= _MAX_PLAIN_WORDS
        threads, code = self.form.threads, {}
        for position, k in enumerate(self.in_device_memory):
            distance = f"{position} * {threads}"
            code[k] = f"state[{distance}]" if is_plain else f"Far{{state + {distance}}}"
        for position, k in enumerate(self.in_shared):
            vector, member = divmod(position, VECTOR)
            code[k] = f"room[{vector * threads * VECTOR + member}]"
        return code

    def _state_word(self, position: int) -> str:
        return f"state[{position} * {self.form.threads}]"

    def _shared_begin(self) -> str:
        printer = CudaPrinter()
        state = {k: f"state[{position}]" for position, k in enumerate(self.split.shared_state)}
        self.print_begin(printer, self._input_words("inputs[{}]"), state)
        return printer.text()

    def _shared_run(self) -> str:
        # Returns CUDA code that computes the numbers of one tick that all lanes of a group share.
        # Sources: the group's inputs and state, and the words of array `given` for this tick.
        printer = CudaPrinter("    ")
        state = {k: f"s{position}" for position, k in enumerate(self.split.shared_state)}
        given = f"given[(size_t)tick * {self.tick_inputs} + {{}}]"
        tick_words, tick_values = self._tick_input_words(given)
        sources = self.sources(self.step, self._input_words("inputs[{}]"), state) | tick_words
        row = [(i, f"row[{position}]") for position, i in enumerate(self.in_row)]
        self.print_step(printer, self.split.shared, sources, state, row, tick_values)
        return printer.text()

    def _lane_begin(self) -> str:
        printer = CudaPrinter()
        state = {k: self._state_word(place) for place, k in enumerate(self.lane_state)}
        self.print_begin(printer, self._input_words(self._lane_word("inputs")), state)
        return printer.text()

    def _lane_run(self):
        """Return values for `lane_run` in kernel.cu.j2, the loop over ticks of one lane.

        lane_run: statements of a tick. prologue, packed: see `_print_prologue`. inputs_read:
        indices of the lane's inputs that a tick reads. near: C code of each word of the state in
        shared memory, and of the word of device memory that keeps it between launches. in_step:
        whether all warps of a block begin each tick together. saved: positions of the numbers in a
        group's row that are saved when a lane ends.
        """
        step, split = self.step, self.split
        state = self._state_in_loop()
        inputs = self.sources(step, self._input_words("in{}"), state)
        packed, prologue_words, prologue = self._print_prologue(inputs)
        printer = CudaPrinter("    ")
        given = f"given[((size_t)tick * {self.tick_inputs} + {{}}) * lanes + lane]"
        tick_words, tick_values = self._tick_input_words(given)
        position_in_row = {i: position for position, i in enumerate(self.in_row)}
        # A row is read in vectors of four words, whose members are x, y, z and w.
        rows = {i: f"row[{k // VECTOR}].{'xyzw'[k % VECTOR]}" for i, k in position_in_row.items()}
        # If inputs of ticks are equal in a group, only `shared_run` reads them, and lanes read its
        # results in the row. The tick's number needs no word: it is a variable (`tick_values`).
        own_words = {} if self.given_by_group else tick_words
        sources = inputs | own_words | rows | prologue_words
        changed = {k: state[k] for k in split.lane_state}
        outputs = [(i, f"o{position}") for position, i in enumerate(self.outputs)]
        self.print_step(printer, split.lane, sources, changed, outputs, tick_values)
        # Every `region` lines there is a barrier, across which the compiler moves no memory access.
        # They are inserted from the end, because an insertion moves all later lines.
        region, lines = self.form.region, printer.lines
        for position in range(len(lines) // region * region, 0, -region):
            lines.insert(position, '    asm volatile("" ::: "memory");')
        shared_positions = enumerate(self.in_shared, len(self.in_device_memory))
        return {
            "prologue": prologue,
            "packed": packed,
            "lane_run": printer.text(),
            "inputs_read": sorted(k for k in step.reads.values() if k < self.inputs),
            "near": [(state[k], self._state_word(position)) for position, k in shared_positions],
            "in_step": len(split.lane) >= self.form.in_step_from,
            "saved": [position_in_row[step.outputs[k]] for k in self.saved],
        }

    def _print_prologue(self, inputs: dict[int, str]):
        """Print the code that computes a lane's constant numbers before the loop over ticks.

        Returns the names of words that each pack 32 truth values, to save registers; a dict from
        operation to the C code of its number in the loop; and the printed code. inputs: operation
        -> C code of the lane's input or state that it reads.
        """
        printer = CudaPrinter()
        numbers = self.split.prologue_results
        printer.lines += [f"  unsigned k{i};" for i in numbers]
        printer.run(self.step, self.split.prologue, inputs, [(i, f"k{i}") for i in numbers])
        words_of = {i: f"k{i}" for i in numbers}
        truths = [i for i in numbers if self.step.operations[i].dtype == "bool"]
        names = []
        for p in range(0, len(truths), 32):
            names.append(f"held{p // 32}")
            pack = truths[p : p + 32]
            bits = " | ".join(f"k{i} << {bit}" for bit, i in enumerate(pack))
            printer.line(f"unsigned {names[-1]} = {bits};")
            words_of.update({i: f"{names[-1]} & 0x{1 << bit:x}u" for bit, i in enumerate(pack)})
        return names, words_of, printer.text()

    def _lane_finish(self) -> str:
        # Prints the outcomes of one lane from its last state and the saved state of its group.
        printer = CudaPrinter()
        saved_word, result_word = self._lane_word("saved"), self._lane_word("results")
        state = {k: self._state_word(place) for place, k in enumerate(self.lane_state)}
        state |= {k: saved_word.format(place) for place, k in enumerate(self.saved)}
        results = map(result_word.format, range(len(self.finish.outputs)))
        self.print_finish(printer, self._input_words(self._lane_word("inputs")), state, results)
        return printer.text()
