"""Defines the generated motions of the studies of the training simulator (IROS 2016). The recorded
motion of the paper is not available.
"""

import re
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from studies.study import StudyEstimate, Variant

MOTIONS = (
    *((kind, seed) for kind in ("suture", "peg_transfer", "palpate", "reach") for seed in (1, 2)),
    ("circle", 1),
)
"""Kind and seed of each generated motion in which the pedal is always down and the hand moves."""
MODELLED = "as modelled"
"""The setting of variants that change only the motion."""


def settings_of(variants: Iterable[Variant]) -> Iterator[tuple[str, dict[str, str | int]]]:
    """Yield the name of each variant with its setting and the kind and seed of its motion. A name
    is KIND_SEED, or KIND_SEED_SETTING with underscores for spaces, except in names of the sets
    matlab_*.
    """
    for one in variants:
        kind, seed, setting = re.fullmatch(r"(\D+)_(\d+)_?(.*)", one.name).groups()
        words = re.sub("(?<!matlab)_", " ", setting) or MODELLED
        yield one.name, {"setting": words, "kind": kind, "seed": int(seed)}


def over_kinds(values: pd.Series) -> StudyEstimate:
    """Return the mean over kinds of motion, the independent units, with its t interval. `values`:
    by kind and seed.
    """
    from scipy import stats

    means = values.groupby(level=0, sort=False).mean().to_numpy()
    mean, n, of = float(means.mean()), len(means), f"kinds of motion ({len(values)} motions)"
    if n < 2:
        return StudyEstimate(mean, n=n, of=of)
    half = float(stats.t.ppf(0.975, n - 1) * means.std(ddof=1) / np.sqrt(n))
    return StudyEstimate(mean, mean - half, mean + half, n, of)
