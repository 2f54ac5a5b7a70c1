"""Runs a campaign that stops when it knows enough: look by look, by the rule of its [stop] section.

How far it goes follows from the finished rows alone, so a campaign that was interrupted takes the
same way again, to the byte. `decisions.jsonl` in the result folder says what each look found; it is
written anew and never relied upon.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax.campaign import runner
from ravenjax.campaign.executors.protocol import Executor
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.campaign.stop import decisions
from ravenjax.campaign.stop.event_bitmaps import (
    EventBitmaps,
    GroupDraws,
    group_draws,
    stop_rule,
)
from ravenjax.errors import UserError
from ravenjax.stats.sample_size.sequential import Look
from ravenjax.store.access.results import Results


def run(
    config: CampaignConfig,
    out: Path | None = None,
    engine: str = "auto",
    *,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    shard: Shard | None = None,
    command: Sequence[str] = (),
) -> Results:
    """Run `config`, or finish it where `out` holds a part of it, as far as its stop rule asks where
    it has one.

    Arguments and errors are those of `runner.run_campaign`; UserError for a shard of a campaign
    that may stop.
    """
    compute = functools.partial(
        runner.run_campaign,
        config,
        out,
        engine,
        on_progress=on_progress,
        executor=executor,
        command=command,
    )
    if config.stop is None:
        return compute(shard=shard)
    if shard is not None:
        raise UserError(
            f"--shard {shard}: a campaign with [stop] decides by all its rows how far it goes, and"
            " a shard has a part of them. Take --executor ray, or remove [stop]"
        )
    rule, draws = stop_rule(config), group_draws(config)
    marks = EventBitmaps(draws[-1].range(draws[-1].number).stop, rule.rates, config.rules)
    looks: list[Look] = []
    results: list[Results] = []
    counts, before = rule.first(), np.zeros(len(draws), np.int64)
    while True:
        rows = _rows(draws, before, counts)
        if not marks.cover(rows):
            results.append(compute(rows=rows))
            marks.take(results[-1])
        k, n = marks.counts(draws, counts)
        looks.append(rule.look(len(looks) + 1, counts, k, n))
        if out is not None:
            decisions.write(out, looks)
        if looks[-1].stop:
            return results[-1] if out is not None else _joined(results)
        before, counts = counts, rule.following(looks[-1], k, n)


def _rows(draws: Sequence[GroupDraws], before: np.ndarray, taken: np.ndarray) -> list[range]:
    """The rows of the draws from `before` to `taken` of each group, in order."""
    spans = [
        range(of.range(first).stop, of.range(last).stop)
        for of, first, last in zip(draws, before.tolist(), taken.tolist(), strict=True)
    ]
    return [span for span in spans if span]


def _joined(found: Sequence[Results]) -> Results:
    """What several calls kept in memory, in the order of the table."""
    tables = [table for results in found for table in results.tables]
    return Results(
        found[0].shape, None, tuple(sorted(tables, key=lambda table: table["index"][0].as_py()))
    )
