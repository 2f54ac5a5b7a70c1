"""Runs a campaign with a rule [stop]: the campaign ends when its rates are precise enough.

The rates are examined at looks that were planned in advance. The decisions depend only on finished
runs. Therefore a resumed campaign makes the same decisions and writes the same bytes.
`decisions.jsonl` in the result folder records each look.
"""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.campaign import runner
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.stop import decisions
from ravenjax.errors import UserError
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.stats.sequential import Look, Sequential, Stratum
from ravenjax.store.folder import Results


def run_adaptively(
    config: CampaignConfig,
    out: Path | None = None,
    engine: str = "auto",
    *,
    shard: Shard | None = None,
    **options: Any,
) -> Results:
    """Run a campaign, or continue it in `out`. A campaign with a stop rule may end early. Arguments
    and errors are those of `runner.run_campaign`, without `rows`. Raise UserError for a shard of a
    campaign with a stop rule.
    """
    compute = functools.partial(runner.run_campaign, config, engine=engine, **options)
    if config.stop is None:
        return compute(out, shard=shard)
    if shard is not None:
        raise UserError(
            f"--shard {shard}: the rule [stop] needs all runs of the campaign, but a shard has only"
            " some runs. Write --executor ray, or remove [stop]"
        )
    if out is None:
        run_in_folder = functools.partial(run_adaptively, config, engine=engine, **options)
        return runner.in_temporary_folder(run_in_folder)
    rule = stop_rule(config)
    draws = group_draws(config)
    looks: list[Look] = []
    # Number of draws of each group that were computed, and that the next look needs.
    computed = np.zeros(len(draws), np.int64)
    counts = rule.sizes()[0]
    while True:
        spans = [
            range(group.rows_of(first).stop, group.rows_of(last).stop)
            for group, first, last in zip(draws, computed.tolist(), counts.tolist(), strict=True)
        ]
        results = compute(out, rows=[span for span in spans if span])
        cases, valid_draws = count_cases(results, draws, counts, rule.rates, config.rules)
        looks.append(rule.decide(len(looks) + 1, counts, cases, valid_draws))
        decisions.write_looks(out, looks)
        if looks[-1].stop:
            return results
        computed = counts
        counts = rule.next_sizes(looks[-1], cases, valid_draws)


class GroupDraws(NamedTuple):
    """The draws of one group in the fault table. A draw is one fault with its repeats."""

    first: int  # row of the first draw
    number: int  # number of draws
    rows: int  # number of rows of each draw

    def rows_of(self, taken: int) -> range:
        """Return the rows of the first `taken` draws of the group."""
        return range(self.first, self.first + taken * self.rows)


def group_draws(config: CampaignConfig) -> tuple[GroupDraws, ...]:
    """Return the draws of each group in the order of the table."""
    result, first = [], 0
    for group, rows in zip(config.group, design.count_group_rows(config).values(), strict=True):
        rows_per_draw = design.rows_of_a_draw(config, group)
        result.append(GroupDraws(first, rows // rows_per_draw, rows_per_draw))
        first += rows
    return tuple(result)


def stop_rule(config: CampaignConfig) -> Sequential:
    """Return the stop rule of a campaign with a section [stop]. Each group is a stratum."""
    stop = config.stop
    assert stop is not None
    # Only the rates of groups with faults must be precise.
    strata = tuple(
        Stratum(group.name, draws.number, judged=bool(group.fault))
        for group, draws in zip(config.group, group_draws(config), strict=True)
    )
    return Sequential(strata, shares=stop.looks, **stop.model_dump(exclude={"looks"}))


def count_cases(
    results: Results,
    draws: Sequence[GroupDraws],
    taken: np.ndarray,
    names: Sequence[str],
    rules: Rules,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of draws with each of the events `names` [events, groups], and the number
    of valid draws [groups]. Only the first taken[group] draws of each group are counted. A row is
    valid if it has an outcome and its fault changed a bit. The first valid row of a draw decides
    whether its events happened. A draw without a valid row does not count.
    """
    table = results.arrow(["index", "activated", *events.event_columns(names, rules)])
    valid_sql = f"{events.VALID_SQL} AND activated"
    run_count = sum(group.number * group.rows for group in draws)
    # The first row of `happened` says whether a run is valid, the others are events.
    happened = np.zeros((1 + len(names), run_count), bool)
    happened[:, table["index"].to_numpy()] = events.events_happened(table, names, rules, valid_sql)
    case_counts = np.zeros((len(names), len(draws)), np.int64)
    valid_counts = np.zeros(len(draws), np.int64)
    for number, (group, count) in enumerate(zip(draws, taken.tolist(), strict=True)):
        rows = group.rows_of(count)
        # bool [1 + events, draws, rows of a draw].
        of_group = happened[:, rows.start : rows.stop].reshape(1 + len(names), count, group.rows)
        valid, cases = of_group[0], of_group[1:]
        # Index of the first valid row of each draw; 0 if no row is valid, and then no event counts.
        first = valid.argmax(axis=1)[None, :, None]
        decided = np.take_along_axis(cases & valid, first, axis=2)
        case_counts[:, number] = decided.sum(axis=(1, 2))
        valid_counts[number] = valid.any(axis=1).sum()
    return case_counts, valid_counts
