"""Sentences and tables of the first page, written as they should be."""

from __future__ import annotations

import math
from fractions import Fraction

import naive_facts
import pandas as pd
import plain_statistics as plain
from claim_words import (
    ACTIONS,
    between,
    brief,
    duration,
    estimate,
    false_cues,
    many,
    points,
    prose,
    share,
    span,
)
from expected_numbers import Expected, evades, in_pairs, largest_first, mean_far, moves, untold
from page_text import ANY_SPAN, DASH, Node, Text, cell, count, number, percent, rows
from reaction_claims import change

MOST_CLASSES = 3
"""Rows of each table of classes, in tests."""
ONLY_CLAIMED = (
    "none made",
    "ever changed a bit",
    "did not come",
    "it moved as far",
    "No fault evaded",
    "No fault made",
    "in all of them",
    "only because",
    "injected no",
    "valid outcome",
    "The one fault",
    "fewer than",
    "repeats",
)
"""What the page says under a condition, without a number."""


def first_page(e: Expected, html: Node) -> None:
    """Headline, answers and tables of classes."""
    header = html.one("header")
    text = prose(header, "first page")
    if e.n:
        which_evade(e, text)
        how_long(e, text)
        what_would_change(e, text)
        one_of = ", the first valid one of its repeats" if e.repeats else ""
        text.says(f"One run of each fault{one_of}; 95 % intervals where faults were drawn")
        quiet = (
            f"at its lowest threshold without a false alarm in {duration(e.hours)} of fault-free"
            " motion"
        )
        also = f"or a detector alarmed {quiet}" if e.manifest.detectors else "at the earliest"
        text.says(f"the {e.threshold} cue came, {also}")
        text.says(f"its true tip is more than {e.limit} from the golden run")
        if not e.leads(e.plan.verdict_cue):
            nor = (
                " and without a tip-error detector at its distance" if e.manifest.detectors else ""
            )
            text.says(
                f"Known before the motion: without the cue{nor}, no warning of a motion of"
                f" {e.limit}."
            )
        class_tables(e, header)
    else:
        text.says(no_fault(e))
        text.says(false_cues(e))
    text.is_said(*ONLY_CLAIMED)


def no_fault(e: Expected) -> str:
    """Why there is no rate."""
    if not e.all["faulty"].any():
        return "This campaign injected no fault."
    if (~e.all["plain"]).any():
        return "No fault has a valid run in which nobody reacts to the cue."
    return "No run with a fault gave a valid outcome."


def which_evade(e: Expected, text: Text) -> None:
    """The headline, and what became of the other faults."""
    f = e.faults
    nobody, moved = untold(f), f["hazard"] == "unintended motion"
    evading = f[nobody & moved]
    k = len(evading)
    text.says(
        f"Of {many(e.n, 'distinct fault')} of this design, {count(k) if k else 'none'} made the"
        f" live robot move more than {e.limit} off its course without any check telling anyone"
        f" ({percent(k / e.n)} % of faults drawn so, 95 % interval {between(k, e.n)})."
    )
    if not f["activated"].any():
        text.says("It never changed a bit." if e.n == 1 else "None of them ever changed a bit.")
    where_they_evade(e, text)
    cued, limited = e.count(evading["warned_ms"] >= 0), e.count(evading["response"] == "limited")
    limits = "a check limited a command or dropped a packet and told nobody"
    false, _ = e.first_cues(e.plan.verdict_cue)
    if k == 1:
        golden = (
            "and its golden run had none by then" if cued else "or its golden run had one by then"
        )
        came = f"{'came' if cued else 'did not come'}{f', {golden}' if false else ''}"
        text.says(f"The {e.threshold} haptic cue {came}{f'; {limits}' if limited else ''}.")
    elif k:
        motions = f"it came in {count(false)} of {many(len(e.motions), 'fault-free motion')}"
        golden = f", where the golden run had none by then ({motions})" if false else ""
        also = f"; in {'all' if limited == k else count(limited)} {limits}" if limited else ""
        text.says(
            f"The {e.threshold} haptic cue came in {count(cued)} of these {count(k)}{golden}{also}."
        )
    told = e.count(moved & ~nobody)
    if told:
        faults = f"{'other ' if k else ''}{'fault' if told == 1 else 'faults'}"
        text.says(
            f"In {count(told)} {faults} it moved as far, and a check stopped the robot or told a"
            " person."
        )
    lost = f[nobody & (f["hazard"] == "loss of motion")]
    if len(lost):
        halted, why = e.count(lost["loss_first_ms"] < 0), ""
        if halted:
            of_them = (
                f"; in {'all' if halted == len(lost) else count(halted)} of them"
                if len(lost) > 1
                else ","
            )
            why = f"{of_them} only because it was not live"
        text.says(
            f"In {count(len(lost))} ({percent(len(lost) / e.n)} %) the robot did not follow the"
            f" operator and no check told anyone{why}."
        )
    wrong = e.count(nobody & (f["hazard"] == "false report"))
    if wrong:
        text.says(
            f"In {count(wrong)} ({percent(wrong / e.n)} %) only the robot's report of its tip was"
            f" more than {e.limit} wrong, and no check told anyone."
        )


