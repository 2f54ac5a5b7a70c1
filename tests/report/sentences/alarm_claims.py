"""Sentences and tables of times, detectors and cues, written as they should be."""

from __future__ import annotations

import naive_facts
import numpy as np
import pandas as pd
import plain_statistics as plain
from claim_words import are, between, brief, duration, hourly, many, prose, timed
from expected_numbers import Expected
from page_text import (
    ANY_SPAN,
    ANY_TIME,
    DASH,
    Node,
    Text,
    cell,
    count,
    fixed,
    number,
    percent,
    rows,
)


def time(e: Expected, html: Node) -> None:
    """Cue and check, which comes first."""
    section = html.one("section", "time")
    text = prose(section, "time")
    text.says("(Kaplan–Meier, 95 % band)")
    f = e.faults
    if not f["activated"].any():
        text.says("No fault had an effect.")
    both = f[(f["warned_ms"] >= 0) & (f["told_ms"] >= 0)]
    n, ahead = len(both), (both["told_ms"] - both["warned_ms"])
    if n:
        same, median = e.count(ahead == 0), float(ahead.median())
        when = (
            f"{number(abs(median))} ms {'before' if median > 0 else 'after'}"
            if median
            else "together with"
        )
        text.says(
            f"Where both came, the cue was first in {count((ahead > 0).sum())} of"
            f" {many(n, 'fault')} ({percent((ahead > 0).mean())} %,"
            f" {between(e.count(ahead > 0), n)})"
            + (f" and in the same millisecond as the check in {count(same)}" if same else "")
            + f"; {'at the median ' if n > 1 else ''}it came {when} the check."
        )
    else:
        text.says("No fault had both a cue and a check that tells.")
    for word, column in (("cue", "warned_ms"), ("check", "told_ms")):
        early = e.count(
            f["activated"].astype(bool) & (f[column] >= 0) & (f[column] < f["first_active_ms"])
        )
        if early:
            text.says(
                f"{many(early, 'fault')} with a {word} before any effect {are(early)} left out of"
                f" the {word}'s curve."
            )
    text.is_said("Where both", "No fault", "left out")


def detectors(e: Expected, html: Node) -> None:
    """Every threshold of every detector, the checks and the cue."""
    if not e.manifest.detectors:
        assert not list(html.all("section", "detectors"))
        return
    section = html.one("section", "detectors")
    text = prose(section, "detectors")
    f = e.faults
    moved = f["hazard"] == "unintended motion"
    text.says(f"Which share of unintended motions over {e.limit} does a detector recall")
    text.says(f"and the {e.threshold} cue stand beside them")
    text.says(f"How long before the motion exceeds {e.limit}")
    text.says(f"a negative lead comes after the motion exceeded {e.limit}")
    text.says(f"an alarm at {e.limit} from the model or beyond, where the motion begins, too.")
    text.says(
        f"{many(e.count(moved), 'fault')} with an unintended motion and {count((~moved).sum())}"
        " without, one run each."
    )
    text.says(f"{free_motions(e)}; a motion counts until its first alarm")
    plain_runs = e.all[e.all["plain"] & e.all["faulty"] & ~e.all["failed"]]
    positive = (plain_runs["hazard"] == "unintended motion").to_numpy()
    curve = 0 < positive.sum() < len(positive) and plain_runs["distinct"].nunique() > 1
    if curve:
        text.says("Bands: 95 %, by resampling faults.")
        text.says(
            f"the larger one the lowest without a false alarm in {duration(e.hours)} of fault-free"
            " motion."
        )
    else:
        text.says(
            "No curve: it needs two different faults, one with an unintended motion and one"
            " without."
        )
    lines = []
    for d, one in enumerate(e.manifest.detectors):
        what = one.kind.replace("_", " ") + (", fused: all" if one.kind == "steps" else "")
        what += f", {number(one.consecutive)} ms in a row" if one.consecutive > 1 else ""
        for k, threshold in enumerate(one.thresholds):
            quiet = " no false alarm" if e.quiet().get(one.name) == threshold else ""
            title = (f"{one.name} {what} " if not k else "") + f"{number(threshold)}{quiet}"
            scores = plain_runs[f"detector{d}_score"].to_numpy()
            auc = f"{fixed(plain.area(scores, positive), 3)} {ANY_SPAN}" if curve and not k else ""
            leads = one.kind != "tip_error" or threshold < e.plan.limit_mm
            alarm = f[f"detector{d}_threshold{k}_first_ms"]
            lines.append((title, auc, alarm, e.false_alarms(d, threshold), leads))
    lines.append(("built-in checks", "", f["told_ms"], None, True))
    cue = f["warned_ms"], e.first_cues(e.plan.verdict_cue), e.leads(e.plan.verdict_cue)
    lines.append((f"haptic cue, {e.threshold}", "", *cue))
    table = rows(section.one("table"))
    for cells, (title, auc, alarm, false, leads) in zip(table, lines, strict=True):
        came = alarm >= 0
        hits, misses = e.count(came & moved), e.count(came & ~moved)
        after = e.after(alarm, f[moved])
        early = e.before(after, f[moved])
        expected = [
            title,
            auc,
            brief(hits, e.count(moved)),
            brief(misses, e.count(~moved)),
            brief(hits, hits + misses) if hits + misses else DASH,
            hourly(false),
            timed(e.delay(after, f[moved])),
            brief(early, e.count(moved)) if moved.any() and leads else DASH,
            timed(e.lead(after, f[moved])) if leads else DASH,
        ]
        for place, (node, words) in enumerate(zip(cells, expected, strict=True)):
            cell(node, words, f"detectors, {title}, column {place}")
    text.says("Left of 0 there is time to act")
    text.is_said("No curve", "resampling")


