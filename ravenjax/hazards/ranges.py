"""Reads the normal range of each fault channel, measured in fault-free runs.

`data/normal_ranges.csv` contains the ranges. They come from runs of every generated motion at
teleoperation scales 0.05 and 0.1, in which no check trips (`analysis/normal_ranges/measure.py`).
"""

import csv
from functools import cache
from typing import NamedTuple

from ravenjax.errors import UserError
from ravenjax.hazards.library import DATA
from ravenjax.robots.raven2.declaration import SITES

FILE = "normal_ranges.csv"


class ChannelRange(NamedTuple):
    """Range of one channel over all fault-free runs, in the channel's unit."""

    site: str
    arm: str  # "" if the site belongs to no arm
    channel: str
    unit: str
    low: float
    low_permille: float  # 0.1 % of the ticks were below
    high_permille: float  # 0.1 % of the ticks were above
    high: float
    ticks: float  # number of ticks that were measured


@cache
def measured_ranges() -> dict[tuple[str, str, str], ChannelRange]:
    """Return (site, arm, channel) -> range."""
    text = (DATA / FILE).read_text(encoding="utf-8")
    _, *rows = csv.reader(text.splitlines())
    return {
        (site, arm, channel): ChannelRange(site, arm, channel, unit, *map(float, numbers))
        for site, arm, channel, unit, *numbers in rows
    }


def normal_range(site: str, channel: str, arm: str) -> ChannelRange:
    """Return a channel's normal range. `arm` is used only for sites that each arm has.

    Raise UserError for a channel without a known range.
    """
    key = site, arm if site in SITES and SITES[site].per_arm else "", channel
    if key not in measured_ranges():
        place = f"channel {channel!r} at site {site!r}, arm {arm!r}"
        remedy = "`ravenjax faults` lists all channels"
        raise UserError(f"the normal range of {place} is unknown; {remedy}")
    return measured_ranges()[key]
