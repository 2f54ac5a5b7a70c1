"""Study: which detector knows of a fault first, and how many false alarms does it give?

Every detector is compared with the robot's checks and the cue. Faulty runs of four motions are
pooled, and kinds of faults are resampled. An alarm of a faulty run counts from the fault's first
effect on. Thresholds are chosen by false alarms per hour on fault-free motion, and never by what
they detect.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.outcomes import events
from ravenjax.outcomes.verdict import HAZARDS
from ravenjax.report import wording
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap.units import label_codes
from ravenjax.stats.intervals import alpha_of
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import OTHER_LAYER
from studies import kinds, runs
from studies.cells import BY_DEFINITION, hourly, percent, plain
from studies.haptic_cue import MOVED, design_lines, of_robot
from studies.runs import AS_MODELLED, CLUTCHED, MOTIONS, RECORDINGS, SCALE, UNCERTAIN, Runs, share
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    in_percent,
    own_line,
    read_notes,
    read_table,
    study,
)

NAME, CAMPAIGN = "detectors", "detectors.toml"
CHECKS, STOPS, CUE = "built-in checks, flag or stop", "built-in checks, stop", "haptic cue, 3 mm"
OTHERS = {CHECKS: "told_ms", STOPS: "stop_ms", CUE: "warned_ms"}
"""Other sources of alarms, and the columns of their times. Each has one threshold."""
NOISE, MORE_NOISE = "noise", "more noise"
NOISY = {AS_MODELLED: NOISE, UNCERTAIN: f"{UNCERTAIN}, {NOISE}"}
"""Names of the groups without faults in a campaign with noise."""
PER_HOUR = 1.0
"""False alarms per hour that an operating point may have."""
PUBLISHED = ("steps/all/1", 1.0)
"""The published rule: each step over its 99.8 to 99.9 percentile, all three together, for one
millisecond.
"""
FORK = ("derivative_sum", 55.0)
"""The disabled second detector of raven2_sim and its threshold."""
CLIP = ("overdrive", 1.0)
"""The control software's own clip limit."""
TIP_ERROR = "tip_error"
"""The detector whose score is the distance in mm of the reported tip from the model."""
MAIN = (PUBLISHED[0], "derivative_sum", TIP_ERROR, "overdrive")
FAST = "suture_fast"
NOISY_RECORDINGS = tuple((motion, 11) for motion in ("suture", "reach", "peg_transfer", "palpate"))
FREE_RUNS, FREE_RUNS_NOISY = 32, 8
"""Numbers of runs of the groups without faults, which come first: of all, and of the first two
groups.
"""
FREE_S = 120


def names_of(some: Runs) -> list[str]:
    """Return the names of the campaign's detectors."""
    return [detector.name for detector in some.made.detectors]


def place(some: Runs, name: str, threshold: float) -> str:
    """Return what the columns of a detector at a threshold begin with. Raises ValueError."""
    number = names_of(some).index(name)
    return f"detector{number}_threshold{some.made.detectors[number].thresholds.index(threshold)}"


def spoke_ms(faulty: Runs, name: str, threshold: float) -> np.ndarray:
    """Return when a detector, or one of OTHERS (at any threshold), first gave an alarm because of
    the fault, ms [runs]; -1: never.
    """
    if name == STOPS:
        times = np.where(faulty["response"] == "stopped", faulty["response_ms"], -1)
    else:
        times = faulty[OTHERS.get(name) or f"{place(faulty, name, threshold)}_first_ms"]
    return np.where(times >= faulty["active_ms"], times, -1)


def alarms(free: Runs, name: str, threshold: float) -> np.ndarray:
    """Return the number of separate false alarms of each run: for checks 1 if one tripped, for the
    cue its pulses.
    """
    if name == CUE:
        return free[f"cue{free.made.verdict_cue}_count"]
    if name not in OTHERS:
        return free[f"{place(free, name, threshold)}_alarms"]
    # A run without a fault is its own golden run, so its column `response` is always silent.
    actions = ("stop", "flag") if name == CHECKS else ("stop",)
    columns = [
        f"check_{check}_count"
        for check in checks.check_names(free.frame)
        if ROBOT.check(check).action in actions
    ]
    return (free.frame[columns].to_numpy() > 0).any(axis=1).astype(int)


def false_alarms(free: Runs, name: str, threshold: float) -> StudyEstimate:
    return runs.per_hour(free, alarms(free, name, threshold))


def fault_free(folder: Path, recording: str) -> Runs:
    """Read a fault-free recording. With noise, the robot as modelled gets another name."""
    free = runs.fault_free(runs.read(folder), recording)
    if free.made.config["campaign"]["noise"]:
        return Runs(free.frame.replace({"robot": NOISY}), free.made)
    # Without noise, this group repeats the robot as modelled.
    return free.where(free["robot"] != MORE_NOISE)


