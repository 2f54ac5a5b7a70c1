"""Whole commands from the shell, each in a process of its own: what a user waits for."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ravenjax.bench import scaling, text
from ravenjax.bench.clock import Repeats
from ravenjax.campaign import compile_cache

CAMPAIGN, OTHER_VALUES = "quick", ("--set", "campaign.seed=7")
"""A bundled campaign, and what draws other values for faults and parameters of the same form."""
NOTHING, AGAIN, OTHERS = ", nothing cached", " again", " with other values"
"""Of the form that is run: neither traced nor compiled before, with the same values, with
others.
"""
ROUNDS = 5
"""At most."""
ROOT = Path(__file__).resolve().parents[2]
"""Folder of the package that runs."""
LARGE_RUNS, LARGE_S = 1_000_000, 10.0
LARGE = """
[campaign]
name = "large"
seed = 1
duration_s = {duration_s}
arms = ["gold"]

[operator]
motion = "suture"
seed = 1

[[group]]
name = "dac"
design = "random"
runs = {runs}
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow", "insertion"]
effect = "overwrite"
value = {{ uniform = [-20000, 20000] }}
start_ms = {{ uniform = [0, {last_ms}] }}
duration_ms = {{ uniform = [1, 100] }}
"""
"""The campaign that `workload.campaign` makes, as a file."""
_UNIT = 1024 if sys.platform == "linux" else 1  # B, of the memory that the system tells
_LAUNCHER = """
import json, os, subprocess, sys, time
begin = time.perf_counter()
with open(sys.argv[1], "wb") as words:
    process = subprocess.Popen(sys.argv[2:], stdout=words, stderr=words)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
seconds, cpu = time.perf_counter() - begin, usage.ru_utime + usage.ru_stime
print(json.dumps([seconds, process.returncode, cpu, usage.ru_maxrss]))
"""
"""Starts a command from a small process: the memory of the one that starts it counts as the
command's.
"""


@dataclasses.dataclass(frozen=True)
class ShellStart:
    """One command, several times."""

    what: str
    seconds: Repeats  # s, from start to exit
    cpu_s: float  # s of all cores, the least
    peak_mb: float  # MB, resident, the most


def measure(seconds: float) -> tuple[ShellStart, ...]:
    """`ravenjax run` with an empty cache, again, and with other values of the same form; and what
    lists campaigns.

    In rounds, each with a cache of its own, as many as fit into `seconds`; one at least. Raises
    RuntimeError for a command that fails.
    """
    return _rounds(seconds, commands)


def measure_large(
    seconds: float, runs: int = LARGE_RUNS, duration_s: float = LARGE_S, *more: str
) -> tuple[ShellStart, ...]:
    """The same for a campaign of a million ten-second runs, which a GPU takes seconds for.

    more: further words of the command line.
    """

    def listed(place: Path) -> list[tuple[str, tuple[str, ...]]]:
        file = place / "large.toml"
        file.write_text(
            LARGE.format(runs=runs, duration_s=duration_s, last_ms=round(duration_s * 1000) - 1)
        )
        what = f"run of {runs:,} runs of {duration_s:g} s"
        return [
            (
                f"{what}{case}",
                (
                    "run",
                    str(file),
                    "--no-report",
                    "--out",
                    str(place / f"large{number}"),
                    *words,
                    *more,
                ),
            )
            for number, (case, words) in enumerate(((NOTHING, ()), (OTHERS, OTHER_VALUES)))
        ]

    return _rounds(seconds, listed)


def commands(place: Path) -> list[tuple[str, tuple[str, ...]]]:
    """What is run, and what is written after `ravenjax`; results go to `place`."""

    def run(what: str, number: int, *more: str) -> tuple[str, tuple[str, ...]]:
        return f"run {CAMPAIGN}{what}", (
            "run",
            CAMPAIGN,
            "--no-report",
            "--out",
            str(place / str(number)),
            *more,
        )

    return [
        run(NOTHING, 0),
        run(AGAIN, 1),
        run(OTHERS, 2, *OTHER_VALUES),
        ("campaigns", ("campaigns",)),
        ("--help", ("--help",)),
    ]


def timed_command(place: Path, *tokens: str, root: Path = ROOT) -> tuple[float, float, float]:
    """s, CPU s and peak MB of `ravenjax` of the package in `root` with these words; its cache is
    in `place`.
    """
    variables = environment(root) | {compile_cache.VARIABLE: str(place / "cache")}
    words, command = place / "words", [sys.executable, "-m", "ravenjax.cli", *tokens]
    launcher = [sys.executable, "-S", "-c", _LAUNCHER, str(words), *command]
    answer = subprocess.run(
        launcher, env=variables, cwd=place, capture_output=True, text=True, check=True
    )
    seconds, code, cpu, peak = json.loads(answer.stdout)
    if code:
        raise RuntimeError(
            f"ravenjax {' '.join(tokens)}: exit code {code}: {text.last_line(words.read_text())}"
        )
    return seconds, cpu, peak * _UNIT / 1e6


def environment(root: Path) -> dict[str, str]:
    """Variables with which Python takes the package in `root`, and not one in a folder where it
    happens to start.
    """
    return dict(os.environ) | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(root), os.environ.get("PYTHONPATH")]))
    }


def _rounds(
    seconds: float, listed: Callable[[Path], list[tuple[str, tuple[str, ...]]]]
) -> tuple[ShellStart, ...]:
    times: dict[str, list[tuple[float, float, float]]] = {}

    def once() -> None:
        with tempfile.TemporaryDirectory() as folder:
            for what, tokens in listed(Path(folder)):
                times.setdefault(what, []).append(timed_command(Path(folder), *tokens))

    scaling.rounds(once, seconds, ROUNDS)
    return tuple(
        ShellStart(
            f"ravenjax {what}",
            Repeats(tuple(s for s, _, _ in some)),
            min(c for _, c, _ in some),
            max(m for _, _, m in some),
        )
        for what, some in times.items()
    )
