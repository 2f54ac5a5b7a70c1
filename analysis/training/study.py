"""Plans training studies with participants, assigns participants to groups, compares the groups,
and writes a page and a table.

Participants are randomised, and the hazards of one participant are not independent. Therefore the
participant is the unit of every interval and p value. If most participants did both conditions, the
comparison is paired within participants. The groups of a blinded study are hidden.

A permutation test with few people has few permutations, so even the largest effect has no small p.
Holm's adjustment multiplies the smallest p of a family by the number of its comparisons. If the
result stays above 1 - confidence, no result can be clear, and the study should not begin.
"""

import dataclasses
import hashlib
import math
import string
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.training import clustered
from analysis.training.clustered import DRAWS
from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.errors import StoreError, UserError, format_value
from ravenjax.stats import multiplicity
from ravenjax.stats.intervals import Estimate, alpha_of
from ravenjax.store.files import hash_file, path_inside, require_writable, write_text
from ravenjax.store.logs.session import description
from ravenjax.train.judge import HazardRow
from ravenjax.train.protocol import Json
from ravenjax.train.recording import reader
from ravenjax.train.recording.reader import SessionFolder

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


def collect_sessions(folders: Iterable[Path], unblind: bool = False) -> TrainingStudy:
    """Read sessions: each folder is a session, or holds some at any depth.

    They are compared by their groups, or by the cue if all are of one group. unblind: show the
    conditions of the groups in blinded sessions. Raises UserError if there is nothing to compare or
    the sessions are not of one study, StoreError if a file is damaged.
    """
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
    _require_one_study(valid)
    by, conditions = "group", {name for session in valid for name in session.groups("group")}
    if len(conditions) < 2:
        by, conditions = "cue", {name for session in valid for name in session.groups("cue")}
    groups = sorted(conditions, key=lambda name: (name.lower() not in _REFERENCES, name))
    if len(groups) < 2:
        raise UserError(
            f"all {len(valid)} sessions have one group and {by} {groups[0]!r}, so there is nothing"
            " to compare. Give sessions of another group too"
        )
    blinded = any(session.header.get("blinded") for session in valid) and not unblind
    if blinded:
        labels = _letters(groups, valid)
    else:
        labels = {name: f"cue {name}" if by == "cue" else name or "(no group)" for name in groups}
    return TrainingStudy(valid, by, labels, blinded, _describe_cuts(valid) + left_out)


def _read_session(folder: Path) -> StudySession:
    header = description.read_session(folder)
    _require_unchanged(folder, header)
    recording = None if (folder / reader.TABLE).exists() else reader.read_recording(folder)
    if recording is None:
        return StudySession(folder, header, reader.read_table(folder))
    hazards = reader.from_recording(recording, header)
    return StudySession(folder, header, hazards, cut_short=True)


def _require_unchanged(folder: Path, header: Json) -> None:
    """Raise StoreError if a file of the session differs from the checksum that it had when the
    session ended.
    """
    for name, digest in (header.get("sha256") or {}).items():
        path = path_inside(folder, name)
        if path.is_file() and hash_file(path) != digest:
            raise StoreError(
                f"{path}: has changed since the session ended (its sha256 is not that of"
                f" {description.FILE}): restore it, or leave this session out"
            )


def _describe_cuts(sessions: Sequence[StudySession]) -> list[str]:
    notes = []
    if short := ", ".join(session.name for session in sessions if session.cut_short):
        notes.append(f"Sessions that were cut short count up to their recordings' end: {short}.")
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


def _require_one_study(sessions: Sequence[StudySession]) -> None:
    """Raise UserError if scenarios or versions differ."""
    for what in ("scenario", "versions"):
        first: Json = {}
        for session in sessions:
            content: Json = dict(session.header.get(what) or {})
            # Sessions with and without the cue are compared.
            content["cue"] = (content.get("cue") or {}) | {"on": None, "blinded": None}
            first = first or content
            keys = [key for key in first | content if first.get(key) != content.get(key)]
            if keys:
                raise UserError(
                    f"the sessions are not of one study: the {what} of {sessions[0].name} and"
                    f" {session.name} differs in {', '.join(keys)}. Give the sessions of one study"
                )


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
    if hazard.right_response == "continue":
        return None
    return hazard.times_after_activation.get("response", math.inf)


