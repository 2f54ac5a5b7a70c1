"""What a search asks of a run: columns and events of the result table."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.analyses.search.file import outcome
from ravenjax.outcomes.events import Rules
from ravenjax.store import schema

FRAME = pd.DataFrame(
    {
        "peak_model_deviation_mm": [0.5, 3.0, 4.0, 9.0],
        "jump_code": [False, True, False, True],
        "response": ["silent", "stopped", "flagged", "stopped"],
        "response_ms": [-1, 700, 20, 30],
        "hazard": ["unintended motion", "unintended motion", "none", "false report"],
        "cue1_first_ms": [-1, 600, 20, 30],
        "golden_cue1_first_ms": [-1, -1, 10, -1],
        "failed": ["", "", "", "nan"],
    }
)
RULES = Rules(cue=1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("peak_model_deviation_mm", [0.5, 3.0, 4.0]),
        ("peak_model_deviation_mm>=3", [0, 1, 1]),
        ("peak_model_deviation_mm <= 3", [1, 1, 0]),
        ("jump_code", [0, 1, 0]),
        ("response = stopped", [0, 1, 0]),
        ("evades", [1, 0, 0]),
        ("told", [0, 1, 1]),
        ("cue", [0, 1, 0]),
        ("hazard = none", [0, 0, 1]),
        ("response_ms <= 100", [0, 0, 1]),  # a response that never came is not an early one
    ],
)
def test_values(text, expected):
    values = outcome.parse_outcome(text).values(FRAME, RULES)
    np.testing.assert_array_equal(values[:3], expected)
    assert np.isnan(values[3]), "a failed run has no valid outcome"


def test_margins_are_zero_at_the_bound_and_grow_into_the_event():
    np.testing.assert_allclose(
        outcome.parse_outcome("peak_model_deviation_mm >= 3").margins(FRAME)[:3], [-2.5, 0.0, 1.0]
    )
    np.testing.assert_allclose(
        outcome.parse_outcome("peak_model_deviation_mm <= 3").margins(FRAME)[:3], [2.5, 0.0, -1.0]
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("peak_model_deviation", "Did you mean 'peak_model_deviation_mm'"),
        ("response", "response = stopped"),
        ("jump_code = yes", "is a column of numbers"),
        ("response_ms", "-1 if the event never happened"),
        ("fault0_value", "unknown outcome"),
        ("cable_overload", "cable tensions of this robot are unknown"),
    ],
)
def test_complaints_say_what_to_write(text, told):
    (complaint,) = outcome.parse_outcome(text).complaints(schema.Shape())
    assert told in complaint