def how_long(e: Expected, text: Text) -> None:
    """When faults with an unintended motion could be known."""
    moved = e.faults[e.faults["hazard"] == "unintended motion"]
    n, known, told = len(moved), e.known(moved), e.known(moved, before=True)
    never, early = sum(ms < 0 for ms in known), e.before(told, moved)
    tellers = "a check or a detector" if e.manifest.detectors else "a check"
    leads = e.leads(e.plan.verdict_cue)
    if not n:
        text.says("No fault made an unintended motion.")
        return
    if n == 1:
        late = number(known[0] - moved["first_active_ms"].iloc[0])
        nobody = "neither a check nor a detector" if e.manifest.detectors else "no check"
        if leads:
            when = f"{'before' if early else 'not before'} the motion reached {e.limit}"
        else:
            when = (
                f"{f'and from {tellers}' if early else f'but from {nobody}'} before the motion"
                f" reached {e.limit}"
            )
        could = (
            "not be known before its run ended"
            if never
            else f"be known {late} ms after its first effect, {when}"
        )
        text.says(f"The one fault with an unintended motion could {could}.")
        return
    half, quarter = (e.delay(known, moved, Fraction(1, part)) for part in (2, 4))
    if math.isfinite(quarter[0]):
        most, (value, low, high) = (
            ("Half", half) if math.isfinite(half[0]) else ("A quarter", quarter)
        )
        bounds = f" (95 % interval {span(low, high)})" if span(low, high) else ""
        rest = "" if most == "Half" else ", fewer than half before their runs ended"
        text.says(
            f"{most} of the {count(n)} faults with an unintended motion could be known within"
            f" {number(value)} ms of their first effect{bounds}{rest}."
        )
    else:
        some = "none" if never == n else "fewer than a quarter"
        text.says(
            f"Of the {count(n)} faults with an unintended motion {some} could be known before their"
            " runs ended."
        )
    if never < n:
        if leads:
            not_at_all = (
                f", and {count(never)} ({percent(never / n)} %) not at all" if never else ""
            )
            false, _ = e.first_cues(e.plan.verdict_cue)
            golden = "; a cue that the golden run has by then tells nothing" if false else ""
            text.says(
                f"{share(early, n)} could be known before the motion reached"
                f" {e.limit}{not_at_all}{golden}."
            )
            return
        text.says(
            f"{share(early, n)} could be known from {tellers} before the motion reached {e.limit};"
            f" the {e.threshold} cue, at no smaller a distance, is no warning of it."
        )
        lower = [k for k in range(len(e.plan.thresholds)) if e.leads(k)]
        if lower:
            nearest = max(lower, key=lambda k: e.plan.thresholds[k])
            first = e.earliest(told, e.after(naive_facts.warned(e.frame, nearest), moved))
            false, _ = e.first_cues(nearest)
            text.says(
                f"With a {number(e.plan.thresholds[nearest], 6)} mm cue, which came in"
                f" {count(false)} of {many(len(e.motions), 'fault-free motion')},"
                f" {share(e.before(first, moved), n)} could be known before it."
            )
        if never:
            without = f"Without that cue, but with the {e.threshold} one, " if lower else ""
            text.says(
                f"{without}{count(never)} ({percent(never / n)} %) could not be known at all."
            )


