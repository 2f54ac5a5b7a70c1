"""Study that repeats the list of 45 injections into the Raven-II that supplements SAFECOMP 2015:
outcome class of each row.

Classes are compared by the same rule for every row of the library. A row *shows* a class if at
least one activated run in ten has it. `message` alone counts as `none`, unless a message was
published. Equal sets `agree`; sets with a class in common agree `partly`; others `differ`.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from ravenjax.hazards import library
from ravenjax.hazards.library import Hazard
from ravenjax.hazards.naming import hazards_of
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.store import folder
from studies.hazards import classes, in_range
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    read_notes,
    read_table,
    read_variants,
    study,
)

AGREE, PARTLY, DIFFER = "agree", "partly", "differ"
NOT_SIMULATED, UNPUBLISHED = "not simulated", "no outcome published"
SEEN_SHARE = 0.1
EFFECTS = tuple(name for name in classes.CLASSES if name not in ("none", "message"))
"""Classes in which the fault affected the robot."""
_NO_OUTCOME = {"withheld", "unpublished"}


@dataclass(frozen=True)
class HazardOutcome:
    """The outcomes of the runs of one row of the library."""

    hazard: Hazard
    runs: int
    activated: int
    failed: int
    counts: Mapping[str, int]  # maps a class to the activated, valid runs that have it
    # Activated, valid runs with a published class and no other; 0 if none is published.
    fitting: int
    without_effect: int  # activated, valid runs of class `none`, or of `message` alone
    seen_share: float = SEEN_SHARE

    @property
    def valid(self) -> int:
        """Return the number of activated runs with an outcome, of which the counts are a part."""
        return self.activated - self.failed

    @property
    def shown(self) -> frozenset[str]:
        """Return the classes that it shows."""
        return _counted(
            {name for name, k in self.counts.items() if k and k >= self.seen_share * self.valid},
            self._published,
        )

    @property
    def verdict(self) -> str:
        """Return the verdict: one of the words in the module docstring."""
        if not self.hazard.runnable:
            return NOT_SIMULATED
        if self._published & _NO_OUTCOME or "completion" in self.hazard.source:
            return UNPUBLISHED
        if self.shown == self._published:
            return AGREE
        return PARTLY if self.shown & self._published else DIFFER

    @property
    def reason(self) -> str:
        """Return why it was not simulated, or the likely reason of a difference."""
        if self.verdict == NOT_SIMULATED:
            return self.hazard.documented_only
        return self.hazard.departure if self.verdict in (PARTLY, DIFFER) else ""

    @property
    def said(self) -> str:
        """Return its classes with their counts, most frequent first."""
        listed = sorted(self.counts.items(), key=lambda item: -item[1])
        return ", ".join(f"{name} {k}" for name, k in listed if k)

    @property
    def _published(self) -> frozenset[str]:
        return frozenset(self.hazard.expected_class)


def hazard_outcomes(
    frame: pd.DataFrame,
    rows: Sequence[Hazard] | None = None,
    limit_mm: float = LIMIT_MM,
    seen_share: float = SEEN_SHARE,
) -> list[HazardOutcome]:
    """Return one outcome per row of the library, in its order, from a campaign whose groups are
    named by hazards.

    `rows`: only these; None: the whole library. Rows without runs have zeros. `limit_mm`: as in
    `classes.classify_rows`.
    """
    class_flags = classes.classify_rows(frame, limit_mm)
    ids = [hazards_of(group) for group in frame["group"].astype(str)]
    listed = library.all_hazards() if rows is None else rows
    return [
        _outcome(
            row,
            frame,
            class_flags,
            pd.Series([row.id in has for has in ids], frame.index, bool),
            seen_share,
        )
        for row in listed
    ]


def _outcome(
    row: Hazard, frame: pd.DataFrame, class_flags: pd.DataFrame, mine: pd.Series, seen_share: float
) -> HazardOutcome:
    active = mine & frame["activated"].astype(bool)
    own = class_flags.loc[active & (frame["failed"] == "")]
    expected = frozenset(row.expected_class)
    sets = [
        _counted({name for name in own if has[name]}, expected) for has in own.to_dict("records")
    ]
    return HazardOutcome(
        row,
        int(mine.sum()),
        int(active.sum()),
        int(active.sum()) - len(own),
        {name: int(own[name].sum()) for name in classes.CLASSES},
        sum(bool(names) and names <= expected for names in sets),
        int((~own[[*EFFECTS]].any(axis=1)).sum()),
        seen_share,
    )


def _counted(shown: set[str], expected: frozenset[str]) -> frozenset[str]:
    if "message" in expected or "message" not in shown:
        return frozenset(shown)
    return frozenset(shown - {"message"} or {"none"})


NAME = "safecomp45"
BASELINE = "list"
LENGTHS = ("every_cycle", "draws_2")
"""Variants with another length of packets, and with other draws of it."""
FIRST_USB = 24
"""Number of the first injection of USB and PLC. Earlier ones are of console and control
software.
"""
FIRST_PLC = 35
"""Number of the first injection into the link to the PLC."""
OTHER_RULES: dict[str, dict[str, float]] = {
    "displaced from 1 mm": {"limit_mm": 1.0},
    "displaced from 5 mm": {"limit_mm": 5.0},
    "every class that is seen once": {"seen_share": 0.0},
    "classes of at least every second run": {"seen_share": 0.5},
}
"""Other limits of the comparison, to show how much the result depends on them."""
_UNSPOKEN = ("", "watchdog", "plc")
"""First responses of a run in which no check of the control software responded: only the PLC, or
nothing.
"""
_DAC_CHECKS = ("overdrive", "hard_counter")
"""Causes of a stop by overdrive detection."""


def compare(context: Context) -> Findings:
    """Compare rows of the list with the runs of each variant."""
    rows = injections()
    published = Published("safecomp")
    frames = {name: folder.read_all(path) for name, path in context.folders.items()}
    listed = tuple(rows.values())
    outcomes = {name: hazard_outcomes(frame, listed) for name, frame in frames.items()}
    baseline = outcomes[BASELINE]
    for words, rule in OTHER_RULES.items():
        outcomes[f"{BASELINE}, {words}"] = hazard_outcomes(frames[BASELINE], listed, **rule)
    agreed = [
        f"{name} {sum(one.verdict == AGREE for one in outcomes[name])}"
        for name in (BASELINE, *LENGTHS)
    ]
    missing = [
        f"INJ {number_of(one.hazard)} ({one.hazard.id})"
        for one in baseline
        if one.verdict == NOT_SIMULATED
    ]
    notes = read_notes(
        NAME, missing=", ".join(missing), first_plc=FIRST_PLC, agreed=", ".join(agreed)
    )
    if failed := sum(one.failed for one in baseline):
        notes = (*notes, f"{failed} runs gave no valid outcome and are in no count.")
    return Findings(
        lines=(*_agreement_lines(baseline), *_total_lines(frames[BASELINE], baseline, published)),
        tables=(
            read_table(NAME, "rows", map(_row, baseline)),
            read_table(NAME, "verdicts", verdict_rows(outcomes)),
        ),
        notes=notes,
    )


def injections() -> dict[int, Hazard]:
    """Return the row of the library for each number of the list, in the list's order."""
    numbered = {
        number_of(row): row for row in library.all_hazards() if row.source.startswith("INJ ")
    }
    return dict(sorted(numbered.items()))


