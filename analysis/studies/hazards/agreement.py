"""Outcome classes of the simulated runs of a hazard beside the published ones, row by row of the
library.

How they are compared, the same for every row:

- A row *shows* a class where at least one activated run in ten has it: in the five to twenty
  injections that were published of a row, a rarer one would probably not have been seen.
- `message` alone is an outcome without effect: it counts as `none`, but where a message was
  published; beside another class it is left out, for messages were not written down throughout.
- Equal sets `agree`; sets with a class in common agree `partly`; others `differ`. A row that cannot
  be run is `not simulated` and counts as neither; one whose outcome was not published, or that the
  library adds for completeness with an expectation of its own, is `no outcome published`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from ravenjax.hazards import classes, library
from ravenjax.hazards.library import Hazard
from ravenjax.hazards.naming import hazards_of
from ravenjax.outcomes.verdict import LIMIT_MM

AGREE, PARTLY, DIFFER = "agree", "partly", "differ"
NOT_SIMULATED, UNPUBLISHED = "not simulated", "no outcome published"
SEEN_SHARE = 0.1
EFFECTS = tuple(name for name in classes.CLASSES if name not in ("none", "message"))
"""Classes in which the fault had an effect on the robot."""
_NO_OUTCOME = {"withheld", "unpublished"}


@dataclass(frozen=True)
class HazardOutcome:
    """What the runs of one row of the library did."""

    hazard: Hazard
    runs: int
    activated: int
    failed: int
    counts: Mapping[str, int]  # class -> activated, valid runs that have it
    fitting: (
        int  # activated, valid runs with a published class and no other; 0 where none is published
    )
    without_effect: int  # activated, valid runs of class `none`, or of `message` alone
    seen_share: float = SEEN_SHARE

    @property
    def valid(self) -> int:
        """Activated runs with an outcome: what the counts are of."""
        return self.activated - self.failed

    @property
    def shown(self) -> frozenset[str]:
        """Classes that it shows."""
        return _counted(
            {name for name, k in self.counts.items() if k and k >= self.seen_share * self.valid},
            self._published,
        )

    @property
    def verdict(self) -> str:
        """One of the words above."""
        if not self.hazard.runnable:
            return NOT_SIMULATED
        if self._published & _NO_OUTCOME or "completion" in self.hazard.source:
            return UNPUBLISHED
        if self.shown == self._published:
            return AGREE
        return PARTLY if self.shown & self._published else DIFFER

    @property
    def reason(self) -> str:
        """Why it was not simulated, or the likely reason of a difference."""
        if self.verdict == NOT_SIMULATED:
            return self.hazard.documented_only
        return self.hazard.departure if self.verdict in (PARTLY, DIFFER) else ""

    @property
    def said(self) -> str:
        """Its classes with their counts, most frequent first."""
        listed = sorted(self.counts.items(), key=lambda item: -item[1])
        return ", ".join(f"{name} {k}" for name, k in listed if k)

    @property
    def _published(self) -> frozenset[str]:
        return frozenset(self.hazard.expected_class)


def outcomes(
    frame: pd.DataFrame,
    rows: Sequence[Hazard] | None = None,
    limit_mm: float = LIMIT_MM,
    seen_share: float = SEEN_SHARE,
) -> list[HazardOutcome]:
    """One a row of the library, in its order, of the result table of a campaign whose groups are
    named by hazards.

    rows: only these; None: the whole library. Rows without runs have zeros. limit_mm: as in
    `classes.classify`.
    """
    class_flags = classes.classify(frame, limit_mm)
    ids = [hazards_of(group) for group in frame["group"].astype(str)]
    listed = library.rows() if rows is None else rows
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
    """The classes that are compared, of those that are there."""
    if "message" in expected or "message" not in shown:
        return frozenset(shown)
    return frozenset(shown - {"message"} or {"none"})
