"""Reads a session's recording from its folder: rows by name, events, header."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ravenjax.errors import StoreError
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.protocol.frame import FrameLayout
from ravenjax.train.robot import ARMS


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Recording(session_log.SessionLog):
    """The recording of a session."""

    layout: FrameLayout

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a channel over time: [T] or [T, k]."""
        values = self.rows[:, self.layout.places[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    @cached_property
    def ms(self) -> np.ndarray:
        """Time of each row in ms since the session began, [T]."""
        return self["session_tick"].astype(float)

    def without_pauses(self) -> Recording:
        """Return the recording without the rows in which the session's time stood still."""
        runs = np.diff(self.ms, append=self.ms[-1:] + 1) > 0
        return dataclasses.replace(self, rows=self.rows[runs], numbers=self.numbers[runs])

    def worst(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """Return the greatest of the arms' values [T]. The value of a vector is its length."""
        channels = [self[f"{arm}/{name}"] for arm in arms]
        sizes = [np.linalg.norm(one, axis=1) if one.ndim > 1 else one for one in channels]
        return np.max(sizes, axis=0)


def find_recording(folder: Path) -> Path | None:
    """Return the recording of a session's folder, preferably the recovered one, or None."""
    own = Path(folder) / session_log.FILE
    return next((file for file in (mcap_records.recovered_path(own), own) if file.exists()), None)


def read_recording(path: Path) -> Recording:
    """Read a recording, complete or cut short, from a file or a session's folder.

    Raises StoreError if the folder has no recording, or its channels are those of another version.
    """
    path = Path(path)
    if path.is_dir():
        if (file := find_recording(path)) is None:
            raise StoreError(
                f"{path} has no {session_log.FILE}; give the folder of a session that was recorded"
            )
        path = file
    log = session_log.read_session_log(path)
    layout = FrameLayout.of([arm for arm in ARMS if f"{arm}/jpos/0" in log.names])
    if layout.names() != log.names:
        raise StoreError(
            f"{path} was recorded with other channels; read it with the version of ravenjax that"
            " session.json names"
        )
    return Recording(**vars(log), layout=layout)