class Areas(NamedTuple):
    """AUC of each detector [d] and their covariance [d, d]; NaN without positives or negatives."""

    value: np.ndarray
    covariance: np.ndarray
    positives: int
    negatives: int

    def estimate(self, d: int, of: str = "positive runs") -> StudyEstimate:
        """Return one area with its normal interval, within 0..1. `of`: what the positive
        runs are.
        """
        from scipy.stats import norm

        half = norm.isf(alpha_of(0.95) / 2) * np.sqrt(max(self.covariance[d, d], 0.0))
        value = float(self.value[d])
        low, high = max(0.0, float(value - half)), min(1.0, float(value + half))
        return StudyEstimate(value, low, high, self.positives, of)


def areas(score: np.ndarray, positive: np.ndarray, kind: np.ndarray) -> Areas:
    """Return areas of score [runs, detectors] against positive (bool [runs]). `kind` [runs] is each
    run's cluster.
    """
    from scipy.stats import rankdata

    score, positive = np.asarray(score, float), np.asarray(positive, bool)
    m, n, detectors = int(positive.sum()), int((~positive).sum()), score.shape[1]
    if not m or not n:
        return Areas(np.full(detectors, np.nan), np.full((detectors, detectors), np.nan), m, n)
    rank = rankdata(score, axis=0)
    # Share of the other class that a run beats. A tie counts half.
    beats = np.empty_like(rank)
    beats[positive] = (rank[positive] - rankdata(score[positive], axis=0)) / n
    beats[~positive] = 1.0 - (rank[~positive] - rankdata(score[~positive], axis=0)) / m
    value = beats[positive].mean(axis=0)
    code, clusters = label_codes(kind)
    both, scaled = np.zeros((detectors, detectors)), []
    for members, count in ((positive, m), (~positive, n)):
        sums = np.zeros((clusters, detectors))
        np.add.at(sums, code[members], beats[members] - value)
        both += _more(len(np.unique(code[members]))) * (sums.T @ sums) / count**2
        scaled.append(sums / count)
    cross = scaled[0].T @ scaled[1]
    return Areas(value, both + _more(clusters) * (cross + cross.T), m, n)


def _more(units: int) -> float:
    """Return the correction for a small number of clusters."""
    return units / (units - 1) if units > 1 else np.nan


def scores(faulty: Runs) -> np.ndarray:
    """Return the largest score of each detector, [runs, detectors]."""
    columns = [f"detector{d}_score" for d in range(len(faulty.made.detectors))]
    return faulty.frame[columns].to_numpy(float)


class Point(NamedTuple):
    """One detector at one threshold. Rates are fractions."""

    name: str
    threshold: float  # NaN: without a threshold
    false: StudyEstimate  # false alarms per hour
    caught: StudyEstimate  # of runs with an unintended motion: those with an alarm
    before: StudyEstimate  # of these runs: those with the alarm before the motion began

    @property
    def words(self) -> str:
        """Return `tip_error, threshold 3`, or the name alone."""
        return (
            self.name
            if math.isnan(self.threshold)
            else f"{self.name}, threshold {self.threshold:g}"
        )


def threshold_for(free: Runs, name: str, per_hour: float = PER_HOUR) -> float | None:
    """Return the lowest threshold from which on a detector's false alarms do not exceed the rate;
    None if there is none.

    Raises ValueError without any hours.
    """
    hours = free["hours"].sum()
    if not hours > 0:
        raise ValueError(f"no motion without a fault to choose a threshold of {name} on")
    thresholds = sorted(next(one.thresholds for one in free.made.detectors if one.name == name))
    rates = np.array([alarms(free, name, one).sum() / hours for one in thresholds])
    quiet = np.logical_and.accumulate((rates <= per_hour)[::-1])[::-1]
    return float(np.array(thresholds)[quiet][0]) if quiet.any() else None


def point(faulty: Runs, free: Runs, name: str, threshold: float = math.nan) -> Point:
    """Return the performance of a detector, or one of OTHERS, at a threshold."""
    rates = caught(faulty, name, threshold), before(faulty, name, threshold)
    return Point(name, threshold, false_alarms(free, name, threshold), *rates)


def by_definition(faulty: Runs, name: str, threshold: float) -> bool:
    """Return whether the definitions alone decide that an alarm comes with the unintended motion or
    after it.

    This holds for the distance of the tip from the model at the motion's limit or beyond (except
    for the difference between reported and true tip). It also holds for a stop, because the robot
    is then not live.
    """
    rules = faulty.made.rules
    far = rules.threshold_mm if name == CUE else threshold if name == TIP_ERROR else math.nan
    return name == STOPS or far >= rules.limit_mm