def cues(e: Expected, html: Node) -> None:
    """Every haptic set."""
    section = html.one("section", "cues")
    text = prose(section, "cues")
    f = e.faults
    moved, others = f[f["hazard"] == "unintended motion"], f[f["hazard"] != "unintended motion"]
    text.says(
        f"{many(len(moved), 'fault')} with an unintended motion, {count(len(others))} without, one"
        f" run each; {free_motions(e)}; a motion counts until its first cue"
    )
    text.says(f"lead: before the motion exceeds {e.limit}, negative after it")
    if not all(map(e.leads, range(len(e.plan.thresholds)))):
        text.says(f"A set at {e.limit} or beyond is no warning of that motion")
    text.says("Shares of faults have 95 % intervals over the faults that were drawn.")
    choices(e, section, text, moved)
    order = sorted(range(len(e.plan.thresholds)), key=lambda k: e.plan.thresholds[k])
    table = rows(section.one("table", "wide"))
    for cells, k in zip(table, order, strict=True):
        warned = naive_facts.warned(e.frame, k)
        after = e.after(warned, moved)
        felt = e.frame.loc[[i for i, ms in zip(moved.index, after, strict=True) if ms >= 0]]
        force, ms, pulses = (
            felt[f"cue{k}_{name}"].median() for name in ("peak_force", "ms", "count")
        )
        expected = [
            count(k) + (" verdicts" if k == e.plan.verdict_cue else ""),
            f"{number(e.plan.thresholds[k])} mm",
            number(0.0045),
            number(0.0),
            number(0.05),
            brief(sum(one < 0 for one in after), len(moved)) if len(moved) else DASH,
            hourly(e.first_cues(k)),
            brief(e.count(warned.loc[others.index] >= 0), len(others)) if len(others) else DASH,
            brief(e.before(after, moved), len(moved)) if len(moved) and e.leads(k) else DASH,
            timed(e.delay(after, moved)),
            timed(e.lead(after, moved)) if e.leads(k) else DASH,
            f"{number(force)} {number(ms)}{' ms' if len(felt) else ''} · {number(pulses)}",
        ]
        for place, (node, words) in enumerate(zip(cells, expected, strict=True)):
            cell(node, words, f"cue {k}, column {place}")
    text.is_said()


def free_motions(e: Expected) -> str:
    """Fault-free motion that false cues and alarms are of."""
    motions = many(len(e.motions), "fault-free motion")
    return (
        f"{motions} of {duration(e.hours)} in pedal-down together, of {count(1)} motion of the"
        " hands"
    )


