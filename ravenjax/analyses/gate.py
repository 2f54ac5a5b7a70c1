"""Decides whether a change made results worse: a test of non-inferiority for each event.

Two results of the same faults are compared. A margin is the largest accepted increase of an event's
rate. An event with a confidence interval passes if the whole 95 % interval lies within the margin.
It fails if no part of the interval does, and is undecided otherwise.

The intervals are those of `ravenjax compare`: paired over distinct faults (Bonett and Price 2012),
and clustered if a fault has several pairs. Enumerated faults have no interval, so their difference
alone is compared with the margin. False cues per hour are compared as two independent results. The
interval of their difference combines exact Poisson intervals by square-and-add (Zou, Donner 2008).
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
    r"\s*(?P<event>[a-z ]+?)\s*(?P<limit>[+-]\d+(\.\d+)?)\s*(?P<unit>points|/h)\s*"
)
Verdict = Literal["pass", "fail", "undecided"]


class Margin(NamedTuple):
    """The largest accepted rise (positive) or fall (negative) of an event's rate."""

    event: str
    limit: float  # percentage points, or per hour
    unit: str  # "points" or "/h"

    def __str__(self) -> str:
        return f"{self.event} {self.limit:+g}{'/h' if self.unit == '/h' else ' points'}"


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
        """The change as text, with its unit if that is percentage points, and its interval."""
        interval = "no interval, because the faults are enumerated"
        if math.isfinite(self.change.low):
            interval = f"95 % interval {self.change.low:+,.4g} to {self.change.high:+,.4g}"
        unit = "" if self.margin.unit == "/h" else " points"
        return f"{self.change.value:+,.4g}{unit} ({interval})"


class Gate(NamedTuple):
    """All judgements on two result folders."""

    compared: FolderComparison
    judgements: Sequence[Judgement]

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if a margin is exceeded, else 2 if a verdict is undecided, else 0."""
        verdicts = {judgement.verdict for judgement in self.judgements}
        if "fail" in verdicts:
            return 1
        return 2 if "undecided" in verdicts else 0


def parse_margin(text: str) -> Margin:
    """Return the margin of the text, such as "evades +0.5 points" or "false cues +2/h".

    Raise UserError for any other form, an unknown event, or an event with a wrong unit.
    """
    example = (
        "expected an event, a signed number and a unit, such as"
        f' "evades +0.5 points" or "{FALSE_CUES} +2/h"'
    )
    found = _MARGIN.fullmatch(text)
    if found is None:
        raise UserError(f"--margin {text!r}: {example}")
    margin = Margin(found["event"], float(found["limit"]), found["unit"])
    events = (FALSE_CUES,) if margin.unit == "/h" else tuple(EVENTS)
    if margin.event not in events:
        raise UserError(
            f"--margin {text!r}: got the event {margin.event!r}; for the unit {margin.unit},"
            f" expected one of {', '.join(events)}{suggest_name(margin.event, events)}"
        )
    return margin


def judge_folders(first: Path, second: Path, margins: Sequence[Margin], most: int) -> Gate:
    """Compare the results in folder `second` with the results in folder `first`, and judge the
    change of each margin's event. most: largest number of changed runs to list.

    Raise UserError for results that cannot be compared, and StoreError for unreadable folders.
    """
    compared = comparison.compare_folders(first, second, most)
    if not compared.pairs.compared:
        raise UserError(" ".join(compared.sentences()))
    rates = {rate.name: rate for rate in compared.rates}

    def judge(margin: Margin) -> Judgement:
        # Judges the change of one event, or of false cues per hour, against its margin.
        if margin.unit == "/h":
            before, after = _false_cues(first), _false_cues(second)
            first_text, second_text = _format_alarms(before), _format_alarms(after)
            change = independent_difference(
                Estimate(after.per_hour, after.low, after.high),
                Estimate(before.per_hour, before.low, before.high),
            )
        else:
            rate = rates[EVENTS[margin.event]]
            first_text = wording.format_percent(rate.first.value)
            second_text = wording.format_percent(rate.second.value)
            # From shares to percentage points.
            change = Estimate(*(100 * share for share in rate.difference))
        verdict = judge_change(change, margin.limit)
        return Judgement(margin, first_text, second_text, change, verdict)

    return Gate(compared, [judge(margin) for margin in margins])


def judge_change(change: Estimate, limit: float) -> Verdict:
    """Return "pass" if the whole interval of the change is within the limit, "fail" if no part is,
    else "undecided". A positive limit is the largest accepted rise, a negative one the largest
    accepted fall. Of a change without an interval, the value is compared.
    """
    # With this sign, a change for the worse is positive.
    sign = math.copysign(1.0, limit)
    low, high = sorted((sign * change.low, sign * change.high))
    if not math.isfinite(change.low):
        low = high = sign * change.value
    if high <= abs(limit):
        return "pass"
    return "fail" if low > abs(limit) else "undecided"


def _format_alarms(rate: AlarmRate) -> str:
    return f"{rate.per_hour:.3g}/h ({rate.count} in {rate.hours:.2g} h)"


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