def caught(faulty: Runs, name: str, threshold: float) -> StudyEstimate:
    """Return the share of the runs with an unintended motion that have an alarm at a threshold."""
    moved = faulty["unintended"]
    return share(spoke_ms(faulty, name, threshold) >= 0, moved, faulty.faults, MOVED)


def before(faulty: Runs, name: str, threshold: float) -> StudyEstimate:
    """Return the share of these runs with the alarm before the motion began."""
    if by_definition(faulty, name, threshold):
        return BY_DEFINITION
    times = spoke_ms(faulty, name, threshold)
    early = (times >= 0) & (times < faulty["unintended_ms"])
    return share(early, faulty["unintended"], faulty.faults, MOVED)


def layer_table(faulty: Runs, chosen: Sequence[Point]) -> Table:
    """Return the share of unintended motion detected, by layer of the fault."""
    moved = faulty.where(faulty["unintended"])
    layers, rows = moved["layer"].astype(str), []
    for layer in (*LAYERS.values(), OTHER_LAYER):
        part = moved.where(layers == layer)
        if len(part.frame):
            shares = (percent(caught(part, one.name, one.threshold)) for one in chosen)
            cells = len(np.unique(part["cell"]))
            rows.append((layer, len(part.frame), cells, kinds.count(part.faults), *shares))
    return read_table(NAME, "layers", rows, chosen=" | ".join(one.words for one in chosen))


def robot_table(faulty: Runs, free: Runs, main: Sequence[str]) -> Table:
    """Return how an uncertain robot and noise change false alarms, and the threshold that would be
    needed.
    """
    modelled, rows = of_robot(free, AS_MODELLED), []
    for robot in dict.fromkeys(free["robot"].tolist()):
        if robot == AS_MODELLED:
            continue
        mine = of_robot(free, robot)
        same = modelled.where(np.isin(modelled["recording"], mine["recording"]))
        for name in main:
            threshold, needed = threshold_for(same, name), threshold_for(mine, name)
            rates = ["", ""]
            if threshold is not None:
                rates = [hourly(false_alarms(part, name, threshold)) for part in (same, mine)]
            shares = [
                "" if one is None else percent(caught(faulty, name, one))
                for one in (threshold, needed)
            ]
            told = ["none is quiet" if one is None else one for one in (threshold, needed)]
            rows.append((robot, name, told[0], *rates, told[1], *shares))
        for name in (CUE, CHECKS):
            rates = [hourly(false_alarms(part, name, np.nan)) for part in (same, mine)]
            rows.append((robot, name, "", *rates, "", "", ""))
    return read_table(NAME, "robots", rows)


def condition_table(
    faulty: Runs, fast: Runs, others: Mapping[str, Runs], modelled: Runs, main: Sequence[str]
) -> Table:
    """Return how the motion on which a threshold must be quiet changes the threshold, and so the
    share detected.
    """
    still_down = unclutched(modelled)
    conditions = (
        ("every motion and scale", modelled, faulty, 0.1),
        ("every motion, scale 0.1", at_scale(modelled, 0.1), faulty, 0.1),
        ("no clutching, scale 0.1", at_scale(still_down, 0.1), faulty, 0.1),
        ("every motion and scale", modelled, fast, 0.2),
        ("no clutching, scale 0.2", at_scale(still_down, 0.2), fast, 0.2),
        *((f"every; faults: {words}", modelled, some, 0.1) for words, some in others.items()),
    )
    rows = []
    for words, free, some, scale in conditions:
        for name in main if free["hours"].sum() > 0 else ():
            threshold = threshold_for(free, name)
            cells: tuple[str | float, ...] = ("none is quiet", "", "", "", "")
            if threshold is not None:
                found, spoke = point(some, free, name, threshold), spoke_ms(some, name, threshold)
                others = share(spoke >= 0, ~some["unintended"], some.faults, "")
                rates = map(percent, (found.caught, others, found.before))
                cells = (threshold, hourly(found.false), *rates)
            rows.append((words, scale, name, *cells))
    return read_table(NAME, "conditions", rows, per_hour=PER_HOUR)


def hazard_table(faulty: Runs, main: Sequence[str]) -> Table:
    """Return how areas depend on what a detector is to detect."""
    listed, score, kind = names_of(faulty), scores(faulty), kinds.names(faulty["group"])
    hazard, leapt = faulty["hazard"], faulty["jump_tip"].astype(bool)
    jumped = faulty[faulty.made.verdict_jump].astype(bool)
    calm = (hazard == "none") & ~jumped & ~leapt
    told = {
        **{f"{word}, the run's hazard": hazard == word for word in HAZARDS if word != "none"},
        "jump of the true tip": leapt,
        "jump of the reported tip alone": jumped & ~leapt,
    }
    rows = []
    for words, hit in told.items():
        mine = hit | calm
        auc = areas(score[mine], hit[mine], kind[mine])
        cells = (plain(auc.estimate(listed.index(name))) for name in main)
        rows.append((words, auc.positives, *cells))
    count = wording.format_count(int(calm.sum()))
    return read_table(NAME, "hazards", rows, calm=count, main=" | ".join(main))


