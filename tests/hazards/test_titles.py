"""Titles of hazards by the names of groups."""

from __future__ import annotations

from ravenjax.hazards import library, titles


def test_several_and_none():
    both = titles.of_group("B07,B08 no write")
    assert both == f"{library.find('B07').title}; {library.find('B08').title}"
    assert titles.of_group("K15-K19 run level").endswith("; 2 more")
    assert titles.of_group("encoder") == titles.of_group("Z99") == ""
