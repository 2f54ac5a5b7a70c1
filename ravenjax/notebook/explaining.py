"""Shows how errors propagate from fault to failure: many runs as a table, one run as a figure."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection.explain import Explainer
from ravenjax.report.run import chain, chain_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def explain_table(source: CampaignConfig | Path, runs: Any, engine: Any) -> pd.DataFrame:
    """Return the table of the public function `explain`; source: a campaign or a result folder."""
    explainer = _explainer(source, engine)
    if runs is None:
        rows = explainer.faulty()
    else:
        several = isinstance(runs, Sequence) and not isinstance(runs, str)
        rows = [explainer.index(run) for run in (runs if several else [runs])]
    explanation, config = explainer.explain(rows), explainer.config
    frame = chain.chain_table(
        explanation.results, explanation.ticks, config.robot, config.campaign.arms
    )
    frame.attrs.update({"campaign": config.campaign.name, "engine": explanation.engine})
    return frame


def explain_figure(source: CampaignConfig | Path, run: Any, engine: Any) -> "Figure | None":
    """Return a figure of the signals that differ from the golden run; None if no signal does."""
    explainer = _explainer(source, engine)
    explanation, config = explainer.explain([explainer.index(run)]), explainer.config
    row, ticks = explanation.results.iloc[0].to_dict(), explanation.ticks.iloc[0].to_dict()
    traced = chain.trace_chain(row, ticks, config.robot, config.campaign.arms, config.rules.cue)  # pyright: ignore[reportArgumentType]
    return chain_words.timeline_figure(traced)


def _explainer(source: CampaignConfig | Path, engine: Any) -> Explainer:
    build = Explainer.of_folder if isinstance(source, Path) else Explainer
    return build(source, engine)  # pyright: ignore[reportArgumentType]
