"""Reads a session's recording from its folder: rows by name, events, header."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ravenjax.errors import StoreError
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.protocol import FrameLayout
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

    @cached_property
    def began_ms(self) -> float:
        """When the session's time began, ms; 0 if it never did."""
        starts = (event["tick"] for event in self.events if event["kind"] == "started")
        return float(next(starts, 0.0))

    def without_pauses(self) -> Recording:
        """Return the rows in which the session's time ran, from its beginning on."""
        advances = np.diff(self.ms, append=self.ms[-1:] + 1) > 0
        runs = np.flatnonzero(advances & (self.ms >= self.began_ms))
        # Without a pause this is no copy.
        whole = slice(runs[0], runs[-1] + 1) if runs[-1] - runs[0] == len(runs) - 1 else runs
        return dataclasses.replace(self, rows=self.rows[whole], numbers=self.numbers[whole])

    def worst(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """Return the greatest of the arms' values [T]. The value of a vector is its length."""
        channels = [self[f"{arm}/{name}"] for arm in arms]
        sizes = [np.linalg.norm(x, axis=1) if x.ndim > 1 else x for x in channels]
        return np.max(sizes, axis=0)


def find_recording(folder: Path) -> Path | None:
    """Return the recording of a session's folder, preferably the recovered one, or None."""
    file = Path(folder) / session_log.FILE
    return next((path for path in (mcap_records.recovered_path(file), file) if path.exists()), None)


def read_recording(path: Path, channels: Collection[str] = ()) -> Recording:
    """Read a recording, complete or cut short, from a file or a session's folder.

    channels: those to read, without their arms, such as "tip"; none: all. Raises StoreError if the
    folder has no recording, or its channels are those of another version.
    """
    path = Path(path)
    if path.is_dir():
        if (file := find_recording(path)) is None:
            raise StoreError(
                f"{path} has no {session_log.FILE}; give the folder of a session that was recorded"
            )
        path = file

    def keeps(name: str) -> bool:
        return not channels or name.rstrip("/0123456789").rpartition("/")[2] in channels

    log = session_log.read_session_log(path, keeps)
    layout = FrameLayout.of([arm for arm in ARMS if f"{arm}/jpos/0" in log.names])
    if layout.names() != log.names:
        raise StoreError(
            f"{path} was recorded with other channels; read it with the version of ravenjax that"
            " session.json names"
        )
    return Recording(**vars(log), layout=layout.of_channels(keeps))
