"""Tables and notes of the burst study."""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence

from studies.framework.literature import Published
from studies.framework.study import Table
from studies.seed.burst.events import EVENTS, BurstRun, Criteria
from studies.seed.motions import Motion

SMALL = 1500.0
"""Counts; a larger constant stops the robot in the first burst."""

Runs = Mapping[Motion, Sequence[BurstRun]]


def tables(settings: Mapping[str, Runs], packets: Runs, rules: Criteria) -> tuple[Table, ...]:
    """Of the bursts by setting, the modelled one first, and of the runs with packets struck."""
    return (
        _constants(next(iter(settings.values())), rules),
        _settings(settings, rules),
        _packets(packets),
    )


def ranges(values: Sequence[float], step: float = 50.0) -> str:
    """Sorted numbers, neighbours of one step joined: -200 to -100, +50."""
    runs: list[list[float]] = []
    for value in values:
        if runs and value - runs[-1][-1] == step:
            runs[-1].append(value)
        else:
            runs.append([value])
    return ", ".join(f"{r[0]:+.0f} to {r[-1]:+.0f}" if len(r) > 1 else f"{r[0]:+.0f}" for r in runs)


def _by_value(bursts: Runs) -> list[tuple[float, list[BurstRun]]]:
    """Runs of all motions by what was struck, in its order."""
    key = operator.attrgetter("value")
    return [
        (value, list(runs)) for value, runs in itertools.groupby(sorted(flat(bursts), key=key), key)
    ]


def _constants(bursts: Runs, rules: Criteria) -> Table:
    rows = []
    for value, runs in _by_value(bursts):
        events = [e for one in runs for e in one.events]
        met = [sum(holds(one) for one in runs) for holds in rules.tests.values()]
        rows.append(
            (
                f"{value:+.0f}",
                span((len(one.events) for one in runs), ".0f"),
                _stops(runs),
                span((e.peak_mm for e in events), ".1f"),
                span((e.rebound_deg for e in events), ".1f"),
                span((e.rebound_ms for e in events), ".0f"),
                span((e.cue_s for e in events), ".2f"),
                span((e.force for e in events if e.force > 0.0), ".3f"),
                sum(e.jumped for e in events),
                *met,
                sum(map(rules.all_of_a4, runs)),
            )
        )
    columns = (
        "DAC constant",
        "bursts until stop",
        "stops in burst 1, 2, 3, 4",
        "tip error peaks, mm",
        "rebounds, deg",
        "rebounds, ms",
        "cue after fault, s",
        "pulse forces",
        "jumps (code's rule)",
        *rules.tests,
        "all of A4",
    )
    note = (
        f"Least to largest over all bursts of {len(bursts)} motions; the last"
        f" {len(rules.tests) + 1} columns: in how many motions all four bursts meet the band."
        " Published, one run: four bursts, stop in the fourth; 3.65, 3.3, 5.0, 6.65 mm; 5.6, 3.4,"
        " 6.7 degrees; 150 ms; 0.19 to 0.23 s; 0.0166, 0.0133, 0.0296, 0.0500; four jumps, counted"
        " by eye."
    )
    return Table("Every constant", columns, tuple(rows), note)


def _stops(runs: Sequence[BurstRun]) -> str:
    """How many runs stopped in each burst."""
    stopped = [len(one.events) for one in runs if one.cause]
    return (
        " ".join(str(stopped.count(number)) for number in range(1, EVENTS + 1))
        if stopped
        else "none"
    )


def span(values: Iterable[float], form: str) -> str:
    """Least to largest of those that are there."""
    there = [value for value in values if not math.isnan(value)]
    if not there:
        return "–"
    low, high = format(min(there), form), format(max(there), form)
    return low if low == high else f"{low} to {high}"


def _settings(settings: Mapping[str, Runs], rules: Criteria) -> Table:
    rows = []
    for name, runs in settings.items():
        every = flat(runs)
        met = [sum(map(holds, every)) for holds in (*rules.tests.values(), rules.all_of_a4)]
        rows.append(
            (name, len(every), *met, most_of_a4(every, rules), span(stop_peaks(every), ".1f"))
        )
    columns = (
        "setting",
        "runs",
        *rules.tests,
        "all of A4",
        "most of A4 in one run",
        "tip error peaks of bursts that end in a stop, mm",
    )
    note = (
        "Runs in which all four bursts meet a band. Settings with fewer runs were tried with the"
        f" first motion alone. Last column: constants of at most {SMALL:.0f} counts; the paper's"
        " stop came at 6.65 mm."
    )
    return Table("What the bands depend on", columns, tuple(rows), note)


def stop_peaks(runs: Iterable[BurstRun]) -> list[float]:
    """Tip error peaks, mm, of bursts that end in a stop, of constants that are at most SMALL."""
    return [
        one.events[-1].peak_mm
        for one in runs
        if one.cause and one.events[-1].cut and abs(one.value) <= SMALL
    ]


