"""Hazards in words."""

from __future__ import annotations

from ravenjax.hazards import listing


def test_a_description_says_hazard_source_and_how_it_is_run() -> None:
    said = dict(listing.description("C16"))
    assert said["hazard"] == "H1-1: the instrument is moved to an unintended location"
    assert said["source"] == "MCPS15 T3"
    assert (
        said["run 100ms"]
        == "offset {20, 50, 100} um at packet delx + dely + delz, from pedal 0 for 100 ms"
    )
    assert "unsafe control action" not in said
