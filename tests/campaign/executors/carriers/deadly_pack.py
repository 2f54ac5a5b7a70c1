"""What a worker is given to pack chunks with, and dies of or stops at. Imported by worker
processes.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ravenjax.store import parts, schema


def pack(
    columns: Mapping[str, Any], shape: schema.Shape, dies: Mapping[int, int], notes: Path, way: str
) -> Any:
    """As the runner's into tables, but the chunk that begins with row r kills its worker the
    first `dies[r]` times.
    """
    _die(columns, dies, notes, way)
    return schema.conform(columns, shape)


def encode(
    columns: Mapping[str, Any],
    shape: schema.Shape,
    config_hash: str,
    dies: Mapping[int, int],
    notes: Path,
    way: str = "killed",
) -> Any:
    """As the runner's into files; see `pack`."""
    _die(columns, dies, notes, way)
    return parts.encode(columns, shape, config_hash)


def _die(columns: Mapping[str, Any], dies: Mapping[int, int], notes: Path, way: str) -> None:
    first = int(columns["index"][0])
    note = notes / f"{first}"
    seen = len(note.read_bytes()) if note.exists() else 0
    note.write_bytes(b"x" * (seen + 1))
    if seen < dies.get(first, 0):
        if way == "raises":
            raise MemoryError("no memory left")
        os.kill(os.getpid(), signal.SIGSTOP if way == "stopped" else signal.SIGKILL)
