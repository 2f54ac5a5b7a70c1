"""Samples the design of a group: which value each run has for each variable key.

Latin hypercubes and Sobol points are those of SciPy, bit by bit. They are drawn here because the
import of `scipy.stats` takes half a second of a start that may take 2.5 s.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ravenjax import resources
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import SAMPLED, Group

Key = tuple[int, str]
"""Key of an axis: (fault slot, field), or (-1, parameter path)."""


class Sample(NamedTuple):
    """The runs of a group, or of one entry of design "list". From run to run, repeats vary fastest,
    then the values of the last list.
    """

    runs: int
    repeat: np.ndarray  # number of the repeat, int64 [runs]; [] if there is only one repeat
    # Position on each axis for `Axis.at`, [runs]; [] on an axis of one value.
    places: dict[Key, np.ndarray]


def count_samples(group: Group, axes: Mapping[Key, Axis]) -> int:
    """Return the number of runs of a group, without repeats and crossed parameters. Equal runs that
    a design draws or lists twice count twice.
    """
    if group.design in SAMPLED:
        return group.runs or 0
    lengths = [len(axis.values) for axis in axes.values() if axis.kind == "list"]
    return max(lengths, default=1) if group.design == "zip" else math.prod(lengths)


def sample_runs(group: Group, axes: Mapping[Key, Axis], rng: np.random.Generator) -> Sample:
    """Return the runs of `group`. Random draws depend only on `rng` and the order of the axes."""
    samples = count_samples(group, axes)
    runs = samples * group.repeats
    # Number of the sample, and of the repeat, of each run. A scalar applies to all runs.
    sample, repeat = np.arange(runs), np.zeros((), np.int64)
    if group.repeats > 1:
        sample, repeat = np.divmod(sample, group.repeats)
    # Position on each axis: the index of a listed value, or a quantile of a distribution.
    places: dict[Key, np.ndarray] = {key: np.zeros((), np.int64) for key in axes}
    if group.design in SAMPLED:
        random_axes = {key: axis for key, axis in axes.items() if axis.kind != "fixed"}
        draws = _draw_places(group.design, random_axes, samples, rng)
        return Sample(runs, repeat, places | {key: drawn[sample] for key, drawn in draws.items()})
    # Number of samples until a list takes its next value. In a grid, the last list varies fastest:
    # lists of 2 and 3 values have strides 3 and 1.
    stride = samples
    for key, axis in axes.items():
        if axis.kind == "list" and (length := len(axis.values)) > 1:
            stride = 1 if group.design == "zip" else stride // length
            places[key] = sample // stride % length
    # Each run, also each repeat, draws its own values of distributions.
    drawn_axes = {key: axis for key, axis in axes.items() if axis.drawn}
    places |= _draw_places("random", drawn_axes, runs, rng)
    return Sample(runs, repeat, places)


def _draw_places(
    design: str, axes: Mapping[Key, Axis], rows: int, rng: np.random.Generator
) -> dict[Key, np.ndarray]:
    # Draws positions [rows] on each axis. All axes of kind `together` use the same random numbers,
    # which are one dimension of the random points; each other axis has its own dimension.
    dimension_of_axis: dict[Key, int] = {}
    dimensions: dict[Key | str, int] = {}
    for key, axis in axes.items():
        name = axis.kind if axis.kind == "together" else key
        dimension_of_axis[key] = dimensions.setdefault(name, len(dimensions))
    points = _draw_points(design, rows, len(dimensions), rng)
    return {key: axis.places(points[:, dimension_of_axis[key]]) for key, axis in axes.items()}


def _draw_points(design: str, rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    # Draws points of the unit cube, float [rows, dimensions]. As in SciPy, designs other than
    # `random` use a new generator, spawned from `rng`.
    if design == "random" or dimensions == 0:
        return rng.random((rows, dimensions))
    if design == "lhs":
        # In each dimension, each of the cells 1 to `rows` has one point: at (cell - random) / rows.
        spawned = rng.spawn(1)[0]
        distances = spawned.random((rows, dimensions))
        cells = spawned.permuted(np.tile(np.arange(1, rows + 1), (dimensions, 1)), axis=1)
        return (cells.T - distances) / rows
    table = resources.read_tables(__file__, "sobol.toml")["directions"][:dimensions]
    if dimensions > len(table):
        from scipy.stats import qmc

        # SciPy warns if the number of points is no power of two, so the next one is drawn.
        return qmc.Sobol(dimensions, rng=rng).random(1 << (rows - 1).bit_length())[:rows]
    spawned = rng.spawn(1)[0]
    # Sobol points as 30-bit numbers. SciPy scrambles them: in each dimension the first point is
    # random, and the bits b of each direction, the highest first, become M b (mod 2). The matrix M
    # is random and lower triangular, with diagonal 1, so that it is invertible.
    size, dtype = (dimensions, 30), np.uint32
    bit_values = dtype(1) << np.arange(30, dtype=dtype)
    first = spawned.integers(2, size=size, dtype=dtype) @ bit_values
    matrices = np.tril(spawned.integers(2, size=(*size, 30), dtype=dtype)) | np.eye(30, dtype=dtype)
    # Bits of the 30 directions of each dimension: [dimensions, directions, bits].
    bits = np.array(table, dtype)[..., None] // bit_values[::-1] % 2
    scrambled_bits = (bits @ matrices.swapaxes(1, 2)) % 2
    directions = scrambled_bits @ bit_values[::-1]
    # Point n is point n - 1 XOR one direction: the direction whose index is the position of the
    # lowest set bit of n. In binary, 1100 & -1100 is 100, and 100 - 1 is 11: two ones, position 2.
    numbers = np.arange(1, rows)
    positions = np.bitwise_count((numbers & -numbers) - 1)
    points = np.bitwise_xor.accumulate(np.c_[first, directions[:, positions]], axis=1)
    return points.T / 2.0**30
