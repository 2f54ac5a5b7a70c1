"""Expands a campaign into its fault table: one row per run, one column per input of a run.

The expansion is deterministic. A group's random draws depend only on the campaign's seed and on the
group's name and design. They do not depend on other groups, on chunk size or on storage order. The
`run_id` of a row is a hash of its content and of all settings of the campaign. Equal runs therefore
have equal ids, in whatever row. Whole columns are computed, because a campaign may have millions of
runs.
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
from ravenjax.store.words import word_column
from ravenjax.vocabulary.effects import FIELDS

MOST_RUNS = 100_000_000
"""Largest number of rows of a fault table."""

_PARAMETER = -1
"""Replaces the number of the fault slot in the key of a parameter."""


class _Piece(NamedTuple):
    """Runs of one group, or of one entry of design "list", as columns.

    Each column has shape [runs], or [] if all runs have the same value.
    """

    runs: int
    group: str
    seed: np.ndarray  # int64
    # Number of rows between the first run that differs only in crossed parameters, and this run.
    behind: int
    faults: list[dict[str, np.ndarray]]  # columns of each fault slot
    parameters: dict[str, np.ndarray]  # path -> values


def table_columns(config: CampaignConfig) -> pd.DataFrame:
    """Return the whole fault table, with the columns of `ravenjax.store.schema`.

    `run_id` is a number (uint64). With [stop], the first rows of each group are a random sample of
    the group. `campaign.limit` does not shorten the table; `runner` does. If a group does not set a
    parameter, its rows have NaN, which means the robot's value.
    """
    moments = Moments(config)
    pieces = [piece for group in config.group for piece in _pieces(config, group, moments)]
    runs = sum(piece.runs for piece in pieces)

    def joined(columns: Iterable[Any], dtype) -> np.ndarray:
        # Concatenates one value or one array for each piece of the table to a column [runs].
        parts = [np.asarray(values, dtype) for values in columns]
        lengths = [piece.runs for piece in pieces]
        return np.concatenate([*map(np.broadcast_to, parts, lengths)])

    def coded(columns: Iterable[Any], known: Sequence[str]) -> pd.Categorical:
        return word_column(joined(columns, np.min_scalar_type(-len(known))), known)

    seed = joined((piece.seed for piece in pieces), np.int64)
    words: dict[str, pd.Categorical] = {}
    numbers = {}
    for s in range(config.slots):
        faults = [piece.faults[s] if s < len(piece.faults) else {} for piece in pieces]
        for name, vocabulary in words_of(config.robot).items():
            words[f"fault{s}_{name}"] = coded((fault.get(name, 0) for fault in faults), vocabulary)
        for name, (dtype, empty) in NUMBERS.items():
            values = (fault.get(name, empty) for fault in faults)
            numbers[f"fault{s}_{name}"] = joined(values, dtype)
    parameters = {}
    for path in dict.fromkeys(path for piece in pieces for path in piece.parameters):
        values = (piece.parameters.get(path, math.nan) for piece in pieces)
        parameters[f"param:{path}"] = joined(values, np.float64)
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
    pair = np.arange(runs, dtype=np.int32) - joined((piece.behind for piece in pieces), np.int32)
    table: dict[str, Any] = {
        "run_id": ids,
        "index": np.arange(runs, dtype=np.int32),
        "pair": pair,
        "group": coded((groups.index(piece.group) for piece in pieces), groups),
        "seed": seed,
        "operator": coded([0] * len(pieces), [config.operator_label]),
        **{
            f"fault{s}_{name}": (words | numbers)[f"fault{s}_{name}"]
            for s in range(config.slots)
            for name in FIELDS
        },
        **parameters,
        **({SHARED: ids[pair]} if any(piece.behind for piece in pieces) else {}),
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
    """Return the number of rows of each group, in order, without expanding them."""
    return {
        group.name: (
            rows_of_a_draw(config, group)
            * sum(sampling.count_samples(group, axes) for _, axes in faults_and_axes(config, group))
        )
        for group in config.group
    }


def _pieces(config: CampaignConfig, group: Group, moments: Moments) -> Iterator[_Piece]:
    # Yields the runs of a group, one piece for each combination of crossed parameters.
    rng = np.random.default_rng([config.campaign.seed, zlib.crc32(group.name.encode())])
    for faults, written in faults_and_axes(config, group):
        axes = moments.placed(written, group.name)
        runs, repeat, places = sampling.sample_runs(group, axes, rng)
        slots = [
            fill_slot(config.robot, fault, _of_slot(axes, f), _of_slot(places, f))
            for f, fault in enumerate(faults)
        ]
        parameters = {
            path: axis.at(places[_PARAMETER, path])
            for path, axis in _of_slot(axes, _PARAMETER).items()
        }
        for number, crossing in enumerate(_crossings(config, group)):
            yield _Piece(
                runs=runs,
                group=group.name,
                seed=(config.campaign.seed + repeat) % 2**31,
                behind=number * runs,
                faults=slots,
                parameters=parameters | crossing,
            )


def _crossings(config: CampaignConfig, group: Group) -> list[dict[str, np.ndarray]]:
    """Return {path: value} of each combination of crossed parameters; the last varies fastest."""
    axes = {**config.cross, **group.cross}
    rows = itertools.product(*(axis.values for axis in axes.values()))
    return [
        {path: np.asarray(float(value)) for path, value in zip(axes, row, strict=True)}
        for row in rows
    ]


def faults_and_axes(
    config: CampaignConfig, group: Group
) -> Iterator[tuple[tuple[Fault, ...], dict[Key, Axis]]]:
    """Yield (faults, axes) of a group, or of each entry of design "list".

    An axis has the values or the distribution of a key. The order is: keys of the first fault in
    the order of `FIELDS`, keys of the next fault, and so on, then parameters.
    """
    for run in group.run or [Run()]:
        faults = group.faults_of(run)
        axes = {
            (f, name): axis
            for f, fault in enumerate(faults)
            for name, axis in _of_fault(config, fault).items()
        }
        parameters = {**config.parameters, **group.parameters, **run.parameters}
        yield faults, axes | {(_PARAMETER, path): axis for path, axis in parameters.items()}


def _of_fault(config: CampaignConfig, fault: Fault) -> dict[str, Axis]:
    # Returns the axis of each field of a fault, with defaults where the file states no value.
    site = config.robot.sites[fault.site]
    resolved = {
        "arm": fault.arm or fixed_axis(config.campaign.arms[0] if site.per_arm else ""),
        "channel": fault.channels(site),
        "value": fault.value or fixed_axis(math.nan),
    }
    return {name: resolved.get(name) or getattr(fault, name) for name in FIELDS if name != "site"}


def _of_slot(table: dict[Key, Any], slot: int) -> dict[str, Any]:
    return {name: value for (s, name), value in table.items() if s == slot}


def _arrange_table(config: CampaignConfig, table: pd.DataFrame) -> pd.DataFrame:
    """Return the fault table in the order that a stop rule needs, with new `index` and `pair`.

    The first rows of each group must be a random sample of it. A draw is one point of a group's
    design. Its repeats and crossed variants have the same fault. Their rows are adjacent, are
    computed together and count once. Draws of a random, lhs or sobol design keep their order. Draws
    of a grid, zip or list are shuffled with the campaign's seed. This does not change run ids.
    """
    order = np.arange(len(table))
    pair = table["pair"].to_numpy()
    first_of_kind = pair == order
    sizes = table["group"].array.value_counts()
    start = 0
    for group in config.group:
        rows = order[start : start + sizes[group.name]]
        # Number, from 0, of the fault of each row that has a new fault.
        kind = np.cumsum(first_of_kind[rows]) - 1
        draw = kind[pair[rows] - start] // group.repeats
        number = len(rows) // rows_of_a_draw(config, group)
        places = np.arange(number)
        if group.design not in SAMPLED:
            seed = config.campaign.seed, zlib.crc32(group.name.encode()), 1
            places = np.random.default_rng(seed).permutation(number)
        order[rows] = rows[np.argsort(places[draw], kind="stable")]
        start += len(rows)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    index = np.arange(len(order), dtype=np.int32)
    pair = place[pair[order]].astype(np.int32)
    return table.take(order).reset_index(drop=True).assign(index=index, pair=pair)


def rows_of_a_draw(config: CampaignConfig, group: Group) -> int:
    """Return the number of rows of each draw of a group."""
    return group.repeats * len(_crossings(config, group))
