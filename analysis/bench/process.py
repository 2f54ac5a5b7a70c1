"""Runs commands and functions in a separate process, and measures their time and peak memory."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
"""Folder of the package that runs."""
# ru_maxrss starts with the memory of the forking process, so a small process starts the command.
_LAUNCHER = """
import json, os, subprocess, sys, time
begin = time.perf_counter()
process = subprocess.Popen(sys.argv[1:])
_, status, usage = os.wait4(process.pid, 0)
figures = os.waitstatus_to_exitcode(status), time.perf_counter() - begin
figures += usage.ru_utime + usage.ru_stime, usage.ru_maxrss
print("\\n" + json.dumps(figures), file=sys.stderr)
"""
_CALL = """
import importlib, json, os, sys
answer = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
module, name, arguments = json.loads(sys.argv[1])
json.dump(getattr(importlib.import_module(module), name)(*arguments), answer)
"""


class Finished(NamedTuple):
    """A command that ended without an error."""

    output: str
    seconds: float  # from start to exit
    cpu_s: float  # over all cores
    peak_mb: float  # resident


def run_command(
    command: Sequence[str],
    environment: Mapping[str, str],
    limit_s: float | None = None,
    folder: Path | None = None,
    root: Path = ROOT,
) -> Finished:
    """Run a command with the package in `root`, and end it with all its child processes.

    `environment`: further variables. Raises RuntimeError, with a message of one line, for a command
    that fails or takes longer than `limit_s` seconds.
    """
    path = os.pathsep.join(
        filter(None, [str(root), str(root / "analysis"), os.environ.get("PYTHONPATH")])
    )
    process = subprocess.Popen(
        [sys.executable, "-S", "-c", _LAUNCHER, *command],
        env={**os.environ, "PYTHONPATH": path, **environment},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        output, errors = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"not finished within {limit_s:.0f} s") from None
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    *errors, figures = errors.strip().splitlines()
    code, seconds, cpu_s, peak = json.loads(figures)
    if code:
        lines = [line.strip() for line in errors if line.strip()] or ["it said nothing"]
        ending = f"exit code {code}" if code > 0 else f"ended by {signal.Signals(-code).name}"
        # Compilers write pages.
        raise RuntimeError(f"{ending}: {lines[-1]}"[:300])
    unit = 1024 if sys.platform == "linux" else 1
    return Finished(output, seconds, cpu_s, peak * unit / 1e6)


def call(
    function: Callable[..., Any],
    *arguments: Any,
    environment: Mapping[str, str],
    limit_s: float | None = None,
) -> tuple[Any, float]:
    """Return (result of a module's function, peak memory in MB); both it and its arguments are
    passed as JSON. Raises RuntimeError as `run_command` does.
    """
    what = json.dumps([function.__module__, function.__qualname__, arguments])
    done = run_command([sys.executable, "-c", _CALL, what], environment, limit_s)
    return json.loads(done.output), done.peak_mb
