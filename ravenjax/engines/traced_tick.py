"""What is traced of a robot's tick for a program, and as bytes."""

from __future__ import annotations

import dataclasses
import json
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from ravenjax.ir import binary
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers import tree
from ravenjax.numbers.vec import RECORDS, Vec


@dataclasses.dataclass(frozen=True)
class TracedTick:
    """The loop of a lane: its inputs are the varied parameters and the faults, its results the
    outcomes.

    What enters a tick is its number and the golden run's series; what goes out is the own series,
    then all signals.
    """

    loop: TimeLoop
    outcomes: tuple[str, ...]  # names of the results
    series: int  # numbers of the reference series
    signals: Any  # structure of the signals, each leaf its dtype

    def without_signals(self) -> TimeLoop:
        """The loop that tells nothing but its reference series."""
        step = self.loop.step
        return dataclasses.replace(
            self.loop,
            step=dataclasses.replace(step, outputs=step.outputs[: self.loop.states + self.series]),
        )

    def signals_of(
        self, out: np.ndarray, typed: Callable[[np.ndarray, np.dtype], np.ndarray]
    ) -> Any:
        """Every signal of the first lane, each leaf [ticks]; `typed` makes numbers of a type of a
        column of `out`.

        out: what went out, [ticks, numbers, lanes].
        """
        columns = np.ascontiguousarray(out[:, self.series :, 0].T)
        dtypes = tree.leaves(self.signals)
        return tree.filled(
            self.signals,
            [typed(column, dtype) for column, dtype in zip(columns, dtypes, strict=True)],
        )

    def to_bytes(self) -> bytes:
        """For `from_bytes`. Raises TypeError for signals that are not made of records, Vecs,
        tuples and dicts.
        """
        programs = [
            binary.to_bytes(program)
            for program in (self.loop.begin, self.loop.step, self.loop.finish)
        ]
        header = {
            "outcomes": self.outcomes,
            "series": self.series,
            "signals": to_json(self.signals),
            "programs": [len(program) for program in programs],
        }
        return zlib.compress(json.dumps(header).encode() + b"\n" + b"".join(programs), 1)


def from_bytes(content: bytes) -> TracedTick:
    """What `TracedTick.to_bytes` wrote, once the modules of its records are imported.

    Raises ValueError, KeyError or zlib.error for anything else.
    """
    line, _, rest = zlib.decompress(content).partition(b"\n")
    header, programs = json.loads(line), []
    for length in header["programs"]:
        programs.append(binary.from_bytes(rest[:length]))
        rest = rest[length:]
    signals = of_json(header["signals"])
    return TracedTick(TimeLoop(*programs), tuple(header["outcomes"]), header["series"], signals)


def to_json(node: Any) -> Any:
    """A tree of dtypes in JSON: null, the dtype's name, or [kind, branch, ..], kind being a
    record's name.

    Raises TypeError for what is not made of records, Vecs and tuples.
    """
    if node is None or isinstance(node, np.dtype):
        return None if node is None else node.str
    if isinstance(node, Vec):
        return ["Vec", *map(to_json, node)]
    if type(node) is tuple:
        return ["tuple", *map(to_json, node)]
    name = f"{type(node).__module__}.{type(node).__qualname__}"
    if name not in RECORDS:
        raise TypeError(f"a {name} has no form in JSON, expected records, Vecs and tuples")
    return [name, *(to_json(getattr(node, field.name)) for field in dataclasses.fields(node))]


def of_json(node: Any) -> Any:
    """The tree that `to_json` wrote. KeyError where a record's module is not imported."""
    if node is None or isinstance(node, str):
        return None if node is None else np.dtype(node)
    kind, branches = node[0], [of_json(branch) for branch in node[1:]]
    if kind == "Vec":
        return Vec(branches)
    return tuple(branches) if kind == "tuple" else RECORDS[kind](*branches)
