"""Expands a campaign into its fault table: one row per run, one column per input of a run.

The expansion is deterministic. A group's random draws depend only on the campaign's seed and on the
group's name and design. They do not depend on other groups, on chunk size or on storage order. The
`run_id` of a row is a hash of its content and of all settings of the campaign, but not of its place
in the table. Whole columns are computed at once, because a campaign may have millions of runs.
"""

import hashlib
import itertools
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign.faults import run_id, sampling
from ravenjax.campaign.faults.moments import Moments
from ravenjax.campaign.faults.sampling import Key
from ravenjax.campaign.faults.slot import NUMBERS, fill_slot, words_of
from ravenjax.campaign.faults.table import SHARED
from ravenjax.campaign.file.axis import Axis, fixed_axis
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Fault, Group, Run
from ravenjax.store.schema import word_column
from ravenjax.vocabulary.effects import FIELDS

MOST_RUNS = 100_000_000
"""Largest number of rows of a fault table."""

_PARAMETER = -1
"""Replaces the number of the fault slot in the key of a parameter."""


class _Piece(NamedTuple):
    """Runs of one group, or of one entry of design "list", as columns. Each column has shape
    [runs], or [] if all runs have the same value.
    """

    runs: int
    group: str
    seed: np.ndarray  # int64
    # Number of rows from the first run that differs only in crossed parameters to this run.
    rows_from_first: int
    faults: list[dict[str, np.ndarray]]  # columns of each fault slot
    parameters: dict[str, np.ndarray]  # path -> values


def table_columns(config: CampaignConfig) -> pd.DataFrame:
    """Return the whole fault table, with the columns of `ravenjax.store.schema`. `run_id` is a
    number (uint64). With [stop], the first rows of each group are a random sample of the group.
    `campaign.limit` does not shorten the table; `runner` does. If a group does not set a parameter,
    its rows have NaN, which means the robot's value.
    """
    moments = Moments(config)
    pieces = [piece for group in config.group for piece in _pieces(config, group, moments)]
    runs = sum(piece.runs for piece in pieces)

    def join_pieces(columns: Iterable[Any], dtype) -> np.ndarray:
        # Concatenates one value or one array for each piece of the table to a column [runs].
        parts = [np.asarray(values, dtype) for values in columns]
        lengths = [piece.runs for piece in pieces]
        return np.concatenate([*map(np.broadcast_to, parts, lengths)])

    def join_words(codes: Iterable[Any], known: Sequence[str]) -> pd.Categorical:
        # Concatenates indices of known words to a column of words, stored as small integers.
        return word_column(join_pieces(codes, np.min_scalar_type(-len(known))), known)

    seed = join_pieces((piece.seed for piece in pieces), np.int64)
    words: dict[str, pd.Categorical] = {}
    numbers = {}
    for s in range(config.slots):
        faults = [piece.faults[s] if s < len(piece.faults) else {} for piece in pieces]
        for name, vocabulary in words_of(config.robot).items():
            words[f"fault{s}_{name}"] = join_words(
                (fault.get(name, 0) for fault in faults), vocabulary
            )
        for name, (dtype, empty) in NUMBERS.items():
            values = (fault.get(name, empty) for fault in faults)
            numbers[f"fault{s}_{name}"] = join_pieces(values, dtype)
    parameters = {}
    for path in dict.fromkeys(path for piece in pieces for path in piece.parameters):
        values = (piece.parameters.get(path, math.nan) for piece in pieces)
        parameters[f"param:{path}"] = join_pieces(values, np.float64)
    groups = list(dict.fromkeys(piece.group for piece in pieces))
    # Numbers of an empty slot must not change the run id, so they become NaN.
    counted = {
        name: np.where(np.asarray(words[f"{name.partition('_')[0]}_site"] == ""), np.nan, values)
        for name, values in numbers.items()
    }
    # All settings of the campaign on which outcomes depend.
    common = json.dumps(config.deciding(), sort_keys=True, separators=(",", ":"))
    ids = run_id.compute_run_ids(
        hashlib.sha256(common.encode()).hexdigest(), words, {"seed": seed} | counted | parameters
    )
    rows_from_first = join_pieces((piece.rows_from_first for piece in pieces), np.int32)
    pair = np.arange(runs, dtype=np.int32) - rows_from_first
    table: dict[str, Any] = {
        "run_id": ids,
        "index": np.arange(runs, dtype=np.int32),
        "pair": pair,
        "group": join_words((groups.index(piece.group) for piece in pieces), groups),
        "seed": seed,
        "operator": join_words([0] * len(pieces), [config.operator_label]),
        **{
            f"fault{s}_{name}": (words | numbers)[f"fault{s}_{name}"]
            for s in range(config.slots)
            for name in FIELDS
        },
        **parameters,
        **({SHARED: ids[pair]} if rows_from_first.any() else {}),
    }
    whole = pd.DataFrame(table, copy=False)
    return whole if config.stop is None else _arrange_table(config, whole)


def count_rows(config: CampaignConfig) -> int:
    """Return the number of rows of the whole fault table, without expanding it."""
    return sum(count_group_rows(config).values())


def count_due_rows(config: CampaignConfig) -> int:
    """Return the number of rows to compute: all rows, or the first `campaign.limit` rows."""
    return min(count_rows(config), config.campaign.limit or MOST_RUNS)


def count_group_rows(config: CampaignConfig) -> dict[str, int]:
    """Return the number of fault-table rows of each group, in order, without making them."""
    return {
        group.name: (
            rows_of_a_draw(config, group)
            * sum(sampling.count_samples(group, axes) for _, axes in faults_and_axes(config, group))
        )
        for group in config.group
    }


