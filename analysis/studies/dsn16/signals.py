"""Every signal of many runs of a finished campaign: one kernel that keeps them all, compiled once,
runs side by side.

`series` tells a few chosen signals of campaigns with faults; the detector needs motors, of
fault-free campaigns too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from ravenjax import threads
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.file.config import validated
from ravenjax.engines import traced
from ravenjax.engines.cpu.engine import SimdKernel
from ravenjax.engines.interface import Block
from ravenjax.robots.raven2.campaign.trace import series
from ravenjax.store import manifest

T = TypeVar("T")
Series = Mapping[str, np.ndarray]
"""Name -> [ticks] or [ticks, k], as `store.logs.time_series` names them."""


def measure(
    path: Path, measured: Callable[[int, Series], T], rows: Sequence[int] | None = None
) -> list[T]:
    """What `measured` makes of each of these rows of the result folder `path` (None: all): of its
    index and its series.

    Each run is measured at once and dropped: its signals take about 2 MB a second of it. Raises
    StoreError as `manifest.read`.
    """
    compile_cache.enable()
    ready = plan.make(validated(manifest.read(path).config))
    kernel = SimdKernel(traced.printable(ready.program), 1, compile_cache.objects(), signals=True)

    def one(row: int) -> T:
        _, signals = kernel.run_signals(Block(*ready.lanes([row], 1), None), ready.columns)
        return measured(row, series(ready.program.setup, signals))

    return threads.mapped(one, range(ready.runs) if rows is None else rows)
