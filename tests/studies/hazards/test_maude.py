"""Shares of adverse event reports as data."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from ravenjax.hazards import library
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


def test_categories_name_words_that_the_library_has() -> None:
    words = library.terms()["hazards"]
    scenarios = {name for row in library.rows() for name in row.scenarios}
    for one in maude.reports().category:
        assert set(one.hazards) <= set(words)
        assert set(one.scenarios) <= scenarios
        assert set(one.ids) <= {row.id for row in library.rows()}


def test_rows_of_a_category() -> None:
    by_name = {one.name: one for one in maude.reports().category}
    assert [row.id for row in by_name["broken instruments"].rows] == ["M01"]
    assert "B09" not in {row.id for row in by_name["system errors"].rows}  # cannot be run
    assert {"C02", "B24"} <= {row.id for row in by_name["unintended operation"].rows}
    assert not by_name["video"].rows
