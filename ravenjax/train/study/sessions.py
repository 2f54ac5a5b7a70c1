"""Collects the sessions of a study.

It reads the sessions, checks that they belong together, and hides the groups of a blinded study.
"""

import dataclasses
import hashlib
import json
import string
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.logs.session import description
from ravenjax.train.judge.episode import HazardRow
from ravenjax.train.protocol.messages import Json
from ravenjax.train.recording import hazards as hazard_table
from ravenjax.train.recording import reader
from ravenjax.train.recording.folders import SessionFolder

BY = ("group", "cue")
"""What sessions may be compared by."""
_REFERENCES = ("off", "control", "none", "without", "no cue", "0")
_LONGEST = 6
"""The largest number of names in an error message."""
DEFAULT_HORIZON_MS = 2000.0
"""Horizon of sessions whose header lists no hazards."""
UNDECIDED = ("", "interrupted")
"""Outcomes of hazards that were cut off, but not by the operator. They count for no group."""


@dataclasses.dataclass(frozen=True)
class StudySession(SessionFolder):
    """A session of the study."""

    hazards: list[HazardRow]
    # Whether the hazards come from the recording, as far as it goes.
    cut_short: bool = False

    @property
    def name(self) -> str:
        return str(self.header.get("name") or self.path.name)

    @property
    def person(self) -> str:
        """The participant. A session without a participant counts as a separate person."""
        return self.participant or f"(session {self.name})"

    def groups(self, by: str) -> dict[str, list[HazardRow]]:
        """Return the hazards that became active and were decided, by condition."""
        groups: dict[str, list[HazardRow]] = {}
        for hazard in self.hazards:
            if hazard.struck_ms is not None and hazard.outcome not in UNDECIDED:
                condition = hazard.cue if by == "cue" else str(self.header.get("group") or "")
                groups.setdefault(condition, []).append(hazard)
        return groups


@dataclasses.dataclass(frozen=True)
class TrainingStudy:
    """Sessions that may be compared. labels: shown name of each group, the reference first."""

    sessions: list[StudySession]
    by: str
    labels: dict[str, str]
    blinded: bool
    # Sentences that a reader of the study must know about the sessions.
    notes: list[str]

    def rows(self) -> list[tuple[StudySession, str, HazardRow]]:
        """Return session, label of its group and hazard for every hazard that became active."""
        return [
            (session, self.labels[condition], hazard)
            for session in self.sessions
            for condition, hazards in session.groups(self.by).items()
            for hazard in hazards
        ]

    def horizon_ms(self) -> float:
        """Shortest time for a response, ms. Later responses count as none."""
        limits = [
            1e3 * float(listed["within_s"])
            for session in self.sessions
            for listed in session.header.get("hazards") or []
            if "within_s" in listed
        ]
        return min(limits, default=DEFAULT_HORIZON_MS)


def collect_sessions(
    folders: Iterable[Path], by: str | None = None, *, unblind: bool = False, mixed: bool = False
) -> TrainingStudy:
    """Read sessions: each folder is a session, or holds some at any depth.

    by: "group" or "cue"; None: the one that differs, "group" first. unblind: show the conditions of
    the groups in blinded sessions. mixed: take sessions of several scenarios or versions together,
    and say so in a note. Raises UserError if there is nothing to compare or the sessions are not of
    one study, StoreError if a file is damaged.
    """
    if by is not None and by not in BY:
        raise UserError(f"compare by {by!r}: expected one of {', '.join(BY)}")
    found: dict[Path, Path] = {}
    for folder in map(Path, folders):
        inside = sorted(path.parent for path in folder.rglob(description.FILE))
        if not inside:
            raise UserError(
                f"{folder} contains no session; expected folders that `ravenjax train` wrote, or a"
                " folder of them"
            )
        found |= {session.resolve(): session for session in inside}
    sessions = [_read_session(folder) for folder in found.values()]
    valid = [session for session in sessions if session.groups("cue")]
    left_out = [
        f"Left out: {session.name}, because no hazard became active and was decided."
        for session in sessions
        if session not in valid
    ]
    if not valid:
        listed = " ".join(left_out[:_LONGEST])
        raise UserError(
            f"a study needs sessions in which hazards became active and were decided. {listed}"
        )
    folders_by_key: dict[tuple[str, str, str], Path] = {}
    for session in valid:
        key = session.person, session.started, session.name
        if (first := folders_by_key.setdefault(key, session.path)) != session.path:
            raise UserError(f"{session.path} is a copy of {first}; give each session once")
    notes = _mixtures(valid, mixed) + _describe_cuts(valid) + left_out
    conditions = {key: {name for session in valid for name in session.groups(key)} for key in BY}
    by = by or ("group" if len(conditions["group"]) > 1 else "cue")
    groups = sorted(conditions[by], key=lambda name: (name.lower() not in _REFERENCES, name))
    if len(groups) < 2:
        raise UserError(
            f"all {len(valid)} sessions have {by} {groups[0]!r}, so there is nothing to compare."
            f" Give sessions of another {by} too" + ("" if by == "cue" else ", or use --by cue")
        )
    blinded = any(session.header.get("blinded") for session in valid) and not unblind
    if blinded:
        labels = _letters(groups, valid)
    else:
        labels = {name: f"cue {name}" if by == "cue" else name or "(no group)" for name in groups}
    return TrainingStudy(valid, by, labels, blinded, notes)