def number_of(row: Hazard) -> int:
    """Return a row's number in the list."""
    return int(row.source.removeprefix("INJ "))


def verdict_rows(found: dict[str, list[HazardOutcome]]) -> Iterator[tuple[str | int, ...]]:
    """Yield how many rows have each verdict in each variant, and which rows change theirs."""
    baseline = {one.hazard.id: one.verdict for one in found[BASELINE]}
    for name, outcomes in found.items():
        counts = Counter(one.verdict for one in outcomes)
        changed = [
            f"{one.hazard.id} {one.verdict}"
            for one in outcomes
            if one.verdict != baseline[one.hazard.id]
        ]
        listed = (counts[verdict] for verdict in (AGREE, PARTLY, DIFFER, NOT_SIMULATED))
        yield name, *listed, ", ".join(changed)


def normal(row: Hazard) -> str:
    """Return how a row's values compare with the normal ranges of the signals they change; "" if it
    is not run.
    """
    verdicts = {in_range.verdict(fault) for case in row.case for fault in case.fault}
    return verdicts.pop() if len(verdicts) == 1 else in_range.EITHER if verdicts else ""


def unintended(outcome: HazardOutcome) -> bool:
    """Return whether a row shows motion that the operator did not command."""
    return bool({"jump", "displaced"} & outcome.shown)


