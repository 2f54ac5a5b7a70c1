"""The sessions of a study: reads them, checks that they belong together, and hides the groups of
a blinded study.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import string
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.logs.session import description
from ravenjax.train.judge.row import HazardRow
from ravenjax.train.recording import hazards as table
from ravenjax.train.recording import reader
from ravenjax.train.recording.folders import SessionFolder

BY = ("group", "cue")
"""What sessions may be compared by."""
_REFERENCES = ("off", "control", "none", "without", "no cue", "0")
_LONGEST = 6  # names of an error's list


UNDECIDED = ("", "interrupted")
"""Outcomes of hazards that were cut off, by the end of a recording or by what is not the
operator's: they count for neither group."""


@dataclasses.dataclass(frozen=True)
class StudySession:
    """A session of the study."""

    folder: Path
    header: dict[str, Any]
    hazards: list[HazardRow]
    cut_short: bool = False  # hazards are those of its recording, as far as that goes

    @property
    def name(self) -> str:
        """Of its folder's header."""
        return str(self.header.get("name") or self.folder.name)

    @property
    def participant(self) -> str:
        """Who drove it; a session without a name is a participant of its own."""
        return str(self.header.get("participant") or f"(session {self.name})")

    def groups(self, by: str) -> dict[str, list[HazardRow]]:
        """Its hazards that struck and were decided, by condition; the cue may have been changed
        on the way.
        """
        out: dict[str, list[HazardRow]] = {}
        for hazard in self.hazards:
            if hazard.struck_ms is not None and hazard.outcome not in UNDECIDED:
                condition = hazard.cue if by == "cue" else str(self.header.get("group") or "")
                out.setdefault(condition, []).append(hazard)
        return out

    @property
    def watched_ms(self) -> dict[int, float]:
        """How long a response to each hazard of its list is awaited, ms; a little longer is
        watched.
        """
        return {
            int(hazard["number"]): 1e3 * float(hazard["within_s"])
            for hazard in self.header.get("hazards") or []
            if "number" in hazard and "within_s" in hazard
        }


@dataclasses.dataclass(frozen=True)
class TrainingStudy:
    """Sessions that may be compared. labels: shown name of each group, the reference first."""

    sessions: list[StudySession]
    by: str
    labels: dict[str, str]
    blinded: bool
    left_out: list[str]  # sentences
    notes: list[str]

    @property
    def scenario(self) -> str:
        """Name of its scenario."""
        return SessionFolder(self.sessions[0].folder, self.sessions[0].header).scenario

    def rows(self) -> list[tuple[StudySession, str, HazardRow]]:
        """Session, label of its group and hazard, of every hazard that struck."""
        return [
            (session, self.labels[condition], hazard)
            for session in self.sessions
            for condition, hazards in session.groups(self.by).items()
            for hazard in hazards
        ]

    def label(self, session: StudySession) -> str:
        """Shown name of the session's condition."""
        return " and ".join(self.labels[condition] for condition in session.groups(self.by))


def collect(
    folders: Iterable[Path], by: str | None = None, *, unblind: bool = False, mixed: bool = False
) -> TrainingStudy:
    """Read sessions: each folder is one, or holds some at any depth.

    by: "group" or "cue"; the one that differs if None, "group" first. unblind: show what conditions
    the groups of blinded sessions were. mixed: take sessions of several scenarios or versions
    together, and say so. Raises UserError where there is nothing to compare or sessions are not of
    one study, StoreError where a file is damaged.
    """
    if by is not None and by not in BY:
        raise UserError(f"compare by {by!r}: expected one of {', '.join(BY)}")
    sessions = [_read(folder) for folder in _folders(folders)]
    valid = [session for session in sessions if session.groups("cue")]
    left_out = [_why_not(session) for session in sessions if session not in valid]
    if not valid:
        listed = "; ".join(left_out[:_LONGEST]) or "no session was found"
        raise UserError(
            f"a study needs sessions in which hazards struck and were decided: {listed}"
        )
    notes = [*_of_one_study(valid, mixed), *_undecided(valid)]

    def conditions(by: str) -> set[str]:
        return {name for session in valid for name in session.groups(by)}

    if by is None:
        by = "group" if len(conditions("group")) > 1 else "cue"
    groups = sorted(conditions(by), key=lambda name: (name.lower() not in _REFERENCES, name))
    if len(groups) < 2:
        raise UserError(
            f"all {len(valid)} sessions have {by} {groups[0]!r}: there is nothing to compare. Give"
            f" sessions of another {by} too" + ("" if by == "cue" else ", or compare by the cue")
        )
    blinded = any(session.header.get("blinded") for session in valid) and not unblind
    if blinded:
        labels = _blind(groups, valid)
    else:
        labels = {name: f"cue {name}" if by == "cue" else name or "(no group)" for name in groups}
    return TrainingStudy(valid, by, labels, blinded, left_out, notes)


