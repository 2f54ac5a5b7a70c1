"""Two checkouts beside each other in one run: they take turns, so that load and clocks change for
both alike.

Only what every commit has is used: commands from the shell, and `ravenjax.run` in a process of its
own.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ravenjax.bench import machine, scaling, start, text
from ravenjax.bench.clock import Repeats
from ravenjax.campaign import compile_cache
from ravenjax.errors import UserError

RUNS, TICKS = 4096, 3000
"""Of the campaign that is run twice in a process, the second time measured."""
ROUNDS = 9
"""At most; each has both checkouts."""
ENOUGH_ROUNDS = 4
"""From which on two that are alike lie apart in one of 35 benchmarks alone."""
_SCRIPT = """
import json, os, sys, time
cpus, runs, ticks = json.loads(sys.argv[1])
os.sched_setaffinity(0, cpus)
import ravenjax
fault = {"site": "usb_out", "channel": ["shoulder", "elbow", "insertion"], "effect": "overwrite",
         "value": {"uniform": [-20000, 20000]}, "start_ms": {"uniform": [0, ticks - 1]},
         "duration_ms": {"uniform": [1, 100]}}
campaign = {"campaign": {"name": "bench", "seed": 1, "duration_s": ticks / 1000, "arms": ["gold"]},
            "operator": {"motion": "suture", "seed": 1},
            "group": [{"name": "dac", "design": "random", "runs": runs, "fault": [fault]}]}
campaign = ravenjax.load_campaign(campaign)
ravenjax.run(campaign)
begin = time.perf_counter()
ravenjax.run(campaign)
print(json.dumps([time.perf_counter() - begin, os.path.realpath(ravenjax.__file__)]))
"""


@dataclasses.dataclass(frozen=True)
class BesideRow:
    """One quantity of both."""

    what: str
    here: Repeats  # s
    there: Repeats  # s

    @property
    def ratio(self) -> float:
        """Here over there, each at its best."""
        return self.here.smallest / self.there.smallest

    def sentence(self) -> str:
        """What repeats tell: that all of one are longer than all of the other, and that this is
        hardly chance.
        """
        one, other = self.here, self.there
        if (
            max(one.smallest, other.smallest) <= min(one.largest, other.largest)
            and len(one.values) > 1
        ):
            return (
                f"{self.what}: repeats do not tell them apart ({text.times(self.ratio)} times at"
                " best)."
            )
        doubt = "" if len(one.values) >= ENOUGH_ROUNDS else ", in too few rounds to be sure"
        return f"{self.what}: {text.times(self.ratio)} times as long here as there{doubt}."


@dataclasses.dataclass(frozen=True)
class Beside:
    """What two checkouts take for the same."""

    here: str  # folder
    there: str
    rows: tuple[BesideRow, ...]

    def as_json(self) -> dict[str, Any]:
        """All repeats, and what follows from them."""
        plain = dataclasses.asdict(self)
        for record, row in zip(plain["rows"], self.rows, strict=True):
            record["ratio"] = row.ratio
        return plain | {"sentences": self.sentences()}

    def table(self) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
        """Title, columns, rows."""
        cells = [
            (row.what, _cell(row.here), _cell(row.there), text.times(row.ratio))
            for row in self.rows
        ]
        return "Beside each other", ("what", "here", "there", "here/there"), cells

    def sentences(self) -> list[str]:
        """Of each quantity, whether repeats tell the two apart."""
        rounds = len(self.rows[0].here.values)
        return [
            f"Here is {self.here}, there {self.there}; {text.several(rounds, 'round')}.",
            *(row.sentence() for row in self.rows),
        ]


def _cell(side: Repeats) -> str:
    return f"{text.seconds(side.smallest)} ({text.repeats(side)})"


def measure(
    folder: Path,
    total_s: float,
    tell: Callable[[str], None] = lambda _: None,
    here: Path = start.ROOT,
) -> Beside:
    """Measure `here` and another checkout in turn, for about so long; one round at least.

    Raises UserError for a folder that holds no other checkout, RuntimeError for a command that
    fails.
    """
    there = folder.resolve()
    if not (there / "ravenjax/__init__.py").is_file():
        raise UserError(
            f"--beside {folder}: holds no ravenjax/__init__.py, expected the folder of another"
            " checkout"
        )
    if there == here:
        raise UserError(
            f"--beside {folder}: is the checkout that runs, expected the folder of another one"
        )
    values: dict[str, tuple[list[float], list[float]]] = {}
    rounds = 0
    with tempfile.TemporaryDirectory() as temporary:
        places = [Path(temporary) / name for name in ("here", "there")]

        def once() -> None:
            nonlocal rounds
            rounds += 1
            sides = [(0, here), (1, there)]
            for side, root in sides if rounds % 2 else sides[::-1]:
                tell(f"round {rounds}, {root}")
                for what, seconds in _one(root, places[side], rounds):
                    values.setdefault(what, ([], []))[side].append(seconds)

        scaling.rounds(once, total_s, ROUNDS)
    rows = tuple(
        BesideRow(what, Repeats(tuple(one)), Repeats(tuple(other)))
        for what, (one, other) in values.items()
    )
    return Beside(str(here), str(there), rows)


def _one(root: Path, place: Path, number: int) -> list[tuple[str, float]]:
    """(what, s) of one checkout once; a cache of its own for each round."""
    own = place / str(number)
    own.mkdir(parents=True)
    times = [
        (f"ravenjax {what}", start.timed_command(own, *tokens, root=root)[0])
        for what, tokens in start.commands(own)
    ]
    order = [cpu for cpu, _ in machine.spread(os.sched_getaffinity(0))]
    for count in sorted({1, machine.usable_cpus()}):
        what = (
            f"a campaign of {RUNS} runs of {text.seconds(TICKS / 1e3)} on"
            f" {text.several(count, 'core')}"
        )
        times.append((what, _campaign_s(root, own, order[:count])))
    return times


def _campaign_s(root: Path, place: Path, cpus: list[int]) -> float:
    """s of the second `ravenjax.run` of a process."""
    environment = start.environment(root) | {compile_cache.VARIABLE: str(place / "cache")}
    command = [sys.executable, "-c", _SCRIPT, json.dumps([cpus, RUNS, TICKS])]
    answer = subprocess.run(
        command, env=environment, cwd=place, capture_output=True, text=True, check=False
    )
    if answer.returncode:
        raise RuntimeError(
            f"ravenjax.run in {root}: exit code {answer.returncode}:"
            f" {text.last_line(answer.stderr)}"
        )
    seconds, file = json.loads(answer.stdout.splitlines()[-1])
    if Path(file) != root / "ravenjax/__init__.py":
        raise RuntimeError(f"{file} was measured in place of {root}/ravenjax/__init__.py")
    return seconds
