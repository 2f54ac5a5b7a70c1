"""What the cue costs where nothing is wrong: how often it pulls in fault-free motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Rate, wilson
from studies.reaction.pairs import ReactionRuns

SCALE = "param:operator.scale"
MS_PER_HOUR = 3.6e6


class FreeReactions(NamedTuple):
    """Cues of one threshold in fault-free motion at one scale."""

    motion: str
    scale: float
    threshold_mm: float
    motions: Rate  # with a cue
    first: AlarmRate  # first cues in the time up to them
    pulses: AlarmRate  # all separate pulls in all the time, interval over robots


def free(runs: ReactionRuns, thresholds_mm: tuple[float, ...]) -> list[FreeReactions]:
    """By scale and threshold, of the haptic sets in their order; failed runs are left out."""
    valid = runs.frame.loc[~runs.facts["failed"]]
    results = []
    for scale, mine in valid.groupby(SCALE):
        for cue, threshold in sorted(enumerate(thresholds_mm), key=lambda item: item[1]):
            first = mine[f"cue{cue}_first_ms"].to_numpy()
            cued = first >= 0
            live = mine["pedal_down_ms"].to_numpy()
            began = runs.end_ms - live  # the motion is live to its end, once it began
            exposed = np.where(cued, np.maximum(first - began, 0), live).sum() / MS_PER_HOUR
            results.append(
                FreeReactions(
                    str(mine["operator"].iloc[0]),
                    float(np.asarray(scale)),
                    threshold,
                    wilson(int(cued.sum()), len(cued)),
                    alarm_rate(int(cued.sum()), float(exposed)),
                    _pulses(mine[f"cue{cue}_count"].to_numpy(), live / MS_PER_HOUR),
                )
            )
    return results


def _pulses(counts: np.ndarray, hours: np.ndarray) -> AlarmRate:
    """Of runs [n], each of a robot that was drawn; the pulls of one hang together. Without any
    the exact interval.
    """
    exact = alarm_rate(int(counts.sum()), float(hours.sum()))
    if not exact.count:
        return exact
    band = units.ratio(counts, hours, units.units(np.arange(len(counts))))
    return exact._replace(low=float(band.low), high=float(band.high))