def unclutched(free: Runs) -> Runs:
    """Return motion in which the pedal stays down."""
    return free.where(~np.char.startswith(free["recording"].astype(str), CLUTCHED))


def at_scale(free: Runs, scale: float) -> Runs:
    return free.where(np.isclose(free[SCALE], scale))


def compare(context: Context) -> Findings:
    """Compare all detectors over the same runs."""
    faulty = runs.pooled([runs.read(context.folders[name]) for name in MOTIONS])
    fast = runs.pooled([runs.read(context.folders[FAST])])
    free = runs.joined(
        [
            fault_free(context.folders[f"{kind}_{motion}_{seed}"], f"{motion} {seed}")
            for kind, recordings in (("free", RECORDINGS), ("noise", NOISY_RECORDINGS))
            for motion, seed in recordings
        ]
    )
    modelled = of_robot(free, AS_MODELLED)
    points: dict[str, Point] = {}
    for name in names_of(faulty):
        threshold = threshold_for(modelled, name)
        if threshold is not None:
            points[name] = point(faulty, modelled, name, threshold)
    steps = [one for name, one in points.items() if name.startswith("steps")]
    best = max(steps, key=lambda one: one.caught.value, default=None)
    main = tuple(dict.fromkeys([MAIN[0], *([best.name] if best else []), *MAIN[1:]]))
    quiet = [points[name] for name in main if name in points]
    published = [point(faulty, modelled, *one) for one in (PUBLISHED, FORK, CLIP)]
    others = [point(faulty, modelled, name) for name in OTHERS]
    hours = float(modelled["hours"].sum())
    notes = read_notes(
        NAME,
        motion=events.event_meaning("unintended_motion", faulty.made.rules),
        hours=hours,
        recordings=len(np.unique(modelled["recording"])),
        unseen=alarm_rate(0, hours).high,
        per_hour=PER_HOUR,
        kinds=kinds.NOTE,
    )
    return Findings(
        lines=tuple(_lines(faulty, modelled, quiet, published, others)),
        tables=(
            layer_table(faulty, [*quiet, *others]),
            robot_table(faulty, free, main),
            condition_table(faulty, fast, runs.by_packets(context.folders), modelled, main),
            hazard_table(faulty, main),
        ),
        notes=notes,
    )


def _lines(
    faulty: Runs,
    modelled: Runs,
    quiet: Sequence[Point],
    published: Sequence[Point],
    others: Sequence[Point],
) -> Iterator[Line]:
    auc = areas(scores(faulty), faulty["unintended"], kinds.names(faulty["group"]))
    yield from design_lines(faulty, modelled)
    for one in quiet:
        area = auc.estimate(names_of(faulty).index(one.name), MOVED)
        yield own_line(f"AUC, {one.name}", "", area)

    def rates(one: Point, words: str, early: bool, false: bool) -> Iterator[Line]:
        caught, before = one.caught, one.before
        yield own_line(f"{words}: {CAUGHT}", "%", in_percent(caught, caught.n, caught.of))
        if early and before is not BY_DEFINITION:
            value = in_percent(before, before.n, before.of)
            yield own_line(f"{words}: caught before it began", "%", value)
        if false:
            yield own_line(f"{words}: false alarms", "1/h", one.false)

    for one in quiet:
        yield from rates(one, one.words, early=True, false=False)
    slow = at_scale(unclutched(modelled), 0.1)
    for one in quiet if slow["hours"].sum() > 0 else ():
        threshold = threshold_for(slow, one.name)
        if threshold is not None:
            words = f"{one.name}, threshold {threshold:g}, quiet at scale 0.1 without clutching"
            there = point(faulty, slow, one.name, threshold)
            yield from rates(there, words, early=False, false=False)
    for one in published:
        yield from rates(one, one.words, early=False, false=True)
    for one in others:
        yield from rates(one, one.words, early=True, false=True)


CAUGHT = "unintended motion caught"


def _variants() -> tuple[Variant, ...]:
    question, noise = "How often is there an alarm for nothing?", ("campaign.noise=true",)
    free = (runs.free_variant(CAMPAIGN, one, FREE_RUNS, FREE_S, question) for one in RECORDINGS)
    noisy = (
        runs.free_variant(CAMPAIGN, one, FREE_RUNS_NOISY, FREE_S, "And with noise?", NOISE, noise)
        for one in NOISY_RECORDINGS
    )
    fast = Variant(FAST, CAMPAIGN, ("operator.scale=0.2",), "And at twice the scale?")
    return (*runs.faulty_variants(CAMPAIGN), fast, *free, *noisy)


STUDY = study(NAME, variants=_variants(), compare=compare)
