"""Study that repeats the supplement of SAFECOMP 2015, a list of 45 injections into the Raven-II,
and compares the outcome classes of each injection.

An injection has a class if at least one in ten of its activated runs has this class. `message`
alone counts as `none`, unless a message was published. Published and predicted classes agree if
both sets are equal, agree partly if they have a class in common, and otherwise differ.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import pandas as pd

from ravenjax.hazards import library
from ravenjax.hazards.library import Hazard
from ravenjax.hazards.naming import hazards_of
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.store import folder
from studies import study
from studies.hazards import classes
from studies.study import Line, Published, StudyEstimate

AGREE, PARTLY, DIFFER = "agree", "agree partly", "differ"
NOT_SIMULATED, UNPUBLISHED = "not simulated", "no outcome published"
SEEN_SHARE = 0.1
HARMFUL, UNAVAILABLE = ("displaced", "jump"), ("stop", "unresponsive")
"""Classes of motion that the operator did not command, and of a robot that stands."""
NAME, BASELINE = "safecomp45", "list"
LENGTHS = ("every_cycle", "draws_2")
"""Variants with other packet lengths, and with packet lengths from another random seed."""
FIRST_USB, FIRST_PLC = 24, 35
"""Numbers of the first injection of USB and PLC, and of the first into the link to the PLC."""
OTHER_RULES: dict[str, dict[str, float]] = {
    "class displaced from 1 mm": {"limit_mm": 1.0},
    "class displaced from 5 mm": {"limit_mm": 5.0},
    "classes that at least one run has": {"seen_share": 0.0},
    "classes that at least half of the runs have": {"seen_share": 0.5},
}
"""Other limits of the comparison, to show how much the result depends on them."""
_UNSPOKEN, _DAC_CHECKS = ("", "watchdog", "plc"), ("overdrive", "hard_counter")
"""Causes of a stop that are no check of the control software, and those of the overdrive check."""


class HazardOutcome(NamedTuple):
    """The outcomes of the runs of one hazard of the library."""

    hazard: Hazard
    runs: int
    activated: int
    valid: int  # activated runs with an outcome, of which the counts are a part
    counts: Mapping[str, int]  # maps a class to the activated, valid runs that have it
    shown: Collection[str]  # classes of the hazard
    # Activated, valid runs with a published class and no other; 0 if none is published.
    fitting: int
    without_effect: int  # activated, valid runs of class `none`, or of `message` alone
    causes: Mapping[str, int]  # maps what stopped a run to the activated runs, failed ones too

    def shows(self, names: Collection[str]) -> bool:
        """Return whether the hazard has one of these classes."""
        return not {*names}.isdisjoint(self.shown)

    def mostly(self, causes: Collection[str]) -> bool:
        """Return whether most activated runs have one of these causes."""
        return 2 * sum(self.causes.get(cause, 0) for cause in causes) > self.activated

    @property
    def verdict(self) -> str:
        """Return the verdict: one of the words in the module docstring."""
        published = {*self.hazard.expected_class}
        if not self.hazard.runnable:
            return NOT_SIMULATED
        if published & {"withheld", "unpublished"} or "completion" in self.hazard.source:
            return UNPUBLISHED
        if self.shown == published:
            return AGREE
        return PARTLY if self.shows(published) else DIFFER

    @property
    def reason(self) -> str:
        """Return why it was not simulated, or the likely reason of a difference."""
        if self.verdict == NOT_SIMULATED:
            return self.hazard.documented_only
        return self.hazard.departure if self.verdict in (PARTLY, DIFFER) else ""

    @property
    def said(self) -> str:
        """Return the classes with their numbers of runs, most frequent first."""
        return ", ".join(f"{name} {k}" for name, k in Counter(self.counts).most_common() if k)


def hazard_outcomes(
    frame: pd.DataFrame,
    rows: Sequence[Hazard],
    limit_mm: float = LIMIT_MM,
    seen_share: float = SEEN_SHARE,
) -> list[HazardOutcome]:
    """Return the outcome of each hazard. The name of a group contains the ids of its hazards."""
    flags = classes.classify_rows(frame, limit_mm)
    ids = frame["group"].astype(str).map(hazards_of)

    def outcome(row: Hazard) -> HazardOutcome:
        mine = frame.loc[ids.map(lambda names: row.id in names).astype(bool)]
        active, expected = mine.loc[mine["activated"].astype(bool)], {*row.expected_class}
        own = flags.loc[active.index[active["failed"] == ""]]

        def counted(shown: Sequence[bool]) -> set[str]:
            names = {*own.columns[shown]}
            if "message" in expected or "message" not in names:
                return names
            return names - {"message"} or {"none"}

        counts, each = own.sum(), [counted(has) for has in own.to_numpy()]
        return HazardOutcome(
            row,
            len(mine),
            len(active),
            len(own),
            counts.to_dict(),
            counted((counts > 0) & (counts >= seen_share * len(own))),
            sum(bool(names) and names <= expected for names in each),
            int((~own[[*UNAVAILABLE, *HARMFUL]].any(axis=1)).sum()),
            Counter(active["response_cause"].astype(str)),
        )

    return [outcome(row) for row in rows]


def compare(context: study.Context) -> study.Findings:
    """Compare the injections of the list with the runs of each variant."""
    listed = tuple(injections().values())
    frames = {name: folder.read_all(path) for name, path in context.folders.items()}
    outcomes = {name: hazard_outcomes(frame, listed) for name, frame in frames.items()}
    baseline = outcomes[BASELINE]
    for words, rule in OTHER_RULES.items():
        outcomes[f"{BASELINE}, {words}"] = hazard_outcomes(frames[BASELINE], listed, **rule)
    agreed = [
        f"{name} {sum(one.verdict == AGREE for one in outcomes[name])}"
        for name in (BASELINE, *LENGTHS)
    ]
    missing = [f"INJ {number_of(row)} ({row.id})" for row in listed if not row.runnable]
    failed = sum(one.activated - one.valid for one in baseline)
    found = study.findings(
        NAME,
        (*_agreement_lines(baseline), *_total_lines(baseline)),
        {"rows": map(_row, baseline), "verdicts": verdict_rows(outcomes)},
        missing=", ".join(missing),
        first_plc=FIRST_PLC,
        agreed=", ".join(agreed),
    )
    lost = (f"{failed} runs failed and count nowhere.",) if failed else ()
    return replace(found, notes=found.notes + lost)


def injections() -> dict[int, Hazard]:
    """Return the hazard of each injection by its number, in the order of the list."""
    listed = (row for row in library.all_hazards() if row.source.startswith("INJ "))
    return dict(sorted((number_of(row), row) for row in listed))


def number_of(row: Hazard) -> int:
    """Return the number of an injection in the list."""
    return int(row.source.removeprefix("INJ "))


def verdict_rows(found: dict[str, list[HazardOutcome]]) -> Iterator[tuple[str | int, ...]]:
    """Yield the numbers of verdicts by variant, and the hazards with another verdict than first."""
    for name, outcomes in found.items():
        counts = Counter(one.verdict for one in outcomes)
        changed = [
            f"{one.hazard.id} {one.verdict}"
            for one, base in zip(outcomes, found[BASELINE], strict=True)
            if one.verdict != base.verdict
        ]
        yield name, *(counts[v] for v in (AGREE, PARTLY, DIFFER, NOT_SIMULATED)), ", ".join(changed)


def _row(one: HazardOutcome) -> tuple[str | int | float, ...]:
    row = one.hazard
    return (
        *(number_of(row), row.id, row.title, row.expected),
        f"{row.activated} of {row.injected}" if row.injected else "",
        ", ".join(row.expected_class),
        f"{one.activated} of {one.runs}" if row.runnable else "",
        one.said,
        f"{one.fitting} of {one.valid}" if row.runnable else "",
        *(one.verdict, one.reason),
    )


def _agreement_lines(found: Sequence[HazardOutcome]) -> Iterator[Line]:
    simulated = [one for one in found if one.hazard.runnable]
    software = [one for one in simulated if number_of(one.hazard) < FIRST_PLC]
    words = "injections whose classes agree"
    for quantity, rows, verdicts in (
        (words, simulated, (AGREE,)),
        (f"{words} at least partly", simulated, (AGREE, PARTLY)),
        (f"{words}, without the link to the PLC", software, (AGREE,)),
    ):
        # The list is complete, so nothing is sampled.
        agreed = sum(one.verdict in verdicts for one in rows)
        value = StudyEstimate(100 * agreed / len(rows), n=len(rows), of="simulated injections")
        yield Line(quantity, "%", None, value, target="A7")


def _total_lines(found: Sequence[HazardOutcome]) -> Iterator[Line]:
    published, each = Published("safecomp"), [(one.hazard, _totals(one)) for one in found]
    for key, row in published.numbers.items():
        rows = [(hazard.runnable, counted[key]) for hazard, counted in each if key in counted]
        if not rows:
            continue
        simulated = [counts for runnable, counts in rows if runnable]
        left = len(rows) - len(simulated)
        reason = f"{left} of the {len(rows)} injections are not simulated" if left else ""
        value = StudyEstimate(sum(simulated), n=len(simulated), of="simulated injections")
        yield Line(row["what"], "injections", published.estimate(key), value, reason=reason)


def _totals(one: HazardOutcome) -> dict[str, bool]:
    """Return whether each published number for this part of the robot counts the injection."""
    harmful, stands, dac = one.shows(HARMFUL), one.shows(UNAVAILABLE), one.mostly(_DAC_CHECKS)
    if number_of(one.hazard) >= FIRST_USB:
        return {"unintended": harmful, "usb_unresponsive": stands and one.mostly(_UNSPOKEN)}
    return {
        "unintended": harmful,
        "console_harmful": harmful,
        "console_none": one.shown == {"none"},
        "console_overdrive": dac and not harmful,
        "console_hang": stands and not harmful and not dac,
    }


STUDY = study.study(NAME, study.read_variants(NAME), compare)
