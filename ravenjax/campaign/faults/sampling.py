"""Samples the design of a group: which value each run has for each variable key."""

import math
import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import SAMPLED, Group

Key = tuple[int, str]
"""Key of an axis: (fault slot, field), or (-1, parameter path)."""


class Sample(NamedTuple):
    """The runs of a group, or of one entry of design "list".

    From run to run, repeats vary fastest, then the values of the last list.
    """

    runs: int
    # Number of the repeat, int64 [runs]; [] if there is only one repeat.
    repeat: np.ndarray
    # Position on each axis for `Axis.at`, [runs]; [] on an axis of one value.
    places: dict[Key, np.ndarray]


def count_samples(group: Group, axes: Mapping[Key, Axis]) -> int:
    """Return the number of different runs of a group, without repeats."""
    if group.design in SAMPLED:
        return group.runs or 0
    lengths = [len(axis.values) for axis in axes.values() if axis.kind == "list"]
    return max(lengths, default=1) if group.design == "zip" else math.prod(lengths)


def sample_runs(group: Group, axes: Mapping[Key, Axis], rng: np.random.Generator) -> Sample:
    """Return the runs of `group`, with the position of each run on each axis.

    Random draws depend only on `rng` and the order of the axes.
    """
    different = count_samples(group, axes)
    runs = different * group.repeats
    place, repeat = np.arange(runs), np.zeros((), np.int64)
    if group.repeats > 1:
        place, repeat = np.divmod(place, group.repeats)
    places: dict[Key, np.ndarray] = {key: np.zeros((), np.int64) for key in axes}
    if group.design in SAMPLED:
        random_axes = {key: axis for key, axis in axes.items() if axis.kind != "fixed"}
        draws = _draws(group.design, random_axes, different, rng)
        return Sample(runs, repeat, places | {key: where[place] for key, where in draws.items()})
    stride = different
    for key, axis in axes.items():
        if axis.kind == "list" and (length := len(axis.values)) > 1:
            stride = 1 if group.design == "zip" else stride // length
            places[key] = place // stride % length
    places |= _draws("random", {key: axis for key, axis in axes.items() if axis.drawn}, runs, rng)
    return Sample(runs, repeat, places)


def _draws(
    design: str, axes: Mapping[Key, Axis], rows: int, rng: np.random.Generator
) -> dict[Key, np.ndarray]:
    # Draws positions [rows] on each axis. Axes of kind `together` use the same random numbers.
    names = [axis.kind if axis.kind == "together" else key for key, axis in axes.items()]
    dimensions = {name: number for number, name in enumerate(dict.fromkeys(names))}
    unit = _unit(design, rows, len(dimensions), rng)
    return {
        key: axis.places(unit[:, dimensions[name]])
        for (key, axis), name in zip(axes.items(), names, strict=True)
    }


def _unit(design: str, rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    # Draws points of the unit cube, float [rows, dimensions].
    if design == "random" or dimensions == 0:
        return rng.random((rows, dimensions))
    # The import takes a second, so it is done only for these designs.
    from scipy.stats import qmc

    engine = qmc.LatinHypercube if design == "lhs" else qmc.Sobol
    with warnings.catch_warnings():
        # SciPy warns if the number of points is not a power of two, because the sample is then less
        # balanced.
        warnings.simplefilter("ignore", UserWarning)
        return engine(dimensions, rng=rng).random(rows)