def _packets(runs: Runs) -> Table:
    rows = []
    for value, same in _by_value(runs):
        firsts = [one.events[0] for one in same if one.events]
        events = [e for one in same for e in one.events]
        rows.append(
            (
                f"{value:+.0f}",
                span((len(one.events) for one in same), ".0f"),
                _stops(same),
                span((e.peak_mm for e in firsts), ".1f"),
                span((e.peak_mm for e in events), ".1f"),
                span((e.cue_s for e in firsts), ".2f"),
                f"{sum(math.isnan(e.cue_s) for e in firsts)} of {len(firsts)}",
            )
        )
    columns = (
        "increment, um a packet",
        "bursts until stop",
        "stops in burst 1, 2, 3, 4",
        "tip error peaks of the first burst, mm",
        "of all bursts, mm",
        "cue after the first onset, s",
        "first bursts without cue",
    )
    note = (
        "The second fault site of the paper, whose results it does not show: for 300 ms the x"
        " increments of the operator's packets, some 155, are overwritten on their way to the"
        " robot, the model hears the clean ones. Increments add up, so the robot does not come back"
        " to its model after a burst, and the tip error of later bursts holds that of earlier ones."
        " Predicted only."
    )
    return Table("Operator packets struck", columns, tuple(rows), note)


def notes(
    measured: Sequence[BurstRun],
    settings: Mapping[str, Runs],
    rules: Criteria,
    published: Published,
) -> tuple[str, ...]:
    """Of every run measured, and of the bursts by setting, the modelled one first."""
    modelled = next(iter(settings))
    bursts = settings[modelled]
    every = flat(bursts)
    causes = ", ".join(sorted({one.cause for one in every if one.cause})) or "none"
    early = {
        motion: sum(len(one.events) < EVENTS for one in runs) for motion, runs in bursts.items()
    }
    early_words = ", ".join(f"{kind} {seed}: {count}" for (kind, seed), count in early.items())
    of_each = len(next(iter(bursts.values())))
    whole = [name for name, runs in settings.items() if any(map(rules.all_of_a4, flat(runs)))]
    lower = any(name.startswith("stop above") for name in whole)
    low, high = published.band("a4.peak")
    jumped = [
        e.jumped
        for one in every
        for e in one.events
        if low <= e.peak_mm <= high and abs(one.value) <= SMALL
    ]
    apart = sum(not one.same_cue for one in measured)
    return (
        (
            "The paper gives neither the constant nor its sign, nor the cue's gains, nor the hand's"
            " motion. Every constant is run with every motion, none is chosen, and nothing in the"
            " robot or the nominal model was fitted. The cue's spring and damper were read off the"
            " paper's Figure 5, so the height of pulses is no evidence; when a cue begins follows"
            " from the stated threshold alone."
        ),
        (
            f"Causes of stops: {causes}. As in the paper it is not the injected command that trips"
            " the check, but the one that the controller computes against it."
        ),
        (
            "As the constant is unknown, a line that counts runs asks for one run among all"
            " constants and motions: a weak test of a single band, so the line that asks for all of"
            " A4 in one run is the one that decides. That the rebound takes 100 to 200 ms is this"
            " study's reading of 'about 150 ms'."
        ),
        (
            f"Of the {len(rules.a4)} bands of A4 a run meets {most_of_a4(every, rules)} at the"
            f" most. All of A4 at once is met with: {', '.join(whole) or 'no setting tried'}."
        ),
        (
            f"Where the stop comes is an open question. {stop_words(settings, published)} The"
            " present software stops above a computed command of 20 000 counts; other versions of"
            " it above 13 000 or 12 000, and the paper does not name its own. The lower limits"
            " were tried after this difference was seen and none was adopted; with them"
            f" {'some run meets' if lower else 'no run meets'} all of A4."
        ),
        (
            f"Runs that stop before the fourth burst, by motion: {early_words} of {of_each}. What"
            " the hand does at a burst's onset decides how large it becomes; in which burst the"
            " robot stops is the motion's doing as much as the constant's."
        ),
        (
            "By the rule of the published analysis code (tip steps above 0.1 mm in two"
            f" milliseconds running) {sum(jumped)} of {len(jumped)} bursts with a peak of {low:g}"
            f" to {high:g} mm are jumps: 6.7 degrees in 150 ms are some 80 mm/s at the tip. The"
            " paper's four jumps were probably counted by eye."
        ),
        (
            "Series come from the code of engine simd. Runs whose first cue there is not the one"
            f" of the campaign's own table: {apart} of {len(measured)}."
        ),
    )


def stop_words(settings: Mapping[str, Runs], published: Published) -> str:
    """At which tip error a burst stops the robot, by setting, in a sentence."""
    peaks = [
        f"{span(stop_peaks(flat(runs)), '.1f')} mm ({name})"
        for number, (name, runs) in enumerate(settings.items())
        if number == 0 or name.startswith("stop above")
    ]
    stopped = published.value("burst.4.peak")
    return (
        f"Bursts that end in a stop have tip error peaks of {', '.join(peaks)}; the paper's has"
        f" {stopped:g} mm."
    )


def flat(runs: Runs) -> list[BurstRun]:
    """Of all motions."""
    return [one for of_motion in runs.values() for one in of_motion]


def most_of_a4(runs: Iterable[BurstRun], rules: Criteria) -> int:
    """The most bands of A4 that one run meets."""
    return max(sum(rules.tests[name](one) for name in rules.a4) for one in runs)
