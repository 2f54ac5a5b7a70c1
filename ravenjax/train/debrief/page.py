"""The debrief of a session: a self-contained HTML page made from session.json, hazards.csv and
the recording.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import StoreError
from ravenjax.store.files import write_aside
from ravenjax.store.logs.session import description
from ravenjax.train.debrief import dexterity, figures, replay
from ravenjax.train.debrief.course import Course
from ravenjax.train.judge.row import HazardRow
from ravenjax.train.recording import hazards as hazard_table
from ravenjax.train.recording import reader

FILE = "debrief.html"


def write(folder: Path) -> Path:
    """Write debrief.html into a session's folder from session.json, hazards.csv and the recording;
    return its path.

    The measures of the motion go into the summary of session.json, where a learning curve finds
    them. What is missing or cut short is said on the page. StoreError where the folder holds no
    session.
    """
    folder = Path(folder)
    header = description.read(folder)
    recording, trouble = None, ""
    try:
        if reader.find(folder) is not None:
            recording = reader.read(folder)
    except StoreError as error:
        trouble = str(error)
    course = None
    if recording is not None and len(recording.rows) > 1:
        course = Course(recording)
        measures = dexterity.measure(course)
        header = description.update(folder, {"summary": {dexterity.KEY: measures}})
    has_table = (folder / hazard_table.FILE).exists()
    hazards = hazard_table.read_table(folder)
    if not has_table and recording is not None:
        hazards = hazard_table.from_recording(recording, header)
    text = _render(folder, header, recording, course, hazards, has_table, trouble)
    path = folder / FILE
    write_aside(path, lambda target: target.write_bytes(text.encode()))
    return path


def _render(
    folder: Path,
    header: Mapping[str, Any],
    recording: reader.Recording | None,
    course: Course | None,
    hazards: Sequence[HazardRow],
    has_table: bool,
    trouble: str,
) -> str:
    # jinja takes a while to import.
    from ravenjax.document import html

    summary, blinded = header.get("summary") or {}, bool(header.get("blinded"))
    content = header.get("scenario") or {}
    scenario = content if isinstance(content, dict) else {"name": content}
    harm = scenario.get("harm") or {}
    named_limits = {
        "threshold of the cue": header.get("cue_threshold_mm"),
        "limit of hazards": harm.get("excursion_mm"),
    }
    limits = {name: mm for name, mm in named_limits.items() if mm is not None}
    charts: dict[str, Any] = {"hazards": [[] for _ in hazards], "session": []}
    shown, contact = None, {}
    if course is not None:
        charts = {
            "hazards": [figures.hazard(course, row, limits, blinded) for row in hazards],
            "session": figures.session(course, hazards, limits, blinded),
        }
        shown = replay.data(course, header, hazards)
        if header.get("contact_units_per_n") is not None:
            contact = dexterity.measure_contact(course)
    attempts = dexterity.read_attempts(folder.absolute())
    environment = html.environment("ravenjax.train")
    environment.filters |= {"milliseconds": format_ms, "moment": format_moment}
    page = environment.get_template("debrief.html.j2").render(
        header=header,
        scenario={"name": header.get("name") or "session"} | scenario,
        summary=summary,
        numbers=_summary(hazards),
        hazards=hazards,
        outcomes=hazard_table.OUTCOMES,
        moments=figures.MOMENTS,
        blinded=blinded,
        has_table=has_table,
        recording=recording,
        trouble=trouble,
        limit_mm=harm.get("excursion_mm"),
        threshold_mm=header.get("cue_threshold_mm"),
        charts=charts,
        learning=figures.learning(attempts),
        replay=shown,
        contact=contact,
        timing=(summary.get("recording") or {}) | (summary.get("timing") or {}),
        task=summary.get("task") or {},
        dexterity=summary.get(dexterity.KEY),
    )
    return html.with_scopes(page)


def _summary(hazards: Sequence[HazardRow]) -> dict[str, Any]:
    """The session's numbers, over all hazards that struck; None where there is none."""
    struck = [row for row in hazards if row.struck_ms is not None]

    def over(function: Any, values: Iterable[float | None]) -> float | None:
        known = [value for value in values if value is not None]
        return function(known) if known else None

    return {
        "strikes": len(struck),
        "right": sum(row.response_ok for row in struck),
        "reaction_ms": over(
            statistics.median, (row.reaction_ms for row in struck if row.response_ok)
        ),
        "farthest_mm": over(max, (row.farthest_mm for row in struck)),
        "deepest_mm": over(max, (row.deepest_mm for row in struck)),
        "score": over(statistics.fmean, (row.score for row in struck)),
    }


def format_ms(value: float) -> str:
    """84 -> 84 ms, 1840 -> 1.84 s."""
    return f"{value:.0f} ms" if abs(value) < 1000 else f"{value / 1000:.2f} s"


def format_moment(value: float) -> str:
    """12400 -> 12.4 s into the session, as minutes from the second on."""
    minutes, seconds = divmod(value / 1000, 60)
    return f"{minutes:.0f} min {seconds:.1f} s" if minutes else f"{seconds:.1f} s"
