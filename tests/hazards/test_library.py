"""The library's rows against the published list, and against what the robot has."""

import re

from ravenjax.hazards import library
from ravenjax.robots.raven2.declaration import SITES
from ravenjax.vocabulary.effects import EFFECTS
from ravenjax.vocabulary.sites import PARAMETER

# Counted by hand in the published lists, 3.2.1 to 3.2.5 of the fault specification: console and
# operator C01 to C19,
# network N01 to N07, control and state K01 to K23 (K15 to K18 are one line), USB, actuators and PLC
# B01 to B32 (B16 to
# B19 and B20, B21 are one line each), mechanics and instruments M01 to M08.
# C20 is a recall.
PUBLISHED = {"C": 20, "N": 7, "K": 23, "B": 32, "M": 8}

# Rows of the supplementary list of SAFECOMP 2015, each of which is one row here.
INJECTIONS = 45

DOCUMENTED_ONLY = {
    *("C04", "C17", "N06", "K08", "K09"),
    *("B09", "B21", "B22", "M03", "M04", "M05", "M06", "M07"),
}

UNITS = {"scale": "times", "bit_flip": "bit", "delay": "packets", "lose": "1"}
"""Effects whose value is not in the channel's unit, and what it is in."""


def test_every_published_row_is_there_once() -> None:
    expected = [
        f"{letter}{number:02}"
        for letter, count in PUBLISHED.items()
        for number in range(1, count + 1)
    ]
    assert len(expected) == 90
    assert sorted(row.id for row in library.all_hazards()) == sorted(expected)


def test_the_45_injections_are_there_once_each() -> None:
    cited = [
        int(n) for row in library.all_hazards() for n in re.findall(r"^INJ (\d+)$", row.source)
    ]
    assert sorted(cited) == list(range(1, INJECTIONS + 1))


def test_all_other_rows_can_be_run() -> None:
    assert {row.id for row in library.all_hazards() if not row.runnable} == DOCUMENTED_ONLY


def test_every_site_is_struck_by_some_hazard() -> None:
    struck = {
        struck.site for row in library.all_hazards() for case in row.case for struck in case.fault
    }
    # The published hazards change signals, not parameters.
    assert struck == set(SITES) - {PARAMETER}


def test_values_are_in_the_units_of_their_channels() -> None:
    slots = [slot for row in library.all_hazards() for case in row.case for slot in case.fault]
    for slot in slots:
        channels = {channel.name: channel for channel in SITES[slot.site].channels}
        units = dict.fromkeys(channels[name].unit for name in slot.channels)
        takes_value = EFFECTS[slot.effect].takes_value
        assert takes_value == (slot.value is not None)
        assert slot.unit == (UNITS.get(slot.effect, ", ".join(units)) if takes_value else None)
