"""Severities of rows made by hand."""

from typing import Any

import pytest
import result_rows

from studies.hazards import classes

ENDLESS = {"fault0_duration_ms": classes.UNTIL_END}
STANDS = {"idle_ms": 900}
STRAYS = {"unintended_mm": 5.0}


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ({}, 0),
        ({"response": "flagged"}, 1),
        ({"response": "stopped"}, 2),
        (STANDS, 2),
        ({"response": "stopped", **ENDLESS}, 3),
        ({**STANDS, "fault0_every_ms": 100}, 3),
        ({**STRAYS, "response": "flagged"}, 4),
        ({**STRAYS, "response": "limited"}, 5),  # nobody is told of a clip
        ({**STRAYS, "cue0_first_ms": 700}, 4),
        (
            {**STRAYS, "cue0_first_ms": 700, "golden_cue0_first_ms": 600},
            5,
        ),  # a cue of the motion, not of the fault
        (STRAYS, 5),
        ({"jump_tip": True, **ENDLESS}, 5),
        ({"jump_tip": True, "response": "stopped", **ENDLESS}, 4),
        ({"tissue_depth_mm": 4.5, "golden_tissue_depth_mm": 3.0}, 5),
        ({"tissue_depth_mm": 4.0, "golden_tissue_depth_mm": 3.5}, 0),  # the operator went there
    ],
)
def test_known_rows(row: dict[str, Any], expected: int) -> None:
    assert classes.rate_severity(result_rows.frame(row))[0] == expected


def test_a_failed_run_has_none() -> None:
    found = classes.rate_severity(result_rows.frame({}, {"failed": "nan", "jump_text": True}))
    assert found[0] == 0
    assert found.isna().tolist() == [False, True]
