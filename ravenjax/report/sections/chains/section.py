"""The report's section about explained runs: the worst one by one, and all that evade together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ravenjax.document.chart import Chart
from ravenjax.errors import StoreError
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.run import chain, chain_words
from ravenjax.report.run.chain import Chain
from ravenjax.report.sections.chains import carriers, figures, words
from ravenjax.report.sections.chains.carriers import Propagation
from ravenjax.store.access import explained
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import Manifest

MOST = 3
"""Chains that are shown."""


class WorstChain(NamedTuple):
    """One run of the section."""

    chain: Chain
    sentences: Sequence[str]
    timeline: Chart | None


class ChainSection(NamedTuple):
    """What the section says."""

    broken: str  # why explained runs could not be read; "": they could
    runs: int = 0  # that are explained
    together: Propagation | None = None
    sentences: Sequence[str] = ()
    graph: Chart | None = None
    leads: Chart | None = None
    worst: Sequence[WorstChain] = ()


def section(runs: Runs, manifest: Manifest, folder: Path) -> ChainSection | None:
    """Of the runs that `ravenjax explain` put beside a result; None where there are none of this
    campaign.
    """
    try:
        ticks = explained.read(folder / explained.FOLDER, manifest)
    except StoreError as error:
        return ChainSection(str(error))
    if ticks is None or not len(ticks):
        return None
    together = carriers.propagation(runs, manifest, ticks)
    return ChainSection(
        "",
        len(ticks),
        together,
        words.sentences(together),
        figures.graph(together),
        figures.leads(together),
        _worst(runs, manifest, ticks),
    )


def _worst(runs: Runs, manifest: Manifest, ticks: pd.DataFrame) -> list[WorstChain]:
    """The explained runs that evade and went farthest; where none evades, those that went
    farthest.
    """
    far = "coalesce(greatest(unintended_mm, loss_mm), 0)"
    rows = runs.table.rows(
        f"SELECT row FROM {RESULTS} JOIN (SELECT row, evaded FROM {FACTS} WHERE sample AND faulty)"
        f" USING (row) WHERE row IN (SELECT unnest(?)) ORDER BY evaded DESC, isnan({far}), {far}"
        f" DESC, row LIMIT {MOST}",
        [ticks["index"].tolist()],
    )
    by_row = ticks.set_index("index", drop=False)
    out = []
    for row in runs.numbered([row for (row,) in rows]):
        own = by_row.loc[int(row["index"])].to_dict()
        one = chain.chain(row, own, manifest.robot, manifest.shape.arms, manifest.rules.cue)  # type: ignore[arg-type]
        out.append(WorstChain(one, chain_words.sentences(one), chain_words.timeline(one)))
    return out
