"""Study: which detector detects a fault first, and how many false alarms does it raise?

Every detector is compared with the robot's checks and the cue. Faulty runs of four motions are
pooled, and kinds of faults are resampled. An alarm of a faulty run counts from the fault's first
effect on. Thresholds are chosen only by their false alarms per hour in fault-free motion, not by
their detections.
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
from ravenjax.stats.intervals import alpha_of
from ravenjax.stats.units import label_codes
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import OTHER_LAYER
from studies import kinds, runs, study
from studies.cells import BY_DEFINITION, hourly, percent, plain
from studies.runs import AS_MODELLED, MOVED, SCALE, UNCERTAIN, Runs, of_robot, share, unclutched

NAME = "detectors"
CHECKS, STOPS, CUE = "built-in checks, alarm or stop", "built-in checks, stop", "haptic cue, 3 mm"
OTHERS = {CHECKS: "told_ms", STOPS: "stop_ms", CUE: "warned_ms"}
"""Other sources of alarms, and the columns of their times. Each has one threshold."""
NOISE, MORE_NOISE = "noise", "more noise"
NOISY = {AS_MODELLED: NOISE, UNCERTAIN: f"{UNCERTAIN}, {NOISE}"}
"""Names of the groups without faults in a campaign with noise."""
PER_HOUR, NO_THRESHOLD = 1.0, "no threshold meets the limit"
"""Limit of false alarms per hour for a threshold, and the words if no threshold meets it."""
PUBLISHED, FORK, CLIP = ("steps/all/1", 1.0), ("derivative_sum", 55.0), ("overdrive", 1.0)
"""The published rule (all three steps over their 99.8 to 99.9 percentiles in one millisecond), the
disabled second detector of raven2_sim, and the limit of the control software's overdrive check.
"""
TIP_ERROR = "tip_error"
"""The detector whose score is the distance in mm of the reported tip from the model."""
MAIN = (PUBLISHED[0], FORK[0], TIP_ERROR, CLIP[0])
FAST, EVERY_CYCLE = "suture_fast", "every_cycle"
"""Variants of the first motion: at twice the scale, and with a packet in each control cycle."""


def names_of(some: Runs) -> list[str]:
    """Return the names of the campaign's detectors."""
    return [detector.name for detector in some.made.detectors]


def place(some: Runs, name: str, threshold: float) -> str:
    """Return what the columns of a detector at a threshold begin with. Raises ValueError."""
    number = names_of(some).index(name)
    return f"detector{number}_threshold{some.made.detectors[number].thresholds.index(threshold)}"


def spoke_ms(faulty: Runs, name: str, threshold: float) -> np.ndarray:
    """Return the first alarm of a detector, or of OTHERS, after the fault, ms [runs]; -1: never."""
    if name == STOPS:
        times = np.where(faulty["response"] == "stopped", faulty["response_ms"], -1)
    else:
        times = faulty[OTHERS.get(name) or f"{place(faulty, name, threshold)}_first_ms"]
    return np.where(times >= faulty["active_ms"], times, -1)


def alarms(free: Runs, name: str, threshold: float) -> np.ndarray:
    """Return the number of separate false alarms of each run. For checks this is at most 1."""
    if name == CUE:
        return free[f"cue{free.made.verdict_cue}_count"]
    if name not in OTHERS:
        return free[f"{place(free, name, threshold)}_alarms"]
    # A run without a fault is its own golden run, so its column `response` is always silent.
    actions = ("stop", "flag") if name == CHECKS else ("stop",)
    tripping = [n for n in checks.check_names(free.frame) if ROBOT.check(n).action in actions]
    counts = free.frame[[f"check_{check}_count" for check in tripping]]
    return (counts.to_numpy() > 0).any(axis=1).astype(int)


def false_alarms(free: Runs, name: str, threshold: float = math.nan) -> study.StudyEstimate:
    return runs.per_hour(free, alarms(free, name, threshold))


