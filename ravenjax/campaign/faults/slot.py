"""Computes the columns of a fault slot in a normal form, in which equal faults have equal columns.

Fields that an effect does not use are NaN or 0. A network effect determines the channel. Times are
whole numbers of at least 0. Drawn values are rounded if the channel contains integers.
"""

import functools
import itertools
import math
from collections.abc import Iterable, Mapping

import numpy as np

from ravenjax.campaign.file.axis import END, UNTIL_END, Axis
from ravenjax.campaign.file.group import Fault
from ravenjax.vocabulary import effects
from ravenjax.vocabulary.legal import legal_values
from ravenjax.vocabulary.robot import Robot


@functools.cache
def words_of(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Return the possible words of each column. The first word is that of an empty slot."""
    channels = dict.fromkeys(
        channel.name for site in robot.sites.values() for channel in site.channels
    )
    return {
        "site": ("", *robot.sites),
        "arm": ("", *robot.arms),
        "channel": ("", *channels),
        "effect": ("", *effects.EFFECTS),
        "trigger": ("", *effects.TRIGGERS),
    }


NUMBERS: dict[str, tuple[type[np.number], float]] = {
    "value": (np.float64, math.nan),
    **dict.fromkeys(effects.TIMES, (np.int32, 0)),
}
"""Columns of numbers: type, and value in an empty slot."""


def fill_slot(
    robot: Robot, fault: Fault, axes: Mapping[str, Axis], places: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the columns FIELDS of a fault, each [runs], or a scalar that applies to all runs.
    Words are stored as codes: indices in `words_of`. axes: values or distribution of each field
    except the site. places: position of each run on each axis, the index of a value or a quantile.
    """
    words, site = words_of(robot), robot.sites[fault.site]

    def codes_of(column: str, names: Iterable[str]) -> np.ndarray:
        return np.array([words[column].index(name) for name in names], np.int8)

    codes = {
        name: codes_of(name, axes[name].values)[places[name]] for name in words if name != "site"
    }
    effect = codes["effect"]
    # A network effect determines its channel, whatever the key `channel` has.
    for name in axes["effect"].listed:
        if network := effects.NETWORK_EFFECTS.get(name):
            has_effect = effect == words["effect"].index(name)
            channel = codes_of("channel", [network.channel])[0]
            codes["channel"] = np.where(has_effect, channel, codes["channel"])
    value = axes["value"].at(places["value"])
    if not axes["value"].listed:
        # Bool [channel codes, effect codes]: a drawn value is rounded to an integer.
        needs_rounding = np.zeros((len(words["channel"]), len(words["effect"])), bool)
        for channel, name in itertools.product(site.channels, axes["effect"].listed):
            row, column = words["channel"].index(channel.name), words["effect"].index(name)
            needs_rounding[row, column] = legal_values(channel, name).rounded
        rounded_value = axes["value"].at(places["value"], whole=1)
        value = np.where(needs_rounding[codes["channel"], effect], rounded_value, value)
    value = np.where(np.isin(words["effect"], effects.WITHOUT_VALUE)[effect], np.nan, value)
    has_period = np.isin(words["effect"], effects.WITH_PERIOD)[effect]
    times = {}
    for name in effects.TIMES:
        unit = fault.unit(name, robot.period_ms)
        times[name] = _fill_times(name, axes[name], places[name], has_period, unit)
    columns = {"site": codes_of("site", [fault.site])[0], **codes, "value": value, **times}
    return {name: columns[name] for name in effects.FIELDS}


def _fill_times(
    name: str, axis: Axis, places: np.ndarray, has_period: np.ndarray, step: int
) -> np.ndarray:
    # Returns the column `name` of TIMES: multiples of `step`, at least `step` for a period or a
    # duration, else at least 0. places: position of each run on the axis. has_period: whether the
    # effect has a period; otherwise the period is 0. A file has the word END where the column has
    # UNTIL_END, which is -1. A number -1 that a distribution draws does not mean END.
    drawn = axis.at(places, whole=step)
    least = step if name in ("period_ms", "duration_ms") else 0
    times = np.maximum(drawn // step * step, least)
    if name == "period_ms":
        times = np.where(has_period, times, 0)
    elif name == "duration_ms":
        times = np.where((drawn == UNTIL_END) & (END in axis.listed), UNTIL_END, times)
    return times.astype(np.int32)
