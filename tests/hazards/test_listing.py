"""Hazards in words."""

from __future__ import annotations

import pytest

from ravenjax.errors import UserError
from ravenjax.hazards import library, listing


def test_a_description_says_hazard_source_and_how_it_is_run() -> None:
    said = dict(listing.description("C16"))
    assert said["hazard"] == "H1-1: the instrument is moved to an unintended location"
    assert said["source"] == "MCPS15 T3"
    assert (
        said["run 100ms"]
        == "offset {20, 50, 100} um at packet delx + dely + delz, from pedal 0 for 100 ms"
    )
    assert "unsafe control action" not in said


def test_a_description_says_why_a_hazard_is_not_run() -> None:
    said = dict(listing.description("K09"))
    assert said["not run"].startswith("homing is not simulated")
    assert said["effect on the robot"] == "3 of 3 injections"


@pytest.mark.parametrize("row", library.rows(), ids=lambda row: row.id)
def test_every_hazard_can_be_described(row: library.Hazard) -> None:
    said = dict(listing.description(row.id))
    assert len([what for what in said if what.startswith("run")]) == len(row.case)


def test_an_unknown_id_is_told() -> None:
    with pytest.raises(UserError, match="unknown hazard 'Z99'"):
        listing.description("Z99")