def _read_session(folder: Path) -> StudySession:
    header = description.read_session(folder)
    description.require_unchanged(folder, header)
    if (folder / hazard_table.FILE).exists() or reader.find_recording(folder) is None:
        return StudySession(folder, header, hazard_table.read_table(folder))
    hazards = hazard_table.from_recording(reader.read_recording(folder), header)
    return StudySession(folder, header, hazards, cut_short=True)


def _describe_cuts(sessions: Sequence[StudySession]) -> list[str]:
    notes = []
    if short := [session.name for session in sessions if session.cut_short]:
        notes.append(
            f"Sessions that were cut short count up to the end of their recordings:"
            f" {', '.join(short)}."
        )
    outcomes = [
        hazard.outcome
        for session in sessions
        for hazard in session.hazards
        if hazard.struck_ms is not None
    ]
    if cut := sum(outcome in UNDECIDED for outcome in outcomes):
        notes.append(
            f"{cut} of {len(outcomes)} hazards are left out because others cut them off (a pause, a"
            " reset, a lost console, the end)."
        )
    return notes


def _mixtures(sessions: Sequence[StudySession], mixed: bool) -> list[str]:
    """Return notes on differing scenarios or versions. Raises UserError unless `mixed`."""
    notes = []
    for what, content_of in (
        ("scenarios", _fixed_scenario),
        ("versions", lambda one: one.header.get("versions") or {}),
    ):
        kinds: dict[str, StudySession] = {}
        for session in sessions:
            kinds.setdefault(json.dumps(content_of(session), sort_keys=True), session)
        if len(kinds) > 1:
            first, second = list(kinds.values())[:2]
            tables = content_of(first), content_of(second)
            keys = [
                key
                for key in dict.fromkeys(["name", *tables[0], *tables[1]])
                if tables[0].get(key) != tables[1].get(key)
            ]
            difference = f"{len(kinds)} different {what}, which differ in {', '.join(keys)}"
            if not mixed:
                raise UserError(
                    f"the sessions are not of one study: they have {difference} ({first.name}"
                    f" against {second.name}). Give the sessions of one study, or use --mixed"
                )
            notes.append(f"Sessions with {difference} are taken together.")
    return notes


def _fixed_scenario(session: StudySession) -> Json:
    content = session.header.get("scenario") or {}
    return content | {"cue": (content.get("cue") or {}) | {"on": None, "blinded": None}}


def _letters(groups: Sequence[str], sessions: Sequence[StudySession]) -> dict[str, str]:
    """Return letters for the groups in an order that the sessions' names determine."""
    names = "\n".join(sorted(session.name for session in sessions))
    seed = int.from_bytes(hashlib.sha256(names.encode()).digest()[:8], "little")
    order = np.random.default_rng(seed).permutation(len(groups))
    ordered = [groups[int(place)] for place in order]
    return dict(zip(ordered, string.ascii_uppercase, strict=False))