def _pieces(config: CampaignConfig, group: Group, moments: Moments) -> Iterator[_Piece]:
    # Yields the runs of a group: one piece per entry of design "list" and crossed combination.
    rng = np.random.default_rng([config.campaign.seed, zlib.crc32(group.name.encode())])
    for faults, axes_in_file in faults_and_axes(config, group):
        axes = moments.convert_phases(axes_in_file, group.name)
        # repeat: number of each run's repeat. places: position of each run on each axis, an index
        # in a list or a quantile. The keys of axes and places are (fault slot, field) of a fault,
        # and (_PARAMETER, path) of a parameter.
        runs, repeat, places = sampling.sample_runs(group, axes, rng)
        slots = [
            fill_slot(config.robot, fault, _select_slot(axes, f), _select_slot(places, f))
            for f, fault in enumerate(faults)
        ]
        parameters = {
            path: axis.at(places[_PARAMETER, path])
            for path, axis in _select_slot(axes, _PARAMETER).items()
        }
        # Each combination of crossed parameters has the same runs, so the first combination has the
        # same run `number * runs` rows before.
        for number, crossing in enumerate(_crossings(config, group)):
            yield _Piece(
                runs=runs,
                group=group.name,
                seed=(config.campaign.seed + repeat) % 2**31,
                rows_from_first=number * runs,
                faults=slots,
                parameters=parameters | crossing,
            )


def _crossings(config: CampaignConfig, group: Group) -> list[dict[str, np.ndarray]]:
    # Returns {path: value} of each combination of crossed parameters; the last varies fastest.
    # Without crossed parameters there is one combination, {}.
    axes = {**config.cross, **group.cross}
    combinations = itertools.product(*(axis.values for axis in axes.values()))
    return [
        {path: np.asarray(float(value)) for path, value in zip(axes, values, strict=True)}
        for values in combinations
    ]


def faults_and_axes(
    config: CampaignConfig, group: Group
) -> Iterator[tuple[tuple[Fault, ...], dict[Key, Axis]]]:
    """Yield (faults, axes) of a group, or of each entry of design "list". An axis has the values or
    the distribution of a key. Keys are (fault slot, field), in the order of slots and of `FIELDS`,
    then (_PARAMETER, path).
    """
    # `Run()` replaces no key of the group.
    for run in group.run or [Run()]:
        faults = group.faults_of(run)
        axes = {
            (f, name): axis
            for f, fault in enumerate(faults)
            for name, axis in _axes_of_fault(config, fault).items()
        }
        parameters = {**config.parameters, **group.parameters, **run.parameters}
        yield faults, axes | {(_PARAMETER, path): axis for path, axis in parameters.items()}


def _axes_of_fault(config: CampaignConfig, fault: Fault) -> dict[str, Axis]:
    # Returns the axis of each field of a fault except the site, which never varies. Fields that the
    # file does not state have defaults.
    site = config.robot.sites[fault.site]
    completed = {
        "arm": fault.arm or fixed_axis(config.campaign.arms[0] if site.per_arm else ""),
        "channel": fault.channels(site),
        "value": fault.value or fixed_axis(math.nan),
    }
    return {name: completed.get(name) or getattr(fault, name) for name in FIELDS if name != "site"}


def _select_slot(table: dict[Key, Any], slot: int) -> dict[str, Any]:
    # Returns the entries of one fault slot, by field.
    return {name: value for (s, name), value in table.items() if s == slot}


def _arrange_table(config: CampaignConfig, table: pd.DataFrame) -> pd.DataFrame:
    # Returns the fault table in the order that a stop rule needs, with new `index` and `pair`. The
    # first rows of each group must be a random sample of the group. A draw is one point of the
    # group's design. Its rows, which are its repeats with each crossed value, become adjacent. If 2
    # draws have 2 repeats and 2 crossed values, the rows of draws 0 0 1 1 0 0 1 1 become rows of
    # draws 0 0 0 0 1 1 1 1. Draws of a grid, zip or list are shuffled. Others are random already.
    order = np.arange(len(table))
    pair = table["pair"].to_numpy()
    # True for the first of the rows that differ only in crossed parameters.
    is_first_variant = pair == order
    sizes = table["group"].array.value_counts()
    start = 0
    for group in config.group:
        rows = order[start : start + sizes[group.name]]
        # Repeats are numbered through all draws: 0 1 2 3 0 1 2 3 in the example above. `pair` is
        # the row of the same repeat with the first crossed value.
        repeat_number = (np.cumsum(is_first_variant[rows]) - 1)[pair[rows] - start]
        draw = repeat_number // group.repeats
        draw_count = len(rows) // rows_of_a_draw(config, group)
        new_position = np.arange(draw_count)
        if group.design not in SAMPLED:
            seed = config.campaign.seed, zlib.crc32(group.name.encode()), 1
            new_position = np.random.default_rng(seed).permutation(draw_count)
        order[rows] = rows[np.argsort(new_position[draw], kind="stable")]
        start += len(rows)
    # order: the old row in each new row. new_index: the new row of each old row, its inverse.
    new_index = np.empty_like(order)
    new_index[order] = np.arange(len(order))
    index = np.arange(len(order), dtype=np.int32)
    pair = new_index[pair[order]].astype(np.int32)
    return table.take(order).reset_index(drop=True).assign(index=index, pair=pair)


def rows_of_a_draw(config: CampaignConfig, group: Group) -> int:
    """Return the number of rows of a draw: its repeats with each combination of `cross`."""
    return group.repeats * len(_crossings(config, group))