def what_would_change(e: Expected, text: Text) -> None:
    """Pairs where there are any, else what the cue announces."""
    k, _ = evades(e.faults)
    if e.pairs:
        action, both = next(iter(e.pairs.items()))
        without, with_ = in_pairs(both)
        few = both["distinct"].nunique() < (2 if both["distinct"].is_unique else 5)
        bounds = "" if few else f" ({ANY_SPAN})"
        others = "; other reactions" if len(e.pairs) > 1 else ""
        text.says(
            f"Of {many(len(both), 'pair')} of runs, once with nobody who reacts and once with an"
            f" operator who answers it ({ACTIONS[action]}), {count(with_.sum())} instead of"
            f" {count(without.sum())} had an unintended motion: {points(change(both))}. How far the"
            f" tip went by itself changed by {number(mean_far(both), 2)} mm on"
            f" average{bounds}{others}."
        )
        if not e.leads(e.plan.verdict_cue):
            text.says(f"{at_limit(e)}. What it can change is how far the motion goes on.")
    elif not k:
        text.says("No fault evaded the checks, so there was nothing for it to announce.")
    else:
        text.says(
            announced(e, e.faults[untold(e.faults) & (e.faults["hazard"] == "unintended motion")])
        )


def at_limit(e: Expected) -> str:
    """What the definitions say of a cue at the limit or beyond."""
    threshold = number(e.plan.thresholds[e.plan.verdict_cue], 6)
    return (
        f"A cue at {threshold} mm is no warning of a motion of {e.limit}: both are distances from"
        " the nominal model, and the cue's is not the smaller one"
    )


def announced(e: Expected, evading: pd.DataFrame) -> str:
    """What the cue of the verdicts announces, and which cue without a false one announces most,
    where it is another; of a cue at the limit or beyond nothing, for the definitions decide it."""
    found, n = [], len(evading)
    for k, threshold in enumerate(e.plan.thresholds):
        alarm = e.after(naive_facts.warned(e.frame, k), evading)
        false, hours = e.first_cues(k)
        found.append((e.before(alarm, evading), threshold, e.lead(alarm, evading)[0], false, hours))
    early, threshold, lead_ms, false, _ = found[e.plan.verdict_cue]
    sooner = ", and before it comes without the fault," if false else ""
    said = (
        f"The {number(threshold, 6)} mm cue comes before the motion reaches {e.limit}{sooner} in "
        f"{share(early, n, 'evading fault')}{at_median(lead_ms, n)}"
    )
    able = [one for k, one in enumerate(found) if e.leads(k)]
    best = max((one for one in able if not one[3]), default=None)
    never = ""
    if best:
        most = number(plain.poisson(0, best[4])[2])
        never = (
            f"which never came in {duration(e.hours)} of fault-free motion (at most {most} an hour"
            " can be said)"
        )
    if not e.leads(e.plan.verdict_cue):
        said = f"{at_limit(e)}. "
        if not best:
            each = "The only" if len(able) == 1 else "Every"
            none = f"{each} cue below {e.limit} came in fault-free motion, too."
            return said + (none if able else f"No cue below {e.limit} was evaluated.")
        many_faults = share(best[0], n, "evading fault")
        return (
            said
            + f"A {number(best[1], 6)} mm cue, {never}, comes before the motion reaches {e.limit}"
            f" in {many_faults}{at_median(best[2], n)}."
        )
    if best and best[0] > early:
        said += (
            f"; a {number(best[1], 6)} mm cue, {never}, in"
            f" {share(best[0], n)}{at_median(best[2], n)}"
        )
    return said + "."


