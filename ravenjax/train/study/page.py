"""A study: compares groups of sessions and writes the result as a page, a table and a short
text.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.stats.intervals import Estimate
from ravenjax.store.files import require_writable, write_aside
from ravenjax.train.recording import hazards as hazard_table
from ravenjax.train.study import design, sessions
from ravenjax.train.study.comparison import TIME, ComparedGroup, GroupComparison, compare
from ravenjax.train.study.sessions import TrainingStudy

PAGE, TABLE, TEXT = "study.html", "study.csv", "study.txt"
_HIDDEN = ("group", "cue", "cue_ms", "session")
"""Columns that would tell a blinded reader who had the cue; a session's folder may be named
after it.
"""
_HEIGHT = 110


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
) -> StudyResult:
    """Compare sessions and write study.html, study.csv (one row a hazard) and study.txt into `out`.

    Arguments as `sessions.collect`. Raises UserError and StoreError as it does.
    """
    # jinja takes a while to import.
    from ravenjax.document import html

    study = sessions.collect(folders, by, unblind=unblind, mixed=mixed)
    comparisons = compare(study)
    content = {
        "scenario": study.sessions[0].scenario,
        "people": len({session.person for session in study.sessions}),
        "sessions": len(study.sessions),
        "hazards": len(study.rows()),
        "study": study,
        "paired": comparisons[0].paired,
        "reference": comparisons[0].first.label,
        "lines": [_describe(comparison) for comparison in comparisons],
        "headline": _headline(comparisons),
        "caveats": _caveats(study, comparisons),
        "horizon_s": study.horizon_ms() / 1000,
    }
    out = Path(out)
    require_writable(out)
    environment = html.environment("ravenjax.train")
    page = environment.get_template("study.html.j2").render(
        content,
        charts=_charts(comparisons),
        versions=study.sessions[0].header.get("versions") or {},
    )
    text = environment.overlay(autoescape=False).get_template("study.txt.j2").render(content)
    for name, written in ((PAGE, html.with_scopes(page)), (TABLE, _table(study)), (TEXT, text)):
        data = written.encode()
        write_aside(out / name, lambda target, data=data: target.write_bytes(data))
    return StudyResult(out / PAGE, out / TABLE, text, comparisons)


def _table(study: TrainingStudy) -> str:
    """One row a hazard that struck, as CSV; `compared` is the group as it is shown."""
    rows = [
        {"compared": label}
        | dataclasses.asdict(hazard)
        | {"participant": session.person, "session": session.name}
        for session, label, hazard in study.rows()
    ]
    columns = [name for name in rows[0] if not (study.blinded and name in _HIDDEN)]
    return hazard_table.as_csv(columns, rows)


def _charts(comparisons: Sequence[GroupComparison]) -> list[Chart]:
    """Of each outcome the mean of every participant, a row for each group."""
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


def _describe(comparison: GroupComparison) -> dict[str, str]:
    """A comparison in words and numbers."""
    outcome, first, second = comparison.outcome, comparison.first, comparison.second

    def number(value: float, *, sign: str = "", digits: int = outcome.digits) -> str:
        text = f"{value:{sign}.{digits}f}" if math.isfinite(value) else "–"
        return (text.lstrip("+-") if float(value) == 0 else text).replace("-", "−")

    def estimate(value: Estimate, digits: int = outcome.digits) -> str:
        middle, low, high = (number(part, sign="+", digits=digits) for part in value)
        return middle if "–" in (middle, low, high) else f"{middle} ({low} to {high})"

    def level(group: ComparedGroup) -> str:
        middle = f"mean {number(group.mean)} {outcome.unit}"
        if outcome is TIME:
            middle += ", median " + (
                "not reached" if math.isinf(group.median) else number(group.median)
            )
        return f"{middle}; {len(group.means)} participants, {len(group.values)} hazards"

    def p_value(value: float) -> str:
        return "–" if math.isnan(value) else "< 0.001" if value < 0.001 else f"{value:.3f}"

    if math.isnan(comparison.p):
        verdict = "it did not vary, so there is nothing to test"
        if comparison.has_few:
            verdict = "too few participants to compare"
    elif comparison.clear:
        verdict = f"{second.label} did {'better' if comparison.sign > 0 else 'worse'}"
    else:
        verdict = "no clear difference"
    return {
        "outcome": outcome.name,
        "pair": f"{second.label} against {first.label}",
        "first": level(first),
        "second": level(second),
        "difference": f"{estimate(comparison.difference)} {outcome.unit.replace('%', 'points')}",
        "g": estimate(comparison.g, 2),
        "p": p_value(comparison.p),
        "adjusted": p_value(comparison.adjusted),
        "verdict": verdict,
    }


def _headline(comparisons: Sequence[GroupComparison]) -> str:
    tested = [comparison for comparison in comparisons if not math.isnan(comparison.p)]
    if not tested:
        if any(comparison.has_few for comparison in comparisons):
            return "Too few participants to compare: each group needs at least two."
        return "Nothing to compare: no outcome varied."
    clear = [
        f"{comparison.outcome.name} {'better' if comparison.sign > 0 else 'worse'} with"
        f" {comparison.second.label} than with {comparison.first.label}"
        for comparison in tested
        if comparison.clear
    ]
    if not clear:
        return f"No clear difference between the groups in any of {len(tested)} comparisons."
    return f"{len(clear)} of {len(tested)} comparisons are clear: {'; '.join(clear)}."


def _caveats(study: TrainingStudy, comparisons: Sequence[GroupComparison]) -> list[str]:
    """What a reader must know before believing it."""
    caveats = list(study.notes)
    if study.blinded:
        caveats.append("Blinded: groups have letters. Unblind once the analysis is settled.")
    sizes = []
    for comparison in comparisons:
        paired, first, second = comparison.paired, comparison.first, comparison.second
        people = len(first.means) + (0 if paired else len(second.means))
        if comparison.left_out:
            did = "did only one condition" if paired else "did both conditions, unlike the others,"
            caveats.append(
                f"{comparison.left_out} participants {did} and are left out of a comparison."
            )
        if not math.isnan(comparison.p):
            sizes.append(design.smallest_p(people, paired))
    if sizes and len(sizes) * min(sizes) > 0.05:
        caveats.append(
            "So few participants cannot show anything: the smallest p that they can reach is"
            f" {min(sizes):.3f}, {min(1.0, len(sizes) * min(sizes)):.3f} after Holm over"
            f" {len(sizes)} comparisons. `ravenjax study plan` says how many it takes."
        )
    if unnamed := sum(not session.participant for session in study.sessions):
        caveats.append(
            f"{unnamed} sessions name no participant; each is taken as a participant of its own."
        )
    return list(dict.fromkeys(caveats))