def _folders(given: Iterable[Path]) -> list[Path]:
    """The folders of sessions, each once."""
    out: dict[Path, Path] = {}
    for folder in map(Path, given):
        inside = [folder]
        if not (folder / description.FILE).exists():
            inside = sorted(path.parent for path in folder.rglob(description.FILE))
        if not inside:
            raise UserError(
                f"{folder}: holds no session; expected folders that `ravenjax train` wrote, or one"
                " with such"
            )
        for session in inside:
            out.setdefault(session.resolve(), session)
    return list(out.values())


def _read(folder: Path) -> StudySession:
    """A session's hazards are those of its table; of its recording where it was killed before it
    could write one.
    """
    header = description.read(folder)
    if (folder / table.FILE).exists() or reader.find(folder) is None:
        return StudySession(folder, header, table.read_table(folder))
    hazards = table.from_recording(reader.read(folder), header)
    return StudySession(folder, header, hazards, cut_short=True)


def _why_not(one: StudySession) -> str:
    if any(hazard.struck_ms is not None for hazard in one.hazards):
        return f"{one.name}: every hazard that struck was cut off"
    return (
        f"{one.name}: no hazard"
        f" struck{'' if one.header.get('ended') else ' before it was cut short'}"
    )


def _undecided(sessions: Sequence[StudySession]) -> list[str]:
    """What a reader must know of sessions and hazards that were cut off."""
    notes = []
    short = [one.name for one in sessions if one.cut_short]
    if short:
        notes.append(
            f"Sessions that were cut short count as far as their recordings go: {', '.join(short)}."
        )
    hazards = [hazard for one in sessions for hazard in one.hazards if hazard.struck_ms is not None]
    cut = sum(hazard.outcome in UNDECIDED for hazard in hazards)
    if cut:
        notes.append(
            f"{cut} of {len(hazards)} hazards were cut off, and not by the operator (a pause, a"
            " reset, a lost console, the end); they are left out."
        )
    return notes


def _of_one_study(sessions: Sequence[StudySession], mixed: bool) -> list[str]:
    """Scenario and versions must be alike, and no session may come twice."""
    same: dict[tuple[str, Any, str], str] = {}
    for one in sessions:
        key = (one.participant, one.header.get("started"), one.name)
        if key in same:
            raise UserError(f"{one.folder}: is a copy of {same[key]}; give each session once")
        same[key] = str(one.folder)
    notes = []
    for what, value in (
        ("scenarios", _scenario),
        ("versions", lambda header: header.get("versions") or {}),
    ):
        kinds: dict[str, list[StudySession]] = {}
        for one in sessions:
            kinds.setdefault(json.dumps(value(one.header), sort_keys=True), []).append(one)
        if len(kinds) > 1:
            first, second = list(kinds.values())[:2]
            text = (
                f"{len(kinds)} different {what}:"
                f" {_difference(value(first[0].header), value(second[0].header))}"
            )
            if not mixed:
                raise UserError(
                    f"the sessions are not of one study, they have {text} ({first[0].name} against"
                    f" {second[0].name}). Give those of one study, or allow a mixture with --mixed"
                )
            notes.append(f"Sessions with {text} are taken together.")
    return notes


def _scenario(header: dict[str, Any]) -> Any:
    """The scenario without what a study varies."""
    content = header.get("scenario") or {}
    if not isinstance(content, dict):
        return content
    cue = content.get("cue")
    fixed = (
        {key: value for key, value in cue.items() if key not in ("on", "blinded")}
        if isinstance(cue, dict)
        else cue
    )
    return content | {"cue": fixed}


def _difference(first: Any, second: Any) -> str:
    """The first key in which two tables differ."""
    if isinstance(first, dict) and isinstance(second, dict):
        for key in sorted(first.keys() | second.keys(), key=lambda key: (key != "name", key)):
            if first.get(key) != second.get(key):
                inner = _difference(first.get(key), second.get(key))
                return f"{key}: {inner}" if inner else str(key)
    return f"{str(first)[:60]} and {str(second)[:60]}"


def _blind(groups: Sequence[str], sessions: Sequence[StudySession]) -> dict[str, str]:
    """Letters in an order that tells nothing: drawn from the sessions' own names, the same each
    time.
    """
    names = "\n".join(sorted(one.name for one in sessions))
    seed = int.from_bytes(hashlib.sha256(names.encode()).digest()[:8], "little")
    order = np.random.default_rng(seed).permutation(len(groups))
    letters = {groups[int(place)]: string.ascii_uppercase[i] for i, place in enumerate(order)}
    return dict(sorted(letters.items(), key=lambda one: one[1]))