def at_median(lead_ms: float, n: int) -> str:
    """How long before the motion, or after it."""
    if not math.isfinite(lead_ms):
        return ""
    when = (
        f"{number(abs(lead_ms))} ms {'before' if lead_ms > 0 else 'after'} it"
        if lead_ms
        else "at the same moment"
    )
    return f", {'at the median ' if n > 1 else ''}{when}"


def where_they_evade(e: Expected, text: Text) -> None:
    """The site with the largest share that evades, and how many have none."""
    f = e.faults
    sites = sorted(
        [(str(name), f[f["site"].astype(str) == name]) for name in f["site"].unique()],
        key=most_evasive,
    )
    if len(sites) < 2 or not evades(f)[0]:
        return
    quiet = sum(not evades(part)[0] for _, part in sites)
    begin = (
        f"At {count(quiet)} of the {count(len(sites))} sites none evades; the" if quiet else "The"
    )
    name, worst = sites[0]
    k, n = evades(worst)
    *others, last = [name for name, part in sites if Fraction(*evades(part)) == Fraction(k, n)]
    if others:
        text.says(
            f"{begin} largest share evades at {', '.join(others)} and {last}, {percent(k / n)} % at"
            " each."
        )
    else:
        text.says(f"{begin} largest share evades at {name}, {share(k, n, 'fault')} there.")


def class_tables(e: Expected, header: Node) -> None:
    """Faults by layer, site and group, the most evasive first."""
    kinds = {}
    for kind in ("layer", "site", "group"):
        names = sorted(e.all.loc[e.all["faulty"], kind].astype(str).unique())
        classes = [(name, e.faults[e.faults[kind].astype(str) == name]) for name in names]
        if len(names) > 1 or kind == "group":
            kinds[kind] = sorted(classes, key=most_evasive)
    tabs = {tab.attributes["data-kind"]: tab for tab in header.all(name="tab")}
    assert list(tabs) == list(kinds)
    for kind, classes in kinds.items():
        text = Text(tabs[kind].words, f"faults by {kind}")
        text.says(f"{kind.capitalize()} faults evade unintended motion")
        highest = max(
            [
                0.0,
                *(
                    plain.wilson(*evades(part))[1]
                    for _, part in classes[:MOST_CLASSES]
                    if len(part)
                ),
            ]
        )
        scale = (tabs[kind].one(name="spreads").attributes["data-scale"] or "").split()
        assert scale[:2] == ["0", "to"]
        assert min(max(100 * highest, 5), 100) <= float(scale[2]) + 1e-9 <= 100.1, (
            "all intervals are inside"
        )
        for cells, (name, part) in zip(
            rows(tabs[kind].one("table")), classes[:MOST_CLASSES], strict=True
        ):
            class_row(e, cells, name, part)
        left, notes = (
            len(classes) - MOST_CLASSES,
            Text(tabs[kind].without("table").words, f"note on {kind}"),
        )
        if left > 0:
            notes.says(f"{count(left)} more, no more evasive than these")
        notes.is_said("evasive")


def most_evasive(named: tuple[str, pd.DataFrame]) -> tuple:
    """To sort classes by: by evading faults, then by unintended motions, then by name."""
    name, part = named
    return *largest_first(evades(part)), *largest_first(moves(part)), name


def class_row(e: Expected, cells: list[Node], name: str, part: pd.DataFrame) -> None:
    """One class of faults."""
    moved = part[part["hazard"] == "unintended motion"]
    known = e.known(moved)
    (k, n), early, m = evades(part), e.before(e.known(moved, before=True), moved), len(moved)
    expected = (
        name,
        count(n),
        "",
        brief(k, n),
        brief(m, n),
        brief(e.count(part["hazard"] == "loss of motion"), n),
        f"{percent(early / m)} % {count(early)} of {count(m)} · {between(early, m)}" if m else DASH,
        estimate(e.delay(known, moved)).replace("(", "").replace(")", ""),
    )
    for node, words in zip(cells, expected, strict=True):
        cell(node, words, f"class {name}")
    label = cells[2].one(name="spread").attributes["aria-label"] or ""
    evade = percent(k / n) + " %" if n else DASH
    Text(label.replace("\u202f", " "), name).says(f"{evade}, 95 % interval {between(k, n)}")
