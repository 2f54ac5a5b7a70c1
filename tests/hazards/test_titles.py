"""Titles of hazards by the names of groups."""

from __future__ import annotations

import pytest

from ravenjax.hazards import library, titles


@pytest.mark.parametrize("group", ["C13", "library/C13", "C13 scaled", "library/C13-case"])
def test_a_group_has_the_title_of_its_hazard(group):
    assert titles.of_group(group) == library.find("C13").title


def test_several_and_none():
    both = titles.of_group("B07,B08 no write")
    assert both == f"{library.find('B07').title}; {library.find('B08').title}"
    assert titles.of_group("K15-K19 run level").endswith("; 2 more")
    assert titles.of_group("encoder") == titles.of_group("Z99") == ""
