"""Processes beside the realtime loop: how one is started, awaited, and told to have ended."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError
from ravenjax.trainer.realtime import clock

STARTING_S = 60.0
"""Longest that page and recorder may take to be there."""


def spawn(stack: contextlib.ExitStack, target: Callable[[Any], None], given: Any) -> BaseProcess:
    """A process of its own, never a fork: jax does not survive one."""
    process = multiprocessing.get_context("spawn").Process(target=target, args=(given,), daemon=True)
    process.start()
    if process.pid is not None and (cpus := clock.other_cpus()):
        os.sched_setaffinity(process.pid, cpus)

    def end() -> None:
        process.terminate()
        process.join(5.0)
        if process.is_alive():
            process.kill()

    stack.callback(end)
    return process


def wait_for(recording: BaseProcess, path: Path) -> None:
    """Until the recorder has made its file. UserError where it ends or takes longer than STARTING_S."""
    end = time.monotonic() + STARTING_S
    while not path.exists():
        if not recording.is_alive() or time.monotonic() > end:
            raise UserError(f"{path.parent}: the recorder did not start (exit code {recording.exitcode})")
        time.sleep(0.02)


def ended(recording: BaseProcess) -> str | None:
    """What to tell where the recorder has ended before the session."""
    if recording.is_alive() or recording.exitcode == 0:
        return None
    return f"the recorder has ended (exit code {recording.exitcode}): the session goes on unrecorded"
