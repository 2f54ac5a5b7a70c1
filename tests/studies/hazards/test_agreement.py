"""Verdicts on made-up runs."""

from typing import Any

import pytest
import result_rows

from ravenjax.hazards import library
from studies.hazards import safecomp45

STOP = {"response": "stopped"}
JUMP = {"jump_tip": True}
MOVED = {"unintended_mm": 9.0}
DROPPED = {"unintended_off_mm": 9.0}
SAID = {"response": "flagged"}
LIMITED = {"response": "limited"}


def outcome(name: str, *rows: dict[str, Any], **rules: float) -> safecomp45.HazardOutcome:
    table = result_rows.frame(
        *({"group": f"list/{name}", **row} for row in rows), {"group": "fault_free"}
    )
    (found,) = safecomp45.hazard_outcomes(table, (library.find_hazard(name),), **rules)
    return found


@pytest.mark.parametrize(
    ("name", "rows", "verdict"),
    [
        ("K01", [STOP, STOP], safecomp45.AGREE),  # published: stop
        ("K01", [STOP, {**STOP, **MOVED}], safecomp45.PARTLY),
        ("K01", [STOP, {**STOP, **DROPPED}], safecomp45.PARTLY),
        ("K01", [MOVED], safecomp45.DIFFER),
        ("K10", [{}, SAID], safecomp45.AGREE),  # published: none; a message alone is without effect
        ("K10", [{}, LIMITED], safecomp45.AGREE),  # nor is a limit of which nobody is told
        ("K10", [STOP], safecomp45.DIFFER),
        ("K11", [{**SAID}, STOP], safecomp45.AGREE),  # published: message, stop
        ("K06", [JUMP], safecomp45.AGREE),
        ("B24", [JUMP], safecomp45.UNPUBLISHED),
        ("M01", [JUMP], safecomp45.UNPUBLISHED),  # added for completeness
        ("K09", [], safecomp45.NOT_SIMULATED),
    ],
)
def test_verdicts(name: str, rows: list[dict[str, Any]], verdict: str) -> None:
    found = outcome(name, *rows)
    assert found.verdict == verdict
    assert found.reason == {
        safecomp45.NOT_SIMULATED: found.hazard.documented_only,
        safecomp45.PARTLY: found.hazard.departure,
        safecomp45.DIFFER: found.hazard.departure,
    }.get(verdict, "")
