"""Defines kinds of faults: the independent units of every study that pools faults.

A kind is a hazard of the library with all its cases, or a group of a campaign. Faults of one kind
resemble each other, because they act on the same signal with the same effect. Strata are families
of kinds, given by the prefix of the group name: library/, sampled/, boundary/.
"""

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ravenjax.hazards.naming import hazards_of, kind_of
from ravenjax.report import wording
from ravenjax.stats.intervals import Estimate
from ravenjax.stats.paired import difference_of_counts
from ravenjax.stats.units import ENOUGH_UNITS, MIN_UNITS, Units, group_units, ratio_band

NOTE = (
    "Intervals are 95 % confidence intervals from a bootstrap over kinds of faults. A kind is a"
    " hazard of the library with all its cases, or a group of the campaign. Families of groups are"
    f" resampled separately. With fewer than {MIN_UNITS} kinds there is no interval, and with fewer"
    f" than {ENOUGH_UNITS} kinds (marked *few*) the interval is too narrow. A share describes the"
    " faults of this design. It is not a probability, and other faults would give another share."
)


def names(group: ArrayLike) -> np.ndarray:
    """Return the kind of each fault by its group's name, words [faults]."""
    return np.asarray(pd.Categorical(group).map(kind_of), object)


def families(group: ArrayLike) -> np.ndarray:
    """Return the family of each fault by its group's name, words [faults]; or "" without one."""

    def family(name: str) -> str:
        return "library" if hazards_of(name) else name.rpartition("/")[0]

    return np.asarray(pd.Categorical(group).map(family), object)


def of(group: ArrayLike) -> Units:
    """Return kinds and families of faults as units and strata."""
    return group_units(names(group), families(group))


def difference(first: np.ndarray, second: np.ndarray, among: Units) -> Estimate:
    """Return the rate of `first` minus the rate of `second` (bool [pairs]) with its interval over
    kinds. If no pair differs, the interval is that of Bonett and Price with a pair for each kind.
    """
    if not len(first):
        return Estimate(math.nan, math.nan, math.nan)
    if among.count >= MIN_UNITS and (first == second).all():
        return difference_of_counts(0, 0, among.count)
    return ratio_band(first.astype(float) - second, 1.0, among)


def count(among: Units) -> str:
    """Write 52 kinds; 7 kinds, few."""
    words = wording.count_noun(among.count, "kind")
    return f"{words}, few" if among.count < ENOUGH_UNITS else words
