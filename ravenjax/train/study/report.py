"""A study: compares groups of sessions and writes the result as a page, a table and a short
text.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ravenjax.store.files import require_writable, write_aside
from ravenjax.train.debrief import html
from ravenjax.train.recording import hazards as hazards_table
from ravenjax.train.study import comparison, figures, words
from ravenjax.train.study import table as study_table
from ravenjax.train.study.comparison import GroupComparison
from ravenjax.train.study.table import TrainingStudy

PAGE, TABLE, TEXT = "study.html", "study.csv", "study.txt"
_HIDDEN = ("group", "cue", "cue_ms", "session")
"""Columns that would tell a blinded reader who had the cue; a session's folder may be named
after it.
"""


class StudyResult(NamedTuple):
    """What a study gave."""

    page: Path
    table: Path
    text: str
    comparisons: list[GroupComparison]


def run(
    folders: Iterable[Path],
    out: Path,
    by: str | None = None,
    *,
    unblind: bool = False,
    mixed: bool = False,
    confidence: float = 0.95,
    seed: int = 0,
) -> StudyResult:
    """Compare sessions and write study.html, study.csv (one row a hazard) and study.txt into `out`.

    Arguments as `study_table.collect`; seed: of bootstrap and permutations. Raises UserError and
    StoreError as it does.
    """
    study = study_table.collect(folders, by, unblind=unblind, mixed=mixed)
    comparisons = comparison.compare(study, confidence, seed)
    horizon = comparison.horizon_ms(study)
    text = words.text(study, comparisons, horizon)
    out = Path(out)
    require_writable(out)
    table = _table(study)
    page = _page(study, comparisons, horizon, table)
    for name, content in ((PAGE, page), (TABLE, table), (TEXT, text)):
        data = content.encode()
        write_aside(out / name, lambda target, data=data: target.write_bytes(data))
    return StudyResult(out / PAGE, out / TABLE, text, comparisons)


def _table(study: TrainingStudy) -> str:
    """One row a hazard that struck, as CSV; `compared` is the group as it is shown."""
    rows = [
        {"compared": label}
        | dataclasses.asdict(hazard)
        | {"participant": session.participant, "session": session.name}
        for session, label, hazard in study.rows()
    ]
    columns = [name for name in rows[0] if not (study.blinded and name in _HIDDEN)]
    return hazards_table.as_csv(columns, rows)


def _page(study: TrainingStudy, found: list[GroupComparison], horizon: float, table: str) -> str:
    begin, rest = words.headline(found)
    keys = [outcome.key for outcome in comparison.OUTCOMES]
    per_outcome = {key: [one for one in found if one.outcome.key == key] for key in keys}
    return html.page(
        "study.html.j2",
        study=study,
        begin=begin,
        rest=rest,
        caveats=words.caveats(study, found),
        comparisons=found,
        labels=list(study.labels.values()),
        people=len({one.participant for one in study.sessions}),
        hazards=len(study.rows()),
        horizon_s=horizon / 1000,
        dots={key: figures.participants(mine) for key, mine in per_outcome.items()},
        dots_height=figures.HEIGHT,
        words=words,
        table=table,
        versions=study.sessions[0].header.get("versions") or {},
    )