RIGHT = ComparedOutcome("right response", "%", 0, 1, lambda hazard: 100.0 * hazard.response_ok)
TIME = ComparedOutcome("time to a response", "ms", 0, -1, _response_ms)
OUTCOMES = (
    RIGHT,
    TIME,
    ComparedOutcome(
        *("largest unintended motion", "mm", 1, -1), lambda hazard: hazard.peak_unintended_mm
    ),
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


def write_study(folders: Iterable[Path], out: Path, unblind: bool = False) -> StudyResult:
    """Write study.html, study.csv (one row a hazard) and study.txt; see `collect_sessions`."""
    # jinja takes a while to import.
    from ravenjax.document import html

    study = collect_sessions(folders, unblind)
    comparisons = compare_groups(study)
    tested = [comparison for comparison in comparisons if not math.isnan(comparison.p)]
    floors = [smallest_p(comparison.people, comparison.paired) for comparison in tested]
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
    environment = html.template_environment("ravenjax.train", "training")
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


MOST = 10_000
"""The largest number of participants that a plan considers."""
POWER = 0.8
_ALPHA = alpha_of(CONFIDENCE)


class Assignment(NamedTuple):
    """One participant's condition; `block` counts from 0."""

    participant: str
    group: str
    block: int


def assign_groups(
    participants: Sequence[str], groups: Sequence[str], seed: int
) -> list[Assignment]:
    """Assign participants to groups in permuted blocks.

    In each block every group comes twice, in random order. The same arguments give the same list,
    to which participants may be appended. Raises UserError if names repeat.
    """
    for what, names in (("participants", participants), ("groups", groups)):
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise UserError(
                f"{what}: {', '.join(repeated)} given more than once; expected each name once"
            )
    if seed < 0:
        raise UserError(f"seed is {seed}, expected 0 or more")
    if len(groups) < 2:
        raise UserError(f"groups: got {format_value(groups)}, expected at least two to compare")
    assignments = []
    for number, first in enumerate(range(0, len(participants), 2 * len(groups))):
        order = np.random.default_rng([seed, number]).permutation(list(groups) * 2).tolist()
        assignments += [
            Assignment(person, group, number)
            for person, group in zip(participants[first:], order, strict=False)
        ]
    return assignments


class StudyPlan(NamedTuple):
    """The results that a study of this size can reach."""

    participants: int  # in both groups together
    paired: bool  # whether each participant does both conditions
    smallest_p: float
    adjusted: float  # the smallest p after Holm's adjustment
    # Participants needed so that any comparison can be clear, in both groups together.
    needed: int
    # Participants needed for the requested effect; None: no effect was requested.
    for_effect: int | None


def plan_study(participants: int, paired: bool = True, effect: float | None = None) -> StudyPlan:
    """Compute what `participants` can show if two groups are compared on every outcome.

    effect: standardised difference (Cohen's d; of differences if paired) to be found with a power
    of `POWER`. Raises UserError if a number makes no sense.
    """
    if participants < 1:
        raise UserError(f"participants is {participants}, expected at least 1")
    if effect is not None and not 0.0 < effect < math.inf:
        raise UserError(f"effect is {effect:g}, expected a number above 0, such as 0.5")
    smallest = smallest_p(participants, paired)
    needed = _least(lambda n: len(OUTCOMES) * smallest_p(n, paired) <= _ALPHA)
    for_effect = None
    if effect is not None:
        # The import is slow.
        from statsmodels.stats.power import TTestIndPower, TTestPower

        test, each = (TTestPower(), 1) if paired else (TTestIndPower(), 2)
        # Student's t-test at Holm's first level.
        level = _ALPHA / len(OUTCOMES)
        least = _least(lambda n: n > 1 and float(test.power(effect, n, level)) >= POWER)
        for_effect = max(needed, each * least)
    adjusted = min(1.0, len(OUTCOMES) * smallest)
    return StudyPlan(participants, paired, smallest, adjusted, needed, for_effect)


def smallest_p(participants: int, paired: bool = True) -> float:
    """Return the least two-sided p of a permutation test of two groups; 1 below two people each."""
    if paired:
        ways = 2**participants if participants > 1 else 1
    else:
        ways = math.comb(participants, participants // 2) if participants > 3 else 1
    return min(1.0, 2.0 / min(ways, DRAWS + 1))


def describe_plan(plan: StudyPlan) -> str:
    """Return the plan in words."""
    design = "who do both conditions" if plan.paired else "each in one group"
    possible = plan.adjusted <= _ALPHA
    verdict = "a clear result is possible" if possible else "no result can be clear"
    lines = [
        f"{plan.participants} participants, {design}: the smallest p is {plan.smallest_p:.3g};"
        f" after Holm over {len(OUTCOMES)} comparisons {plan.adjusted:.3g}: {verdict}.",
        f"A clear result needs at least {plan.needed} participants.",
    ]
    if plan.for_effect is not None:
        lines.append(f"For the given effect and power: {plan.for_effect} participants.")
    lines.append(
        "An outcome that does not vary is not compared, which helps; participants who drop out"
        " make a clear result harder."
    )
    return "\n".join(lines)


def _least(enough: Callable[[int], bool]) -> int:
    least = next((number for number in range(1, MOST + 1) if enough(number)), None)
    if least is None:
        raise UserError(f"more than {MOST} participants are needed: choose a larger effect")
    return least
