"""The result table of one variant of the targeted attacks as its study counts it: one row a
faulty run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.campaign import plan
from ravenjax.campaign.file.config import CampaignConfig, validated
from ravenjax.store import manifest
from ravenjax.store.folder import read_all
from studies.dsn16 import cells, packet_ticks, trajectory
from studies.dsn16.cells import CellShares
from studies.dsn16.packet_ticks import PacketTicks
from studies.dsn16.trajectory import Lever


@dataclasses.dataclass(frozen=True, eq=False)
class VariantRuns:
    """One variant; arrays have one entry a faulty run."""

    name: str
    config: CampaignConfig
    lever: Lever  # over the packets at which faults start
    index: np.ndarray  # row of the campaign
    value: np.ndarray  # DAC counts, or displacement in um
    duration: np.ndarray  # packets
    start: np.ndarray  # packet
    jump_packet: np.ndarray  # that ends the first jump's second long step, 0: none
    hits: Mapping[
        str, np.ndarray
    ]  # bool: jump, inside (the published window), stop, ik, missed (jump without a stop)

    def counting(self, **hits: np.ndarray) -> VariantRuns:
        """The same runs with more to count."""
        return dataclasses.replace(self, hits={**self.hits, **hits})

    def share(self, hit: str) -> CellShares:
        """Share of runs with `hit` in each cell."""
        return cells.means(self.value, self.duration, self.hits[hit])

    def percent(self, hit: str) -> np.ndarray:
        """Of the cells of each duration, in its order."""
        return 100.0 * self.share(hit).shares.mean(axis=0)


def read(name: str, folder: Path) -> VariantRuns:
    """The runs of a finished folder."""
    config = validated(manifest.read(folder).config)
    return of(name, config, read_all(folder), packet_ticks.of(plan.make(config)))


def of(name: str, config: CampaignConfig, table: pd.DataFrame, packets: PacketTicks) -> VariantRuns:
    """The valid faulty rows of a result table. A displacement's value is the group's (its slots
    hold shares of it).
    """
    columns = {str(column): table[column].to_numpy() for column in table.columns}
    has_fault, valid = columns["fault0_site"] != "", columns["failed"] == ""
    faulty = np.flatnonzero(has_fault & valid)
    rows = faulty[np.argsort(columns["index"][faulty])]
    rejected = columns["check_ik_reject_count"]
    free = rejected[~has_fault & valid].max(initial=0)
    start, duration = columns["fault0_start_ms"][rows], columns["fault0_duration_ms"][rows]
    index, jump = columns["index"][rows], columns["jump_code"][rows].astype(bool)
    ended = packets.packet(index, columns["jump_code_first_ms"][rows])
    stop = columns["response"][rows] == "stopped"
    value = [
        _displacement(g, v)
        for g, v in zip(columns["group"][rows], columns["fault0_value"][rows], strict=True)
    ]
    return VariantRuns(
        name=name,
        config=config,
        lever=trajectory.lever(config, np.unique(packets.motion_row(index, start))),
        index=index,
        value=np.array(value),
        duration=duration,
        start=start,
        jump_packet=ended,
        hits={
            "jump": jump,
            "inside": cells.inside(ended, start, duration),
            "stop": np.asarray(stop, bool),
            "ik": rejected[rows] > free,
            "missed": jump & ~np.asarray(stop, bool),
        },
    )


def _displacement(group: str, value: float) -> float:
    return float(group[1:]) if group[:1] == "d" and group[1:].isdecimal() else float(value)


def stored(value: float, words: str = "wrap") -> int:
    """What is left of an added DAC value where it is stored, without the small nominal command."""
    whole = int(value)
    if words == "wrap":
        return (whole + 32768) % 65536 - 32768
    return max(-32768, min(32767, whole)) if words == "saturate" else whole
