"""Reads a session's recording from its folder: rows by name, events, header."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import StoreError
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.protocol.frame import FrameLayout
from ravenjax.train.robot import ArmName


@dataclass(frozen=True, eq=False)
class Recording:
    """The recording of a session."""

    layout: FrameLayout
    # int64 [T], number of each row, with gaps where rows were lost.
    numbers: np.ndarray
    rows: np.ndarray  # float32 [T, layout.size]
    events: list[dict[str, Any]]
    header: dict[str, Any]  # at the session's beginning
    complete: bool  # whether the recorder closed it
    lost_bytes: int

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a channel over time: [T] or [T, k]."""
        place = self.layout.places[name]
        values = self.rows[:, place]
        return values[:, 0] if place.stop - place.start == 1 else values


def find(folder: Path) -> Path | None:
    """Return the recording of a session's folder, preferably the recovered one, or None."""
    own = Path(folder) / session_log.FILE
    saved = mcap_records.recovered_path(own)
    return saved if saved.exists() else own if own.exists() else None


def read(path: Path) -> Recording:
    """Read a recording, complete or cut short, from a file or a session's folder.

    Raises StoreError if there is none.
    """
    path = Path(path)
    if path.is_dir():
        file = find(path)
        if file is None:
            raise StoreError(
                f"{path}: holds no {session_log.FILE}; give the folder of a session that was"
                " recorded"
            )
        path = file
    log = session_log.read(path)
    arms: tuple[ArmName, ...] = ("gold", "green")
    layout = FrameLayout.of([arm for arm in arms if f"{arm}/jpos/0" in log.names])
    if layout.names() != log.names:
        raise StoreError(
            f"{path}: has other channels than this version records; read it with the version that"
            " session.json names"
        )
    return Recording(
        layout, log.numbers, log.rows, log.events, log.header, log.complete, log.lost_bytes
    )
