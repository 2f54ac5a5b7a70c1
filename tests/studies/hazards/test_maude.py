"""Shares of adverse event reports as data."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from studies.hazards import maude


def test_shares_are_those_of_the_counts() -> None:
    found = maude.reports()
    assert found.reports == 10624
    assert {one.name: one.count for one in found.category}["system errors"] == 536
    with pytest.raises(ValidationError, match="is not a share of"):
        maude.Reports.model_validate(
            {
                "reports": 100,
                "source": "x",
                "category": [{"name": "a", "count": 5, "share": 0.1, "source": "x"}],
            }
        )
