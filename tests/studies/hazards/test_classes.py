"""Outcome classes of rows made by hand, each with a class that is known."""

from typing import Any

import pytest
import result_rows

from studies.hazards import classes

STANDS = {"idle_ms": 900, "peak_golden_deviation_mm": 12.0, "tip_path_mm": 40.0}
HALTED = {"pedal_down_ms": 500, **STANDS}

KNOWN = [
    ({}, {"none"}),
    ({"response": "flagged"}, {"message"}),
    ({"response": "limited"}, {"message"}),
    ({"unintended_off_mm": 5.0}, {"displaced"}),
    ({"response": "stopped"}, {"stop"}),
    ({"response": "stopped", **HALTED}, {"stop"}),
    (HALTED, {"stop"}),  # pedal-up without any check: run level stuck
    ({**HALTED, "response": "flagged"}, {"stop"}),
    ({**HALTED, "pedal_down_ms": 0}, {"unresponsive"}),  # never started
    (STANDS, {"unresponsive"}),
    ({**STANDS, "response": "flagged"}, {"unresponsive", "message"}),
    ({"pedal_down_ms": 2800 - classes.HALT_MS}, {"none"}),  # too short for the brakes
    ({"pedal_down_ms": 2799 - classes.HALT_MS}, {"stop"}),
    ({"unintended_mm": 5.0, "peak_golden_deviation_mm": 5.0}, {"displaced"}),
    (
        {"unintended_mm": 5.0, "peak_golden_deviation_mm": 5.0, "response": "stopped"},
        {"displaced", "stop"},
    ),
    (
        {
            "jump_tip": True,
            "largest_step_mm": 0.5,
            "unintended_mm": 30.0,
            "peak_golden_deviation_mm": 30.0,
        },
        {"jump"},
    ),
    ({"jump_text": True, "largest_step_mm": 0.9}, {"jump"}),
    ({"jump_tip": True, "largest_step_mm": 0.5, "response": "stopped"}, {"jump", "stop"}),
    ({"failed": "nan", "jump_text": True, "response": "stopped"}, set()),
]


def named(row: dict[str, Any]) -> set[str]:
    found = classes.classify_rows(result_rows.frame(row))
    return {name for name in found if found.loc[0, name]}


@pytest.mark.parametrize(("row", "expected"), KNOWN)
def test_known_rows(row: dict[str, Any], expected: set[str]) -> None:
    assert named(row) == expected


def test_the_limit_of_a_stray_can_be_chosen() -> None:
    table = result_rows.frame({"unintended_mm": 2.0})
    assert not classes.classify_rows(table).loc[0, "displaced"]
    assert classes.classify_rows(table, limit_mm=1.0).loc[0, "displaced"]
