"""Orders the fault table of a campaign that may stop early, so that the first rows of each group
are a sample of it.

A draw is one point of a group's design. Its repeats and crossed variants have the same fault; their
rows are adjacent, are computed together and count once. Draws of a random, lhs or sobol design keep
their order, because their first draws are a sample. Draws of a grid, zip or list are shuffled by
the campaign's seed, because their first draws would be a corner of the design. Run ids do not
depend on the order.
"""

import math
import zlib

import numpy as np
import pandas as pd

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Group


def arrange_table(config: CampaignConfig, table: pd.DataFrame) -> pd.DataFrame:
    """Return the whole fault table in that order, `index` and `pair` renumbered."""
    order = np.arange(len(table))
    pair = table["pair"].to_numpy()
    first_of_kind = pair == order
    sizes = table["group"].array.value_counts()
    start = 0
    for group in config.group:
        rows = order[start : start + sizes[group.name]]
        # Consecutive number, from 0, of each row that is the first of its kind.
        kind = np.cumsum(first_of_kind[rows]) - 1
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
    return table.take(order).reset_index(drop=True).assign(**numbers)


def rows_of_a_draw(config: CampaignConfig, group: Group) -> int:
    """Return the number of rows of each draw of a group."""
    return group.repeats * math.prod(
        len(axis.values) for axis in {**config.cross, **group.cross}.values()
    )


def _places(config: CampaignConfig, group: Group, number: int) -> np.ndarray:
    if group.design in SAMPLED:
        return np.arange(number)
    return np.random.default_rng(
        [config.campaign.seed, zlib.crc32(group.name.encode()), 1]
    ).permutation(number)
