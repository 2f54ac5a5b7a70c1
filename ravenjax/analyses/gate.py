"""Decides whether a change made results worse: a test of non-inferiority for each event.

Two results of the same faults are compared. A margin is the largest accepted increase of an event's
rate. An event with a confidence interval passes if the whole 95 % interval lies within the margin.
It fails if no part of the interval does, and is undecided otherwise.

The intervals are those of `ravenjax compare`: paired over distinct faults (Bonett and Price 2012),
and clustered if a fault has several pairs. Enumerated faults have no interval, so their difference
alone is compared with the margin. False cues per hour are compared as two independent results. The
interval of their difference combines two exact Poisson intervals by square-and-add (Zou and Donner
2008).
"""

import contextlib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from ravenjax.errors import UserError, suggest_name
from ravenjax.report import comparison, wording
from ravenjax.report.comparison import FolderComparison
from ravenjax.report.data.runs import Runs
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Estimate, independent_difference
from ravenjax.store import manifest

FALSE_CUES = "false cues"
EVENTS = {name.replace("_", " "): name for name in comparison.RATES} | {"evading": "evades"}
"""Maps an event of a margin in percentage points to the name of its rate in a comparison."""
_MARGIN = re.compile(
    r"\s*(?P<event>[a-z ]+?)\s*(?P<change>[+-]\d+(\.\d+)?)\s*(?P<unit>points|/h)\s*"
)
Verdict = Literal["pass", "fail", "undecided"]


class Margin(NamedTuple):
    """The largest accepted rise (positive) or fall (negative) of an event's rate."""

    event: str
    change: float  # percentage points, or per hour
    unit: str

    def __str__(self) -> str:
        return f"{self.event} {self.change:+g}{'/h' if self.unit == '/h' else ' points'}"


class Judgement(NamedTuple):
    """The verdict on one margin. change: second minus first, in the unit of the margin."""

    margin: Margin
    # The rates in both results, as text.
    first: str
    second: str
    change: Estimate
    verdict: Verdict

    @property
    def measured(self) -> str:
        """The change with its interval, as text."""
        bounds = "no interval, because the faults are enumerated"
        if math.isfinite(self.change.low):
            bounds = f"95 % interval {self.change.low:+,.4g} to {self.change.high:+,.4g}"
        return f"{self.change.value:+,.4g}{' points' * (self.margin.unit != '/h')} ({bounds})"


class Gate(NamedTuple):
    """All judgements on two result folders."""

    compared: FolderComparison
    judgements: Sequence[Judgement]

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if a margin is exceeded, else 2 if a verdict is undecided, else 0."""
        verdicts = {judgement.verdict for judgement in self.judgements}
        return 1 if "fail" in verdicts else 2 if "undecided" in verdicts else 0


def parse_margin(text: str) -> Margin:
    """Parse a margin such as "evades +0.5 points". Raise UserError for any other form."""
    example = (
        "expected an event, a signed number and a unit, such as"
        f' "evades +0.5 points" or "{FALSE_CUES} +2/h"'
    )
    found = _MARGIN.fullmatch(text)
    if found is None:
        raise UserError(f"--margin {text!r}: {example}")
    margin = Margin(found["event"], float(found["change"]), found["unit"])
    events = (FALSE_CUES,) if margin.unit == "/h" else tuple(EVENTS)
    if margin.event not in events:
        raise UserError(
            f"--margin {text!r}: no event {margin.event!r} has the unit {margin.unit}; expected"
            f" one of {', '.join(events)}{suggest_name(margin.event, events)}"
        )
    return margin


def judge_folders(first: Path, second: Path, margins: Sequence[Margin], most: int = 10) -> Gate:
    """Judge whether the results in `second` are worse than those in `first` by more than margins.

    most: largest number of changed runs to list. Raise UserError for results that cannot be
    compared, and StoreError.
    """
    compared = comparison.compare_folders(first, second, most)
    if not compared.pairs.compared:
        raise UserError(" ".join(compared.sentences()))
    rates = {rate.name: rate for rate in compared.rates}

    def judge(margin: Margin) -> Judgement:
        # Judges the change of one event, or of false cues per hour, against its margin.
        if margin.unit == "/h":
            before, after = _false_cues(first), _false_cues(second)
            sides = [f"{x.per_hour:.3g}/h ({x.count} in {x.hours:.2g} h)" for x in (before, after)]
            change = independent_difference(*(Estimate(*x[2:]) for x in (after, before)))
        else:
            rate = rates[EVENTS[margin.event]]
            sides = [wording.format_percent(side.value) for side in (rate.first, rate.second)]
            change = Estimate(*(100 * number for number in rate.difference))
        return Judgement(margin, sides[0], sides[1], change, judge_change(change, margin.change))

    return Gate(compared, [judge(margin) for margin in margins])


def judge_change(change: Estimate, margin: float) -> Verdict:
    """Compare a change with its margin. The change is harmful in the direction of the margin."""
    sign = math.copysign(1.0, margin)
    low, high = sorted((sign * change.low, sign * change.high))
    if not math.isfinite(change.low):
        low = high = sign * change.value
    if high <= abs(margin):
        return "pass"
    return "fail" if low > abs(margin) else "undecided"


def _false_cues(folder: Path) -> AlarmRate:
    # Returns the rate of false cues per hour of fault-free motion of a result folder.
    record = manifest.read_manifest(folder)
    with contextlib.closing(Runs.open(folder, record)) as runs:
        rate = runs.motions.cue_rate(record.verdict_cue)
    if rate is None:
        raise UserError(
            f"{folder}: has no fault-free motion with the pedal down, so false cues cannot be"
            f" counted. Compute fault-free motion: ravenjax fault-free {folder} HOURS"
        )
    return rate
