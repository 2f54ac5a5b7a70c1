"""The debrief of a session: a self-contained HTML page made from session.json, hazards.csv and
the recording.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import StoreError
from ravenjax.outcomes import definitions
from ravenjax.outcomes.events import Rules
from ravenjax.robots.raven2 import ROBOT
from ravenjax.store.files import write_aside
from ravenjax.store.logs.session import description
from ravenjax.train.debrief import dexterity, figures, html, learning, replay, words
from ravenjax.train.debrief.course import Course
from ravenjax.train.judge.row import COLUMNS, HazardRow
from ravenjax.train.recording import hazards as hazard_table
from ravenjax.train.recording import reader

FILE = "debrief.html"
_TIMED, _LEVELS = ("compute", "lateness"), ("p50", "p99", "p99_9")
_COUNTS = ("late_ticks", "ticks", "lost_rows", "rows", "skipped_ms")


def write(folder: Path) -> Path:
    """Write debrief.html into a session's folder from session.json, hazards.csv and the recording;
    return its path.

    The measures of the motion go into the summary of session.json, where a learning curve finds
    them. What is missing or cut short is said on the page. StoreError where the folder holds no
    session.
    """
    folder = Path(folder)
    description.read(folder)
    recording, _ = _recording(folder)
    if recording is not None and len(recording.rows) > 1:
        measures = dexterity.measure(Course(recording)).plain()
        description.update(folder, {"summary": {learning.MEASURES: measures}})
    text, path = render(folder), folder / FILE
    write_aside(path, lambda target: target.write_bytes(text.encode()))
    return path


def render(folder: Path) -> str:
    """The page as text."""
    header = description.read(folder)
    recording, state = _recording(folder)
    state["table"] = (folder / hazard_table.FILE).exists()
    hazards = hazard_table.read_table(folder)
    if not state["table"] and recording is not None:
        hazards = hazard_table.from_recording(recording, header)
    threshold_mm, limit_mm = header.get("cue_threshold_mm"), words.harm_mm(header)
    blinded = bool(header.get("blinded"))
    course = None
    if recording is not None and len(recording.rows) > 1:
        course = Course(recording, threshold_mm, limit_mm, blinded)
    numbers = words.summary(hazards)
    summary = header.get("summary") or {}
    begin, rest = words.headline(hazards, numbers, state["table"] or recording is not None)
    has_contact = header.get("contact_units_per_n") is not None
    return html.page(
        "debrief.html.j2",
        header=header,
        scenario=_scenario(header),
        blinded=blinded,
        cue_on=bool(header.get("cue")),
        begin=begin,
        rest=rest,
        numbers=numbers,
        hazards=[_with_words(one, course, blinded) for one in hazards],
        hazards_csv=_csv(hazards, blinded),
        replay=replay.data(course, header, hazards) if course else None,
        overview=figures.overview(course, hazards) if course else None,
        timing=figures.loop(course) if course else None,
        quality=_quality(summary, course),
        task=_task(summary, course),
        rounds=(summary.get("task") or {}).get("rounds_s_of_level"),
        dexterity=summary.get(learning.MEASURES),
        contact=dexterity.contact(course) if course and has_contact else (),
        curves=figures.learning(learning.attempts(folder.absolute())),
        caveats=words.caveats(header, state),
        events=[
            event
            for event in state.get("events", [])
            if event["kind"] != "hazard_row" and not (blinded and event["kind"] == "cue")
        ],
        marks=figures.MARKS,
        limit_mm=limit_mm,
        depth_mm=words.harm_mm(header, "depth_mm"),
        definitions=_definitions(threshold_mm, limit_mm, blinded),
    )


def _recording(folder: Path) -> tuple[reader.Recording | None, dict[str, Any]]:
    """The recording, and what is to be said of it."""
    path = reader.find(folder)
    if path is None:
        return None, {"missing": True}
    try:
        recording = reader.read(path)
    except StoreError as error:
        return None, {"broken": str(error)}
    numbers = recording.numbers
    return recording, {
        "complete": recording.complete,
        "lost_bytes": recording.lost_bytes,
        "lost_rows": int(numbers[-1] + 1 - len(numbers)) if len(numbers) else 0,
        "events": recording.events,
    }


def _with_words(one: HazardRow, course: Course | None, blinded: bool) -> dict[str, Any]:
    steps = words.steps(one, blinded) if one.struck_ms is not None else []
    return {
        "row": one,
        "steps": [step for step in steps if step.after_ms is not None],
        "never": [step for step in steps if step.after_ms is None],
        "sentence": words.sentence(one, blinded),
        "figure": figures.hazard(course, one, steps) if course else None,
    }


def _definitions(
    threshold_mm: float | None, limit_mm: float | None, blinded: bool
) -> list[definitions.Definition]:
    """The words of outcomes with the session's own numbers; none where it does not name them."""
    if threshold_mm is None or limit_mm is None:
        return []
    rows = definitions.rows(Rules(threshold_mm=threshold_mm, limit_mm=limit_mm), ROBOT)
    absent = ("evades", definitions.OVERLOADED)
    return [one for one in rows if one.word not in absent and not (blinded and one.kind == "cue")]


def _scenario(header: dict[str, Any]) -> dict[str, str]:
    """Name and title of the scenario; a session's header holds it resolved, as a table or a
    name.
    """
    content = header.get("scenario") or {}
    if not isinstance(content, dict):
        content = {"name": str(content)}
    name = str(content.get("name") or header.get("name") or "session")
    title = str(content.get("title") or name)
    return {"name": name, "title": title, "text": str(content.get("description") or "")}


def _quality(summary: dict[str, Any], course: Course | None) -> dict[str, Any]:
    """Timing of the loop as one flat table: the loop's own figures, else those of the recording;
    empty where there are neither.
    """
    values = dict(summary.get("recording") or {})
    if course is not None:
        for what in _TIMED:
            levels = np.percentile(course.channel(f"{what}_us"), [50, 99, 99.9])
            values |= {f"{what}_{name}_us": x for name, x in zip(_LEVELS, levels, strict=True)}
    values |= summary.get("timing") or {}
    names = {f"{what}_{level}": f"{what}_{level}_us" for what in _TIMED for level in _LEVELS}
    names |= {name: name for name in _COUNTS}
    return {name: values[key] for name, key in names.items() if values.get(key) is not None}


def _task(summary: dict[str, Any], course: Course | None) -> dict[str, Any]:
    """How far the task came, and what else the session says of it."""
    values = dict(summary.get("task") or {})
    if course is not None:
        values.setdefault("progress", float(course.channel("progress")[-1]))
    return {name: value for name, value in values.items() if isinstance(value, int | float | str)}


def _csv(hazards: list[HazardRow], blinded: bool) -> str:
    """The table as it stands in the folder; without group and cue where the session is blinded."""
    hidden = ("group", "cue", "cue_ms") if blinded else ()
    names = [name for name in COLUMNS if name not in hidden]
    rows = [dataclasses.asdict(one) for one in hazards]
    return hazard_table.as_csv(names, rows) if rows else ""
