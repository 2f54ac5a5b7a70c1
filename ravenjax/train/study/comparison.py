"""Compares the groups of a study: effect sizes, intervals and adjusted p-values of all outcomes.

Outcomes are rates, times and sizes. Participants were randomised, and the hazards of one
participant are not independent, so every interval and p-value counts participants. If most
participants did both conditions, each is compared with themselves. The sessions of a study must
belong together. The groups of a blinded study are hidden.
"""

import dataclasses
import hashlib
import json
import math
import string
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.stats import multiplicity
from ravenjax.stats.comparison import clustered
from ravenjax.stats.intervals import Estimate
from ravenjax.store.logs.session import description
from ravenjax.train.judge.episode import HazardRow
from ravenjax.train.protocol import Json
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
CONFIDENCE = 0.95
_ALIKE = 1e-9
"""ms, mm or a share: smaller differences are rounding errors."""
_NONE = Estimate(math.nan, math.nan, math.nan)


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
    if (folder / reader.TABLE).exists() or reader.find_recording(folder) is None:
        return StudySession(folder, header, reader.read_table(folder))
    hazards = reader.from_recording(reader.read_recording(folder), header)
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


class ComparedOutcome(NamedTuple):
    """An outcome that is compared for each hazard. Its value is None for a hazard without one."""

    name: str
    unit: str
    digits: int
    # 1: more is better, -1: less is better.
    better: int
    value: Callable[[HazardRow], float | None]


def _response_ms(hazard: HazardRow) -> float | None:
    """Return the time to the response, infinite without one; None if none was right."""
    return None if hazard.right_response == "continue" else hazard.after.get("response", math.inf)


RIGHT = ComparedOutcome("right response", "%", 0, 1, lambda hazard: 100.0 * hazard.response_ok)
TIME = ComparedOutcome("time to a response", "ms", 0, -1, _response_ms)
OUTCOMES = (
    RIGHT,
    TIME,
    ComparedOutcome("largest unintended motion", "mm", 1, -1, lambda hazard: hazard.farthest_mm),
    ComparedOutcome(
        *("deepest in the tissue", "mm", 1, -1),
        lambda hazard: None if hazard.deepest_mm is None else max(0.0, hazard.deepest_mm),
    ),
)


class ComparedGroup(NamedTuple):
    """One side of a comparison of one outcome."""

    label: str
    # Participants' means; times are limited to the horizon.
    means: np.ndarray
    # Values of all hazards; a time without a response is inf.
    values: np.ndarray

    @property
    def mean(self) -> float:
        """Mean of the participants' means."""
        return float(np.mean(self.means)) if len(self.means) else math.nan

    @property
    def median(self) -> float:
        """Median of the hazards; infinite if half of them had no response."""
        ordered = np.sort(self.values)
        return float(ordered[(len(ordered) - 1) // 2]) if len(ordered) else math.nan


class GroupComparison(NamedTuple):
    """One outcome of `second` against the reference `first`. Differences are second - first."""

    outcome: ComparedOutcome
    first: ComparedGroup
    second: ComparedGroup
    paired: bool
    # Of rates in percentage points, otherwise of participants' means.
    difference: Estimate
    # Standardised difference of participants' means.
    g: Estimate
    # By a permutation test between, or within, participants. NaN: there is nothing to test.
    p: float
    # Number of participants whose conditions do not fit the design.
    left_out: int
    # p adjusted by Holm over all outcomes that vary and pairs of groups.
    adjusted: float = math.nan
    # Whether `adjusted` is below 1 - CONFIDENCE.
    clear: bool = False

    @property
    def people(self) -> int:
        return len(self.first.means) + (0 if self.paired else len(self.second.means))

    @property
    def sign(self) -> int:
        """1 if the group did better than the reference, otherwise -1."""
        return 1 if self.difference.value * self.outcome.better > 0 else -1

    @property
    def has_few(self) -> bool:
        return min(len(self.first.means), len(self.second.means)) < 2


def compare_groups(study: TrainingStudy) -> list[GroupComparison]:
    """Compare each group with the reference, the first of `study.labels`, on every outcome."""
    first, *others = study.labels.values()
    comparisons = [
        _compare(study, outcome, first, label) for label in others for outcome in OUTCOMES
    ]
    p_values = {str(i): comparison.p for i, comparison in enumerate(comparisons)}
    findings = multiplicity.holm_test(p_values, CONFIDENCE)
    return [
        comparison._replace(adjusted=findings[str(i)].adjusted, clear=findings[str(i)].rejected)
        for i, comparison in enumerate(comparisons)
    ]


def _compare(
    study: TrainingStudy, outcome: ComparedOutcome, first: str, second: str
) -> GroupComparison:
    horizon = study.horizon_ms() if outcome is TIME else math.inf
    sides = [_values_by_person(study, outcome, label, horizon) for label in (first, second)]
    both, everyone = sides[0].keys() & sides[1].keys(), sides[0].keys() | sides[1].keys()
    is_paired = 2 * len(both) > len(everyone)
    members = [sorted(both)] * 2 if is_paired else [sorted(side.keys() - both) for side in sides]
    one, two = ([side[name] for name in names] for side, names in zip(sides, members, strict=True))
    limited_one, limited_two = (
        [np.minimum(values, horizon) for values in side] for side in (one, two)
    )
    if outcome is RIGHT:
        risk = clustered.paired_risk_difference if is_paired else clustered.risk_difference
        share = risk([hits / 100.0 for hits in two], [hits / 100.0 for hits in one])
        difference = Estimate(100.0 * share.value, 100.0 * share.low, 100.0 * share.high)
    else:
        difference = clustered.mean_difference(limited_two, limited_one, is_paired=is_paired)
    means = clustered.cluster_means(limited_one), clustered.cluster_means(limited_two)
    g, p = _NONE, math.nan
    if min(map(len, means)) > 1:
        standardised = clustered.standardised_difference(means[1], means[0], is_paired=is_paired)
        g = Estimate(standardised, math.nan, math.nan)
        # Whether permuting conditions could change anything. The check does not use which group is
        # which, so leaving out outcomes that do not vary favours no result.
        spread = np.abs(means[0] - means[1]).max() if is_paired else np.ptp(np.concatenate(means))
        if spread > _ALIKE:
            p = clustered.permutation_p(limited_two, limited_one, is_paired=is_paired)
    return GroupComparison(
        outcome,
        ComparedGroup(first, means[0], np.concatenate([*one, np.zeros(0)])),
        ComparedGroup(second, means[1], np.concatenate([*two, np.zeros(0)])),
        paired=is_paired,
        difference=difference,
        g=g,
        p=p,
        left_out=len(everyone - set(members[0]) - set(members[1])),
    )


def _values_by_person(
    study: TrainingStudy, outcome: ComparedOutcome, label: str, horizon: float
) -> dict[str, np.ndarray]:
    """Return the values of each participant's hazards, infinite after the horizon."""
    values: dict[str, list[float]] = {}
    for session, group, hazard in study.rows():
        value = outcome.value(hazard) if group == label else None
        if value is not None:
            values.setdefault(session.person, []).append(math.inf if value > horizon else value)
    return {name: np.array(numbers) for name, numbers in values.items()}
