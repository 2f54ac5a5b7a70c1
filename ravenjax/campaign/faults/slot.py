"""The columns of one fault slot over many runs, in canonical form: equal faults have equal columns.

What an effect does not use is NaN or 0, an effect of the network names the channel that it acts on,
times are whole and possible, and a value that is drawn for whole numbers is one.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import UNTIL_END, Fault
from ravenjax.vocabulary import legal as legal_values
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS, TRIGGERS, WITHOUT_VALUE
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import Site


@functools.cache
def words_of(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Columns of words, and the words that each may hold, first that of an empty slot."""
    channels = dict.fromkeys(
        channel.name for site in robot.sites.values() for channel in site.channels
    )
    return {
        "site": ("", *robot.sites),
        "arm": ("", *robot.arms),
        "channel": ("", *channels),
        "effect": ("", *EFFECTS),
        "trigger": ("", *TRIGGERS),
    }


NUMBERS: dict[str, tuple[type[np.number], float]] = {
    "value": (np.float64, math.nan),
    "start_ms": (np.int32, 0),
    "duration_ms": (np.int32, 0),
    "every_ms": (np.int32, 0),
    "period_ms": (np.int32, 0),
}
"""Columns of numbers: their type, and what an empty slot holds."""

FIELDS = (
    "site",
    "arm",
    "channel",
    "effect",
    "value",
    "trigger",
    "start_ms",
    "duration_ms",
    "every_ms",
    "period_ms",
)
"""Columns of a slot in order, each prefixed with fault0_, fault1_, ..."""


class _Codes:
    """Words of a robot as their places in `words_of`."""

    def __init__(self, robot: Robot) -> None:
        self.words = words_of(robot)
        self.code = {
            column: {word: code for code, word in enumerate(words)}
            for column, words in self.words.items()
        }
        acts = [
            NETWORK_EFFECTS[name].channel if name in NETWORK_EFFECTS else ""
            for name in self.words["effect"]
        ]
        # the channel that an effect of the network acts on, 0 for other effects; by the effect's
        # place
        self.channel_of_effect = np.array(
            [self.code["channel"].get(channel, 0) for channel in acts], np.int8
        )
        self.valueless = np.isin(self.words["effect"], WITHOUT_VALUE)

    def of(self, field: str, axis: Axis) -> np.ndarray:
        """Places of an axis's words."""
        return np.array([self.code[field][word] for word in axis.values], np.int8)


_codes = functools.cache(_Codes)


class Slot(NamedTuple):
    """A fault slot over the runs of a sample."""

    columns: dict[
        str, np.ndarray
    ]  # FIELDS -> [runs], or [] where all runs agree; words as their places in `words_of`
    complaint: (
        tuple[int, str] | None
    )  # the first run with a value that its channel cannot take, and what to say of it


def slot(
    robot: Robot,
    fault: Fault,
    axes: Mapping[str, Axis],
    places: Mapping[str, np.ndarray],
    beyond: bool = False,
) -> Slot:
    """The columns of `fault`: `axes` of its fields but the site, and the runs' places on them.

    beyond: values that a word does not hold are meant, see `CampaignConfig.says_beyond`.
    """
    codes, site = _codes(robot), robot.sites[fault.site]
    word = {
        name: codes.of(name, axes[name])[places[name]] for name in codes.words if name != "site"
    }
    effect = word["effect"]
    acts = codes.channel_of_effect[effect]
    word["channel"] = np.where(acts > 0, acts, word["channel"])
    value, complaint = _values(codes, site, axes, places["value"], word["channel"], effect, beyond)
    columns = {"site": np.int8(codes.code["site"][fault.site]), **word, "value": value}
    periodic = effect == codes.code["effect"]["periodic"]
    for name in ("start_ms", "duration_ms", "every_ms", "period_ms"):
        columns[name] = _times(
            name, axes[name].at(places[name], whole=True), axes[name], periodic
        ).astype(np.int32)
    return Slot({name: columns[name] for name in FIELDS}, complaint)


def _times(name: str, drawn: np.ndarray, axis: Axis, periodic: np.ndarray) -> np.ndarray:
    """Times as they can be; UNTIL_END only where it stands on the axis, for a number that is
    drawn never means it.
    """
    if name == "period_ms":
        return np.where(periodic, np.maximum(drawn, 1), 0)
    if name != "duration_ms":
        return np.maximum(drawn, 0)
    endless = (drawn == UNTIL_END) & (UNTIL_END in axis.listed)
    return np.where(endless, UNTIL_END, np.maximum(drawn, 1))


def _values(
    codes: _Codes,
    site: Site,
    axes: Mapping[str, Axis],
    places: np.ndarray,
    channel: np.ndarray,
    effect: np.ndarray,
    beyond: bool,
) -> tuple[np.ndarray, tuple[int, str] | None]:
    """The values, and the first that its channel cannot take, as `Slot.complaint`."""
    axis = axes["value"]
    low, high, whole, rounded = (
        column[channel, effect] for column in _legal(codes, site, axes["effect"].listed, beyond)
    )
    value = (
        axis.at(places)
        if axis.listed
        else np.where(rounded, axis.at(places, whole=True), axis.at(places))
    )
    value = np.where(codes.valueless[effect], np.nan, value)
    bad = np.ravel(
        (value < low) | (value > high) | (whole & (value != np.floor(value)) & ~np.isnan(value))
    )
    row = int(np.argmax(bad))
    if not bad[row]:
        return value, None
    at = (np.broadcast_to(column, bad.shape)[row] for column in (channel, effect))
    channel_name, effect_name = (
        codes.words[field][code] for field, code in zip(("channel", "effect"), at, strict=True)
    )
    at_value = float(np.ravel(value)[row])
    return value, (
        row,
        legal_values.complaint(site, site.channel(channel_name), effect_name, at_value, beyond),
    )


def _legal(codes: _Codes, site: Site, effects: Sequence[str], beyond: bool) -> list[np.ndarray]:
    """The fields of Legal, each [channel, effect] by their places; other than these all is
    legal.
    """
    shape = len(codes.words["channel"]), len(codes.words["effect"])
    columns = [np.full(shape, default) for default in legal_values.Legal()]
    for channel, effect in itertools.product(site.channels, effects):
        at = codes.code["channel"][channel.name], codes.code["effect"][effect]
        for column, value in zip(columns, legal_values.legal(channel, effect, beyond), strict=True):
            column[at] = value
    return columns