def _row(one: HazardOutcome) -> tuple[str | int | float, ...]:
    row = one.hazard
    simulated = one.verdict != NOT_SIMULATED
    return (
        number_of(row),
        row.id,
        row.title,
        normal(row),
        row.expected,
        f"{row.activated} of {row.injected}" if row.injected else "",
        ", ".join(row.expected_class),
        f"{one.activated} of {one.runs}" if simulated else "",
        one.said,
        f"{one.fitting} of {one.valid}" if simulated else "",
        one.verdict,
        one.reason,
    )


def _agreement_lines(found: Sequence[HazardOutcome]) -> tuple[Line, ...]:
    simulated = [one for one in found if one.verdict != NOT_SIMULATED]
    software = [one for one in simulated if number_of(one.hazard) < FIRST_PLC]

    def share(
        quantity: str, of: Sequence[HazardOutcome], verdicts: tuple[str, ...], words: str
    ) -> Line:
        rows = sum(
            one.verdict in verdicts for one in of
        )  # the list is complete, so nothing is sampled
        value = StudyEstimate(100 * rows / len(of), n=len(of), of=words)
        return Line(quantity, "%", None, value, target="A7")

    return (
        share("rows whose classes agree", simulated, (AGREE,), "simulated rows"),
        share(
            "rows whose classes agree at least partly", simulated, (AGREE, PARTLY), "simulated rows"
        ),
        share(
            "rows whose classes agree, link to the PLC left out",
            software,
            (AGREE,),
            "simulated rows",
        ),
    )


def _total_lines(
    frame: pd.DataFrame, found: Sequence[HazardOutcome], published: Published
) -> tuple[Line, ...]:
    causes = frame.assign(
        id=[ids[0] if (ids := hazards_of(g)) else "" for g in frame["group"].astype(str)]
    )
    console = [one for one in found if number_of(one.hazard) < FIRST_USB]
    usb = [one for one in found if number_of(one.hazard) >= FIRST_USB]

    def mostly(one: HazardOutcome, of: Sequence[str]) -> bool:
        """Return whether most activated runs of a row that is unavailable stopped for one of these
        causes.
        """
        mine = causes.loc[
            (causes["id"] == one.hazard.id) & causes["activated"], "response_cause"
        ].astype(str)
        return len(mine) > 0 and bool(mine.isin(of).mean() > 0.5)

    def line(
        quantity: str,
        key: str,
        rows: Sequence[HazardOutcome],
        holds: Callable[[HazardOutcome], bool],
    ) -> Line:
        simulated = [one for one in rows if one.verdict != NOT_SIMULATED]
        predicted = sum(holds(one) for one in simulated)
        left = len(rows) - len(simulated)
        reason = f"{left} of the {len(rows)} rows are not simulated" if left else ""
        value = StudyEstimate(predicted, n=len(simulated), of="simulated rows")
        return Line(quantity, "rows", published.estimate(key), value, reason=reason)

    def unavailable(one: HazardOutcome) -> bool:
        return bool({"stop", "unresponsive"} & one.shown)

    return (
        line("unintended motion (a jump, or displaced)", "unintended", found, unintended),
        line(
            "USB and PLC: stopped or unresponsive, and no check of the software spoke in most runs",
            "usb_unresponsive",
            usb,
            lambda one: unavailable(one) and mostly(one, _UNSPOKEN),
        ),
        line("console and control: unintended motion", "console_harmful", console, unintended),
        line(
            "console and control: no impact",
            "console_none",
            console,
            lambda one: one.shown == {"none"},
        ),
        line(
            "console and control: stopped by the overdrive check in most runs, no unintended"
            " motion",
            "console_overdrive",
            console,
            lambda one: not unintended(one) and mostly(one, _DAC_CHECKS),
        ),
        line(
            "console and control: stopped or unresponsive otherwise, no unintended motion",
            "console_hang",
            console,
            lambda one: unavailable(one) and not unintended(one) and not mostly(one, _DAC_CHECKS),
        ),
    )


STUDY = study(NAME, variants=read_variants(NAME), compare=compare)
