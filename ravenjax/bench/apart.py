"""Work in a process of its own: what it breaks, fills or pins is gone with it, and the others go
on.

A part that crashes, is ended for its memory or waits for itself for ever leaves one line that says
why.
"""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError

_UNIT = 1024 if sys.platform == "linux" else 1  # B, of the memory that the system tells
_PATIENCE_S = 5.0  # s that a process may take to end after it answered
LONGEST_WHY = 300
"""Characters of a reason; compilers write pages."""


@dataclasses.dataclass(frozen=True)
class Answer:
    """What came of work in a process of its own."""

    value: Any  # what it returned; None where it did not
    why: str  # in one line why there is no value; "" where there is
    seconds: float  # s, start of the process included
    peak_mb: float  # MB, resident, of the process alone; nan: not told


def run(
    work: Callable[..., Any],
    *arguments: Any,
    limit_s: float,
    environment: Mapping[str, str] | None = None,
) -> Answer:
    """`work(*arguments)` in a fresh process; it and all that it started are ended after `limit_s`
    seconds.

    environment: variables beside those of this process. Functions, arguments and result must be
    able to travel (`pickle`). What the process prints goes to standard error. Never raises for what
    happens inside.
    """
    context, start = multiprocessing.get_context("spawn"), time.perf_counter()
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(
        target=_inside, args=(theirs, dict(environment or {}), work, arguments)
    )
    value, why, peak_mb = None, "", float("nan")
    try:
        process.start()
        theirs.close()
        if ours.poll(limit_s):
            value, why, peak_mb = ours.recv()
            process.join(_PATIENCE_S)
        else:
            why = f"not finished within {limit_s:.0f} s"
    except EOFError:  # it ended without an answer
        process.join(_PATIENCE_S)
        why = ending(process.exitcode)
    except Exception as error:  # a result that does not travel
        why = one_line(error)
    finally:
        _end(process)
        ours.close()
    return Answer(value, why, time.perf_counter() - start, peak_mb)


def ending(code: int | None) -> str:
    """How a process ended that left no answer, in words."""
    if code is None:
        return "its process closed its answer and went on"
    if code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
        memory = ", as the system does where memory is short" if -code == signal.SIGKILL else ""
        return f"its process was ended by signal {name}{memory}"
    return f"its process ended with code {code} and no answer"


def one_line(error: BaseException) -> str:
    """An error in one line: what a user can mend in its own words, others with their kind."""
    text = " ".join(str(error).split())
    text = text if isinstance(error, UserError) else f"{type(error).__name__}: {text}".rstrip(": ")
    return text if len(text) <= LONGEST_WHY else f"{text[: LONGEST_WHY - 2]}.."


def _inside(
    answer: Connection, environment: Mapping[str, str], work: Callable[..., Any], arguments: Any
) -> None:
    """In the fresh process."""
    with contextlib.suppress(OSError):
        os.setsid()  # whatever it starts is ended with it
    os.dup2(2, 1)  # standard output is for tables and JSON
    os.environ.update(environment)
    value, why = None, ""
    try:
        value = work(*arguments)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        why = one_line(error)
    answer.send((value, why, _peak_mb()))
    answer.close()


def _end(process: Any) -> None:
    """End what is left of the process and of all that it started."""
    if process.pid is None:
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    if process.is_alive():
        process.kill()
    process.join()


def _peak_mb() -> float:
    """MB that this process had resident at most; of the system's two numbers the one that no
    parent adds to.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT / 1e6
