"""Runs a study: compares groups of sessions, and writes a page, a table and a short text."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.store.files import require_writable, write_text
from ravenjax.train.recording import reader
from ravenjax.train.study import design
from ravenjax.train.study.comparison import (
    ComparedGroup,
    GroupComparison,
    TrainingStudy,
    collect_sessions,
    compare_groups,
)

PAGE, TABLE, TEXT = "study.html", "study.csv", "study.txt"
_HIDDEN = ("group", "cue", "cue_ms", "session")
"""Columns that would reveal the cue in a blinded study."""
_HEIGHT = 110


class StudyResult(NamedTuple):
    """The results of a study."""

    page: Path
    table: Path
    text: str
    comparisons: list[GroupComparison]


def write_study(
    folders: Iterable[Path],
    out: Path,
    by: str | None = None,
    *,
    unblind: bool = False,
    mixed: bool = False,
) -> StudyResult:
    """Write study.html, study.csv (one row a hazard) and study.txt; see
    `collect_sessions`.
    """
    # jinja takes a while to import.
    from ravenjax.document import html

    study = collect_sessions(folders, by, unblind=unblind, mixed=mixed)
    comparisons = compare_groups(study)
    tested = [comparison for comparison in comparisons if not math.isnan(comparison.p)]
    floors = [design.smallest_p(comparison.people, comparison.paired) for comparison in tested]
    content = {
        "scenario": study.sessions[0].scenario,
        "people": len({session.person for session in study.sessions}),
        "unnamed": sum(not session.participant for session in study.sessions),
        "sessions": len(study.sessions),
        "hazards": len(study.rows()),
        "study": study,
        "paired": comparisons[0].paired,
        "reference": comparisons[0].first.label,
        "comparisons": comparisons,
        "tested": tested,
        "smallest_p": min(floors, default=1.0),
        "infinity": math.inf,
        "horizon_s": study.horizon_ms() / 1000,
    }
    out = Path(out)
    require_writable(out)
    environment = html.template_environment("ravenjax.train")
    page = environment.get_template("study.html.j2").render(
        content,
        charts=_charts(comparisons),
        versions=study.sessions[0].header.get("versions") or {},
    )
    text = environment.overlay(autoescape=False).get_template("study.txt.j2").render(content)
    for name, written in ((PAGE, html.with_scopes(page)), (TABLE, _table(study)), (TEXT, text)):
        write_text(out / name, written)
    return StudyResult(out / PAGE, out / TABLE, text, comparisons)


def _table(study: TrainingStudy) -> str:
    """Return CSV with a row for each active hazard; `compared` is the group as it is shown."""
    rows = [
        {"compared": label}
        | dataclasses.asdict(hazard)
        | {"participant": session.person, "session": session.name}
        for session, label, hazard in study.rows()
    ]
    columns = [name for name in rows[0] if not (study.blinded and name in _HIDDEN)]
    return reader.as_csv(columns, rows)


def _charts(comparisons: Sequence[GroupComparison]) -> list[Chart]:
    groups: dict[str, dict[str, ComparedGroup]] = {}
    for comparison in comparisons:
        for group in (comparison.first, comparison.second):
            groups.setdefault(comparison.outcome.name, {})[group.label] = group
    units = {comparison.outcome.name: comparison.outcome.unit for comparison in comparisons}
    charts = []
    for outcome, rows in groups.items():
        top = max(float(group.means.max()) for group in rows.values() if len(group.means))
        dots = tuple(
            Dots(label, f"series{place}", group.means, np.full(len(group.means), place))
            for place, (label, group) in enumerate(rows.items())
        )
        axis = ChartAxis(f"participants' means, {units[outcome]}", 0.0, 1.05 * top or 1.0)
        charts.append(Chart(outcome, axis, ChartAxis("", 0, 1, names=tuple(rows)), dots, _HEIGHT))
    return charts
