"""The fault table of a campaign that may stop early: what is computed of a group is the beginning
of its rows.

A draw is one place of a group's design. Its repeats and crossed variants are the same fault again:
their rows stand together, are computed together and count once. Draws of a
random, lhs or sobol design keep their order, as their beginnings are samples. Draws of a grid, zip
or list are shuffled by the campaign's seed, as their beginnings are corners. Run ids do not depend
on the order.
"""

from __future__ import annotations

import math
import zlib

import numpy as np

from ravenjax.campaign.faults.fault_table import FaultTable
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Group


def arranged(config: CampaignConfig, table: FaultTable) -> FaultTable:
    """The whole fault table in that order, group by group; `index` and `pair` are renumbered."""
    order = np.arange(len(table))
    pair = table.numbers("pair")
    first_of_kind = pair == order
    sizes = table.words("group").value_counts()
    start = 0
    for group in config.group:
        rows = order[start : start + sizes[group.name]]
        kind = (
            np.cumsum(first_of_kind[rows]) - 1
        )  # of each row that is the first of its kind, which one it is
        draw = kind[pair[rows] - start] // group.repeats
        number = len(rows) // rows_of_a_draw(config, group)
        order[rows] = rows[np.argsort(_places(config, group, number)[draw], kind="stable")]
        start += len(rows)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    numbers = {
        "index": np.arange(len(order), dtype=np.int32),
        "pair": place[pair[order]].astype(np.int32),
    }
    return table.take(order).replaced(**numbers)


def rows_of_a_draw(config: CampaignConfig, group: Group) -> int:
    """How many rows each draw of a group has."""
    return group.repeats * math.prod(
        len(axis.values) for axis in {**config.cross, **group.cross}.values()
    )


def _places(config: CampaignConfig, group: Group, number: int) -> np.ndarray:
    """At which place each draw of a group stands, int64 [number]."""
    if group.design in SAMPLED:
        return np.arange(number)
    return np.random.default_rng(
        [config.campaign.seed, zlib.crc32(group.name.encode()), 1]
    ).permutation(number)
