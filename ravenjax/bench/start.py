"""Whole commands from the shell, each in a process of its own: what a user waits for."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from ravenjax.campaign import compile_cache

CAMPAIGN, OTHER_VALUES = "quick", ("--set", "campaign.seed=7")
"""A bundled campaign, and what draws other values for faults and parameters of the same form."""
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
"""Starts a command from a small process: the memory of the one that starts it counts as the command's."""


@dataclasses.dataclass(frozen=True)
class ShellStart:
    """One command."""

    what: str
    seconds: float  # s, from start to exit
    cpu_s: float  # s of all cores
    peak_mb: float  # MB, resident


def measure() -> tuple[ShellStart, ...]:
    """`ravenjax run` with an empty cache, again, and with other values of the same form; and what lists campaigns.

    Raises RuntimeError for a command that fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)

        def run(what: str, number: int, *more: str) -> ShellStart:
            return _timed(what, place, "run", CAMPAIGN, "--no-report", "--out", str(place / str(number)), *more)

        return (
            run(f"run {CAMPAIGN}, nothing cached", 0),
            run(f"run {CAMPAIGN} again", 1),
            run(f"run {CAMPAIGN} with other values", 2, *OTHER_VALUES),
            _timed("campaigns", place, "campaigns"),
            _timed("--help", place, "--help"),
        )


def _timed(what: str, place: Path, *tokens: str) -> ShellStart:
    environment = os.environ | {compile_cache.VARIABLE: str(place / "cache")}
    words, command = place / "words", [sys.executable, "-m", "ravenjax.cli", *tokens]
    launcher = [sys.executable, "-S", "-c", _LAUNCHER, str(words), *command]
    answer = subprocess.run(launcher, env=environment, capture_output=True, text=True, check=True)
    seconds, code, cpu, peak = json.loads(answer.stdout)
    if code:
        raise RuntimeError(f"ravenjax {' '.join(tokens)}: exit code {code}: {words.read_text()}")
    return ShellStart(f"ravenjax {what}", seconds, cpu, peak * _UNIT / 1e6)