def fault_free(folder: Path) -> Runs:
    """Read a fault-free recording. With noise, the robot as modelled gets another name."""
    free = runs.fault_free(folder)
    if free.made.config["campaign"]["noise"]:
        return Runs(free.frame.replace({"robot": NOISY}), free.made)
    # Without noise, this group repeats the robot as modelled.
    return free.where(free["robot"] != MORE_NOISE)


def areas(
    score: np.ndarray, positive: np.ndarray, kind: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the AUC of score [runs, d] against positive (bool [runs]), [d], and its covariance
    [d, d] if runs of one `kind` [runs] are a cluster.
    """
    from scipy.stats import rankdata

    def correction(units: int) -> float:
        return units / (units - 1) if units > 1 else np.nan

    rank, (code, clusters) = rankdata(score, axis=0), label_codes(kind)
    value, both, scaled = np.zeros(0), np.zeros(2 * (score.shape[1],)), []
    for members in (positive, ~positive):
        # Share of the other class that a run beats. A tie counts half.
        own = rank[members] - rankdata(score[members], axis=0)
        beats, count = own / (~members).sum(), int(members.sum())
        if members is positive:
            value = beats.mean(axis=0)
        else:
            beats = 1.0 - beats
        sums = np.zeros((clusters, score.shape[1]))
        np.add.at(sums, code[members], beats - value)
        both += correction(len(np.unique(code[members]))) * (sums.T @ sums) / count**2
        scaled.append(sums / count)
    cross = scaled[0].T @ scaled[1]
    return value, both + correction(clusters) * (cross + cross.T)


def area_estimates(
    faulty: Runs, positive: np.ndarray, of: str = ""
) -> dict[str, study.StudyEstimate]:
    """Return the AUC of each detector's largest score, with its normal interval within 0..1."""
    from scipy.stats import norm

    names, count = names_of(faulty), int(positive.sum())
    score = faulty.frame[[f"detector{d}_score" for d in range(len(names))]].to_numpy(float)
    value, covariance = areas(score, positive, kinds.names(faulty["group"]))
    half = norm.isf(alpha_of(0.95) / 2) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    ends = np.stack([value, *np.clip([value - half, value + half], 0.0, 1.0)], axis=1).tolist()
    return {
        name: study.StudyEstimate(*numbers, count, of)
        for name, numbers in zip(names, ends, strict=True)
    }


class Point(NamedTuple):
    """One detector, or one of OTHERS, at one threshold. Rates are fractions."""

    name: str
    threshold: float  # NaN: without a threshold
    false: study.StudyEstimate  # false alarms per hour
    caught: study.StudyEstimate  # of runs with an unintended motion: those with an alarm
    before: study.StudyEstimate  # of these runs: those with the alarm before the motion began

    @property
    def words(self) -> str:
        """Return `tip_error, threshold 3`, or the name alone."""
        some = "" if math.isnan(self.threshold) else f", threshold {self.threshold:g}"
        return self.name + some


def threshold_for(free: Runs, name: str, per_hour: float = PER_HOUR) -> float | None:
    """Return the lowest threshold from which on false alarms do not exceed the rate, or None."""
    hours = free["hours"].sum()
    if not hours > 0:
        raise ValueError(f"no motion without a fault to choose a threshold of {name} on")
    thresholds = sorted(free.made.detectors[names_of(free).index(name)].thresholds)
    loud = [alarms(free, name, at).sum() / hours > per_hour for at in thresholds]
    first = max(np.flatnonzero(loud), default=-1) + 1
    return thresholds[first] if first < len(thresholds) else None


def point(faulty: Runs, free: Runs, name: str, threshold: float = math.nan) -> Point:
    """Return the performance of a detector, or one of OTHERS, at a threshold."""
    times, moved = spoke_ms(faulty, name, threshold), faulty["unintended"]
    # A robot that was stopped is not live, so no unintended motion begins after a stop.
    before = BY_DEFINITION
    if name != STOPS:
        early = (times >= 0) & (times < faulty["unintended_ms"])
        before = share(early, moved, faulty.faults, MOVED)
    false, told = false_alarms(free, name, threshold), caught(faulty, name, threshold)
    return Point(name, threshold, false, told, before)


def caught(faulty: Runs, name: str, threshold: float) -> study.StudyEstimate:
    """Return the share of the runs with an unintended motion that have an alarm at a threshold."""
    spoke = spoke_ms(faulty, name, threshold) >= 0
    return share(spoke, faulty["unintended"], faulty.faults, MOVED)


def layer_rows(faulty: Runs, chosen: Sequence[Point]) -> Iterator[tuple[str | int, ...]]:
    """Yield the recall of unintended motions, by layer of the fault."""
    moved = faulty.where(faulty["unintended"])
    layers = moved["layer"].astype(str)
    for layer in (*LAYERS.values(), OTHER_LAYER):
        part = moved.where(layers == layer)
        if len(part.frame):
            shares = (percent(caught(part, at.name, at.threshold)) for at in chosen)
            cells = len(np.unique(part["cell"]))
            yield layer, len(part.frame), cells, kinds.count(part.faults), *shares


def robot_rows(faulty: Runs, free: Runs, main: Sequence[str]) -> Iterator[tuple[str | float, ...]]:
    """Yield false alarms of uncertain robots and with noise, and the thresholds chosen on them."""
    modelled = of_robot(free, AS_MODELLED)
    for robot in dict.fromkeys(free["robot"].tolist()):
        if robot == AS_MODELLED:
            continue
        mine = of_robot(free, robot)
        same = modelled.where(np.isin(modelled["recording"], mine["recording"]))
        for name in main:
            chosen = threshold_for(same, name), threshold_for(mine, name)
            rates = ["", ""]
            if chosen[0] is not None:
                rates = [hourly(false_alarms(part, name, chosen[0])) for part in (same, mine)]
            shares = ("" if at is None else percent(caught(faulty, name, at)) for at in chosen)
            told = [NO_THRESHOLD if at is None else at for at in chosen]
            yield robot, name, told[0], *rates, told[1], *shares
        for name in (CUE, CHECKS):
            rates = (hourly(false_alarms(part, name)) for part in (same, mine))
            yield robot, name, "", *rates, "", "", ""


def condition_rows(
    folders: Mapping[str, Path], faulty: Runs, modelled: Runs, main: Sequence[str]
) -> Iterator[tuple[str | float, ...]]:
    """Yield threshold and recall by the fault-free motion on which the threshold is chosen, and by
    the length of packets in faulty runs of the first motion.
    """
    every, still_down = "every motion and scale", unclutched(modelled)
    fast, suture = runs.pooled(folders, [FAST]), runs.MOTIONS[0]
    each_cycle = f"{suture}, one packet per cycle"
    for words, free, some, scale in (
        (every, modelled, faulty, 0.1),
        ("every motion, scale 0.1", at_scale(modelled, 0.1), faulty, 0.1),
        ("no clutching, scale 0.1", at_scale(still_down, 0.1), faulty, 0.1),
        (every, modelled, fast, 0.2),
        ("no clutching, scale 0.2", at_scale(still_down, 0.2), fast, 0.2),
        (f"{every}; faulty runs: {suture}", modelled, runs.pooled(folders, [suture]), 0.1),
        (f"{every}; faulty runs: {each_cycle}", modelled, runs.pooled(folders, [EVERY_CYCLE]), 0.1),
    ):
        for name in main if free["hours"].sum() > 0 else ():
            threshold = threshold_for(free, name)
            cells: tuple[str | float, ...] = (NO_THRESHOLD, "", "", "", "")
            if threshold is not None:
                found, spoke = point(some, free, name, threshold), spoke_ms(some, name, threshold)
                others = share(spoke >= 0, ~some["unintended"], some.faults, "")
                rates = map(percent, (found.caught, others, found.before))
                cells = (threshold, hourly(found.false), *rates)
            yield words, scale, name, *cells


def no_hazard(faulty: Runs) -> np.ndarray:
    """Return the runs without hazard and jump, bool [runs]."""
    jumped = faulty["jump_tip"].astype(bool) | faulty[faulty.made.verdict_jump].astype(bool)
    return (faulty["hazard"] == "none") & ~jumped


def hazard_rows(faulty: Runs, main: Sequence[str]) -> Iterator[tuple[str | int, ...]]:
    """Yield the areas by the event that a detector is to detect."""
    hazard, leapt = faulty["hazard"], faulty["jump_tip"].astype(bool)
    jumped = faulty[faulty.made.verdict_jump].astype(bool)
    told = {f"{word} as the run's hazard": hazard == word for word in HAZARDS if word != "none"}
    told |= {"jump of the true tip": leapt, "jump of the reported tip only": jumped & ~leapt}
    for words, hit in told.items():
        mine = hit | no_hazard(faulty)
        auc = area_estimates(faulty.where(mine), hit[mine])
        yield words, int(hit.sum()), *(plain(auc[name]) for name in main)


def at_scale(free: Runs, scale: float) -> Runs:
    return free.where(np.isclose(free[SCALE], scale))


def compare(context: study.Context) -> study.Findings:
    """Compare all detectors over the same runs."""
    folders = context.folders
    faulty = runs.pooled(folders)
    recordings = [name for name in folders if name.startswith(("free_", "noise_"))]
    hands, free = runs.split_hands(runs.joined([fault_free(folders[name]) for name in recordings]))
    modelled = of_robot(free, AS_MODELLED)
    points = {
        name: point(faulty, modelled, name, threshold)
        for name in names_of(faulty)
        if (threshold := threshold_for(modelled, name)) is not None
    }
    steps = [at for name, at in points.items() if name.startswith("steps")]
    best = sorted(steps, key=lambda at: -at.caught.value)[:1]
    main = tuple(dict.fromkeys([MAIN[0], *(at.name for at in best), *MAIN[1:]]))
    quiet = [points[name] for name in main if name in points]
    others = [point(faulty, modelled, name) for name in OTHERS]
    hours = float(modelled["hours"].sum())
    tables = {
        "layers": layer_rows(faulty, [*quiet, *others]),
        "robots": robot_rows(faulty, free, main),
        "conditions": condition_rows(folders, faulty, modelled, main),
        "hazards": hazard_rows(faulty, main),
    }
    return study.findings(
        NAME,
        _lines(faulty, hands, modelled, quiet, others),
        tables,
        chosen=" | ".join(at.words for at in (*quiet, *others)),
        main=" | ".join(main),
        calm=wording.format_count(int(no_hazard(faulty).sum())),
        motion=events.event_meaning("unintended_motion", faulty.made.rules),
        hours=hours,
        recordings=len(np.unique(modelled["recording"])),
        unseen=alarm_rate(0, hours).high,
        per_hour=PER_HOUR,
    )


def _lines(
    faulty: Runs, hands: Runs, modelled: Runs, quiet: Sequence[Point], others: Sequence[Point]
) -> Iterator[study.Line]:
    yield from runs.design_lines(faulty, modelled)
    auc = area_estimates(faulty, faulty["unintended"], MOVED)
    for at in quiet:
        yield study.own_line(f"AUC, {at.name}", "", auc[at.name])
        yield study.percent_line(f"{at.words}: recall of unintended motions", at.caught)
        yield study.percent_line(f"{at.words}: alarm before the unintended motion", at.before)
    fixed = [point(faulty, modelled, *published) for published in (PUBLISHED, FORK, CLIP)]
    for at in (*fixed, *others):
        yield study.percent_line(f"{at.words}: recall of unintended motions", at.caught)
        if at in others and at.before is not BY_DEFINITION:
            yield study.percent_line(f"{at.words}: alarm before the unintended motion", at.before)
        quantity = f"{at.words}: false alarms, recorded hands, scale {runs.DEFAULT_SCALE:g}"
        if len(hands.frame):
            yield study.own_line(quantity, "1/h", false_alarms(hands, at.name, at.threshold))
        yield study.own_line(f"{at.words}: false alarms, generated motion", "1/h", at.false)


STUDY = study.study(NAME, study.read_variants(NAME), compare)
