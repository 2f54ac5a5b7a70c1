"""The columns of one fault slot over many runs, in canonical form: equal faults have equal columns.

What an effect does not use is NaN or 0, an effect of the network names the channel that it acts on, times are whole and
possible, and a value that is drawn for whole numbers is one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import UNTIL_END, Fault
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.sites import SITES
from ravenjax.vocabulary import legal as legal_values
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS, TRIGGERS, WITHOUT_VALUE
from ravenjax.vocabulary.sites import Site

WORDS: dict[str, tuple[str, ...]] = {
    "site": ("", *SITES),
    "arm": ("", *ARMS),
    "channel": ("", *dict.fromkeys(channel.name for site in SITES.values() for channel in site.channels)),
    "effect": ("", *EFFECTS),
    "trigger": ("", *TRIGGERS),
}
"""Columns of words, and the words that each may hold, first that of an empty slot."""

NUMBERS: dict[str, tuple[type[np.number], float]] = {
    "value": (np.float64, math.nan),
    "start_ms": (np.int32, 0),
    "duration_ms": (np.int32, 0),
    "every_ms": (np.int32, 0),
    "period_ms": (np.int32, 0),
}
"""Columns of numbers: their type, and what an empty slot holds."""

FIELDS = ("site", "arm", "channel", "effect", "value", "trigger", "start_ms", "duration_ms", "every_ms", "period_ms")
"""Columns of a slot in order, each prefixed with fault0_, fault1_, ..."""

_CODE = {column: {word: code for code, word in enumerate(words)} for column, words in WORDS.items()}
_CHANNEL_OF_EFFECT = np.array(
    [_CODE["channel"][NETWORK_EFFECTS[effect][0]] if effect in NETWORK_EFFECTS else 0 for effect in WORDS["effect"]],
    np.int8,
)
"""The channel that an effect of the network acts on, 0 for other effects; by the effect's place in WORDS."""
_VALUELESS = np.isin(WORDS["effect"], WITHOUT_VALUE)


class Slot(NamedTuple):
    """A fault slot over the runs of a sample."""

    columns: dict[str, np.ndarray]  # FIELDS -> [runs], or [] where all runs agree; words as their places in WORDS
    wrong: tuple[int, str] | None  # the first run with a value that its channel cannot take, and what to say of it


def slot(fault: Fault, axes: Mapping[str, Axis], places: Mapping[str, np.ndarray], beyond: bool = False) -> Slot:
    """The columns of `fault`: `axes` of its fields but the site, and the runs' places on them.

    beyond: 16-bit words may be given more, see `semantics.says_beyond`.
    """
    site = SITES[fault.site]
    word = {name: _codes(name, axes[name])[places[name]] for name in WORDS if name != "site"}
    effect = word["effect"]
    word["channel"] = np.where(_CHANNEL_OF_EFFECT[effect] > 0, _CHANNEL_OF_EFFECT[effect], word["channel"])
    value, wrong = _values(site, axes, places["value"], word["channel"], effect, beyond)
    columns = {"site": np.int8(_CODE["site"][fault.site]), **word, "value": value}
    for name in ("start_ms", "duration_ms", "every_ms", "period_ms"):
        columns[name] = _times(name, axes[name].at(places[name], whole=True), axes[name], effect).astype(np.int32)
    return Slot({name: columns[name] for name in FIELDS}, wrong)


def _codes(field: str, axis: Axis) -> np.ndarray:
    """Places in WORDS of an axis's words."""
    return np.array([_CODE[field][word] for word in axis.values], np.int8)


def _times(name: str, drawn: np.ndarray, axis: Axis, effect: np.ndarray) -> np.ndarray:
    """Times as they can be; UNTIL_END only where it stands on the axis, for a number that is drawn never means it."""
    if name == "period_ms":
        return np.where(effect == _CODE["effect"]["periodic"], np.maximum(drawn, 1), 0)
    if name != "duration_ms":
        return np.maximum(drawn, 0)
    endless = (drawn == UNTIL_END) & (UNTIL_END in axis.listed)
    return np.where(endless, UNTIL_END, np.maximum(drawn, 1))


def _values(
    site: Site, axes: Mapping[str, Axis], places: np.ndarray, channel: np.ndarray, effect: np.ndarray, beyond: bool
) -> tuple[np.ndarray, tuple[int, str] | None]:
    """The values, and the first that its channel cannot take, as `Slot.wrong`."""
    axis = axes["value"]
    low, high, whole, rounded = (column[channel, effect] for column in _legal(site, axes["effect"].listed, beyond))
    value = axis.at(places) if axis.listed else np.where(rounded, axis.at(places, whole=True), axis.at(places))
    value = np.where(_VALUELESS[effect], np.nan, value)
    bad = np.ravel((value < low) | (value > high) | (whole & (value != np.floor(value)) & ~np.isnan(value)))
    row = int(np.argmax(bad))
    if not bad[row]:
        return value, None
    at = (np.broadcast_to(column, bad.shape)[row] for column in (channel, effect))
    channel_name, effect_name = (WORDS[field][code] for field, code in zip(("channel", "effect"), at, strict=True))
    at_value = float(np.ravel(value)[row])
    return value, (row, legal_values.complaint(site.name, site.channel(channel_name), effect_name, at_value, beyond))


def _legal(site: Site, effects: Sequence[str], beyond: bool) -> list[np.ndarray]:
    """The fields of Legal, each [channel, effect] by their places in WORDS; other than these all is legal."""
    shape = len(WORDS["channel"]), len(WORDS["effect"])
    columns = [np.full(shape, default) for default in legal_values.Legal()]
    for channel, effect in itertools.product(site.channels, effects):
        at = _CODE["channel"][channel.name], _CODE["effect"][effect]
        for column, value in zip(columns, legal_values.legal(channel, effect, beyond), strict=True):
            column[at] = value
    return columns
