"""What a recording holds, before anything is done to it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTrack:
    """One arm's samples; rows of a file may be fewer for one arm than for the other."""

    time_s: (
        np.ndarray | None
    )  # [T] s, on a clock that both arms share; None where the file has no times
    position: np.ndarray  # [T, 3] m, tip in frame 0
    quat: np.ndarray | None  # [T, 4] x, y, z, w, tip in frame 0
    opening_mrad: np.ndarray | None  # [T] positive opens

    def __len__(self) -> int:
        return len(self.position)


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """A whole recording."""

    path: Path
    clock: str  # where its times come from, "" where it has none
    arms: dict[str, ArmTrack]
    surgeon_mode: np.ndarray | None  # [T] 0 or 1, at the times of the first arm
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...] = ()  # what else a reader should know
