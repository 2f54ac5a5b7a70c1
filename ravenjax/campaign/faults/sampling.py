"""Samples a design: the place of each run of a group on each axis."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import SAMPLED, Group
from ravenjax.errors import UserError

Key = tuple[int, str]
"""An axis: fault slot, or -1 for a parameter; field or parameter path."""


class Sample(NamedTuple):
    """The runs of a group, or of one entry of design "list"; repeats vary fastest, then the last
    list.
    """

    runs: int
    repeat: (
        np.ndarray
    )  # int64 [runs], which repeat of its place in the design a run is; [] of the only one
    places: dict[
        Key, np.ndarray
    ]  # of each axis [runs] as `Axis.at` takes them; [] of an axis of one value


def count(group: Group, axes: Mapping[Key, Axis]) -> int:
    """How many runs `sample` gives, repeats apart. Raises UserError for lists that cannot go
    side by side.
    """
    if group.design in SAMPLED:
        return group.runs or 0
    lengths = {key: len(axis.values) for key, axis in axes.items() if axis.kind == "list"}
    if group.design != "zip":
        return math.prod(lengths.values())
    if len({length for length in lengths.values() if length > 1}) > 1:
        sizes = ", ".join(
            f"{name} of slot {f}: {n}" if f >= 0 else f"{name}: {n}"
            for (f, name), n in lengths.items()
        )
        raise UserError(
            f"group {group.name!r}: design 'zip' needs lists of one length, got {sizes}"
        )
    return max(lengths.values(), default=1)


def sample(group: Group, axes: Mapping[Key, Axis], rng: np.random.Generator) -> Sample:
    """Runs of `group` over these axes. What is drawn depends on the axes' order and on `rng`
    alone.
    """
    different = count(group, axes)
    runs = different * group.repeats
    place, repeat = np.arange(runs), np.zeros((), np.int64)
    if group.repeats > 1:
        place, repeat = np.divmod(place, group.repeats)
    places: dict[Key, np.ndarray] = {key: np.zeros((), np.int64) for key in axes}
    if group.design in SAMPLED:
        random_axes = {key: axis for key, axis in axes.items() if axis.kind != "fixed"}
        draws = _draws(group.design, random_axes, different, rng)
        if group.repeats > 1:
            draws = {key: where[place] for key, where in draws.items()}
        places |= draws
        return Sample(runs, repeat, places)
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
    """Places [rows] on each axis, drawn."""
    columns = _dimensions(axes)
    unit = _unit(design, rows, 1 + max(columns.values(), default=-1), rng)
    return {key: axis.places(unit[:, columns[key]]) for key, axis in axes.items()}


def _dimensions(axes: Mapping[Key, Axis]) -> dict[Key, int]:
    """Which dimension of the unit cube each axis is drawn along, from 0; axes of kind together
    share one.
    """
    numbers: dict[Key, int] = {}
    shared: int | None = None
    free = 0
    for key, axis in axes.items():
        if axis.kind == "together" and shared is not None:
            numbers[key] = shared
            continue
        numbers[key] = free
        shared = free if axis.kind == "together" else shared
        free += 1
    return numbers


def _unit(design: str, rows: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    """[rows, dimensions] points in the unit cube."""
    if design == "random" or dimensions == 0:
        return rng.random((rows, dimensions))
    # a second of import, which other designs save
    from scipy.stats import qmc

    engine = qmc.LatinHypercube if design == "lhs" else qmc.Sobol
    with warnings.catch_warnings():
        # numbers of points that are no power of two are less balanced
        warnings.simplefilter("ignore", UserWarning)
        return engine(dimensions, rng=rng).random(rows)