def choices(e: Expected, section: Node, text: Text, moved: pd.DataFrame) -> None:
    """Numbers of the sets that the data choose; whether they are the best is tested where that
    is decided.
    """
    if "This computes" in text.words:
        there = f"There {are(len(e.motions))} {duration(e.hours)} of fault-free motion."
        text.says(f"{there} This computes {ANY_TIME} of the same robot with other seeds")
    found = list(section.all("table", "choices"))
    assert bool(found) == (len(moved) > 0)
    if found:
        text.says("A threshold is named where the 95 % intervals decide")
    for cells in rows(found[0]) if found else []:
        if len(cells) == 4:
            threshold = float(cells[1].words.partition(" ")[0])
            k = int(np.abs(np.array(e.plan.thresholds) - threshold).argmin())
            after = e.after(naive_facts.warned(e.frame, k), moved)
            missed = sum(ms < 0 for ms in after)
            cell(
                cells[2],
                f"{percent(missed / len(moved))} % {between(missed, len(moved))}",
                "choice",
            )
            value, low, high = plain.poisson(*e.first_cues(k))
            cell(cells[3], f"{number(value)} {number(low)}{DASH}{number(high)}", "choice")


def after_stop(e: Expected, html: Node) -> None:
    """Stopped faults: how soon, how far off, and when the cue came."""
    f = e.faults[e.faults["response"] == "stopped"]
    if not len(f):
        assert not list(html.all("section", "after_stop"))
        return
    section = html.one("section", "after_stop")
    text = prose(section, "after a stop")
    n, took = len(f), f["response_ms"] - f["first_active_ms"]
    early, late = stop_motions(e, f)
    before = e.count((f["warned_ms"] >= 0) & (f["warned_ms"] < f["response_ms"]))
    half = (
        f"half of them within {number(took.median())} ms of"
        if n > 1
        else f"{number(took.median())} ms after"
    )
    if not took.median():
        half = f"{'half of them ' if n > 1 else ''}in the millisecond of"
    text.says(f"A check stopped the robot in {many(n, 'fault')}, {half} the fault's first effect.")
    text.says(
        f"In {count(early)} ({percent(early / n)} %) the tip was more than {e.limit} off before the"
        f" stop, in {count(late)} more ({percent(late / n)} %, {between(late, n)}) only after it."
    )
    text.says(f"The cue came before the stop in {count(before)} ({percent(before / n)} %).")
    text.says(
        "Shares are of the faults that this check stopped, one run of each; 95 % intervals (Wilson)"
    )
    causes = f.groupby("response_cause").size()
    every = f"every stop: {causes.index[0]}" if len(causes) == 1 else "every stop"
    parts = {every: f} | (
        {cause: f[f["response_cause"] == cause] for cause in causes.index}
        if len(causes) > 1
        else {}
    )
    table = {cells[0].words: cells[1:] for cells in rows(section.one("table"))}
    assert next(iter(table)) == every and set(table) == set(parts)
    for cause, cells in table.items():
        stop_row(e, cause, cells, parts[cause])
    text.is_said()


def stop_motions(e: Expected, f: pd.DataFrame) -> tuple[int, int]:
    """Stopped faults with the tip off before the stop, and those only after it."""
    moved = (f["hazard"] == "unintended motion") & (f["unintended_first_ms"] <= f["response_ms"])
    return e.count(moved), e.count(~moved & (f["unintended_off_mm"] > e.plan.limit_mm))


def stop_row(e: Expected, cause: str, cells: list[Node], f: pd.DataFrame) -> None:
    """Stops by one check."""
    n, took, off = len(f), f["response_ms"] - f["first_active_ms"], f["unintended_off_mm"]
    cued, stop = f["warned_ms"] >= 0, f["response_ms"]
    expected = (
        count(n),
        (
            f"{number(took.median())} ms 95 % by {number(took.quantile(0.95))}, last"
            f" {number(took.max())}"
        ),
        *(brief(k, n) for k in stop_motions(e, f)),
        (
            f"{number(off.median(), 2)} mm 95 % to {number(off.quantile(0.95), 2)}, most"
            f" {number(off.max(), 2)}"
        ),
        brief(e.count(cued & (f["warned_ms"] < stop)), n),
        brief(e.count(cued & (f["warned_ms"] >= stop)), n),
        brief(e.count(~cued), n),
    )
    for node, words in zip(cells, expected, strict=True):
        cell(node, words, f"stops by {cause}")
