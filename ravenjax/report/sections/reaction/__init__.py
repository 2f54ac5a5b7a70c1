"""The operator's reaction to the cue: what it spares by fault class, and how far the instrument
still went.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section
from ravenjax.report.sections.reaction import pairs
from ravenjax.report.sections.reaction.pairs import Difference

ROW = 22  # px, of a class in the chart of differences


def spared(rows: Sequence[Difference]) -> Chart:
    """Chart of the mean difference of how far the tip went, by class and action, with intervals."""
    classes = list(dict.fromkeys(row.among for row in rows))
    actions = list(dict.fromkeys(row.action for row in rows))
    marks = []
    for number, action in enumerate(actions):
        mine = [row for row in rows if row.action == action and np.isfinite(row.distance_mm.value)]
        shift = (number - (len(actions) - 1) / 2) * 0.22
        value, low, high = (np.array([row.distance_mm[part] for row in mine]) for part in range(3))
        places = np.array([classes.index(row.among) + shift for row in mine])
        tips = tuple(
            f"{action}, {row.among}: {row.distance_mm.value:.2f} mm, {row.n:,} pairs"
            for row in mine
        )
        marks.append(Dots(action, palette.series(number), value, places, low, high, tips=tips))
    ends = np.concatenate(
        [[0.0], *(edge for one in marks for edge in (one.x, one.x_low, one.x_high))]
    )
    low, high = (1.05 * abs(float(end)) for end in (np.nanmin(ends), np.nanmax(ends)))
    across = ChartAxis(
        "how far the tip went by itself, with minus without, mm",
        -low,
        high or (0.0 if low else 1.0),
        unit="mm",
        line=0.0,
    )
    up = ChartAxis("faults", -0.5, len(classes) - 0.5, names=tuple(classes))
    return Chart(
        "What it spares", across, up, tuple(marks), 20 + (ROW + 6 * len(actions)) * len(classes)
    )


def differences(runs: Runs) -> list[Difference]:
    """Pairs compared; none where a campaign has none."""
    if not runs.manifest.shape.reacts:
        return []
    both = runs.once(pairs.drawn)
    return pairs.differences(both.frame, both.facts, runs.sampled) if both.crossed else []


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    if not runs.manifest.shape.reacts:
        return None
    both, found = runs.once(pairs.drawn), runs.once(differences)
    content = {
        "differences": found,
        "whole": [row for row in found if row.among == "all faults"],
        "leads": runs.cue_leads,
        "interruptions": pairs.interruptions(both.frame, both.facts),
        "reaction_runs": (len(both.frame), runs.rows),
    }
    if found:
        content["spared"] = spared(found)
    return content


SECTIONS = (Section("reaction", "Reaction", 70, _content),)
