"""A session read back from its folder: rows by names, events, header."""

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
    """What a session wrote."""

    layout: FrameLayout
    numbers: np.ndarray  # int64 [T], number of each row: gaps where rows were lost
    rows: np.ndarray  # float32 [T, layout.size]
    events: list[dict[str, Any]]
    header: dict[str, Any]  # as the session began
    complete: bool  # closed by its recorder, not cut short
    lost_bytes: int

    def __getitem__(self, name: str) -> np.ndarray:
        """A channel over time: [T] or [T, k]."""
        place = self.layout.places[name]
        values = self.rows[:, place]
        return values[:, 0] if place.stop - place.start == 1 else values


def find(folder: Path) -> Path | None:
    """The recording of a session's folder: its own or its recovered one; None where there is
    none.
    """
    own = Path(folder) / session_log.FILE
    saved = mcap_records.recovered_path(own)
    return saved if saved.exists() else own if own.exists() else None


def read(path: Path) -> Recording:
    """A recording, whole or cut short: a file, or the folder of a session. StoreError where
    there is none.
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
