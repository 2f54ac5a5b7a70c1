"""A run as the published logs hold it: a row a packet, not a millisecond, the first cycle of each.

Where packets end with a software E-stop, so does the log.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from studies.dsn16.signals import Series


class Log(NamedTuple):
    """One run, a row a packet."""

    packet: np.ndarray  # [rows] number of each
    mpos: np.ndarray  # [rows, 3] rad, as the control software has it
    mvel: np.ndarray  # [rows, 3] rad/s
    jpos: np.ndarray  # [rows, 3] rad, rad, m
    tip: np.ndarray  # [rows, 3] um, whole
    joints: np.ndarray  # [rows, 7] rad and m, all of them


def log(series: Series) -> Log:
    """Of the gold arm's time series."""
    number = np.asarray(series["last_seq"])
    fresh = np.flatnonzero(np.diff(number, prepend=0))
    return Log(
        packet=number[fresh],
        mpos=series["gold/mpos"][fresh, :3],
        mvel=series["gold/mvel"][fresh, :3],
        jpos=series["gold/jpos"][fresh, :3],
        tip=np.rint(series["gold/position"][fresh] * 1e6),
        joints=series["gold/jpos"][fresh],
    )
