"""The library's rows against the published list, and what a wrong row is told."""

from __future__ import annotations

import re

import pytest

from ravenjax.errors import UserError
from ravenjax.hazards import library
from ravenjax.robots.raven2.sites import SITES

# Counted by hand in the published lists, 3.2.1 to 3.2.5 of the fault specification: console and
# operator C01 to C19,
# network N01 to N07, control and state K01 to K23 (K15 to K18 are one line), USB, actuators and PLC
# B01 to B32 (B16 to
# B19 and B20, B21 are one line each), mechanics and instruments M01 to M08.
PUBLISHED = {"C": 19, "N": 7, "K": 23, "B": 32, "M": 8}

# Rows of the supplementary list of SAFECOMP 2015, each of which is one row here.
INJECTIONS = 45

DOCUMENTED_ONLY = {
    *("C04", "C17", "N06", "K08", "K09"),
    *("B09", "B21", "B22", "M03", "M04", "M05", "M06", "M07"),
}

SCENARIOS = {  # as the specification maps rows to the training scenarios of IROS 2016
    "temporarily unavailable": "C01 C02 C03 C04 C05 C19 N01 N02 N03 N04 K15 K16 K17 K18 B06 B14",
    "permanently unavailable": "B01 B02 B03 B04 B05 B07 B08 B09 B10 B11 B12 B23 B31 B32 K08",
    "sudden jump": "C09 C11 K06 K09 B11 B24 B25 B26 B27 B28 B29 M01 M02",
}

ROW = """
layer = "L7"
[[hazard]]
id = "X01"
title = "a title"
target = "DAC"
hazards = ["H2"]
needs = ["D"]
kind = "stuck"
values = "1"
when = "ever"
expected = "jump"
expected_class = ["jump"]
impact = "none"
source = "none"
[[hazard.case]]
fault = [{ site = "usb_out", channel = "elbow", effect = "overwrite", value = 1, unit = "cnt", start_ms = 1 }]
"""  # noqa: E501


def test_every_published_row_is_there_once() -> None:
    expected = [
        f"{letter}{number:02}"
        for letter, count in PUBLISHED.items()
        for number in range(1, count + 1)
    ]
    assert len(expected) == 89
    assert sorted(row.id for row in library.rows()) == sorted(expected)


def test_the_45_injections_are_there_once_each() -> None:
    cited = [int(n) for row in library.rows() for n in re.findall(r"^INJ (\d+)$", row.source)]
    assert sorted(cited) == list(range(1, INJECTIONS + 1))


def test_rows_that_cannot_be_run_say_why() -> None:
    assert {row.id for row in library.rows() if not row.runnable} == DOCUMENTED_ONLY
    assert all(len(row.documented_only) > 10 for row in library.rows() if not row.runnable)


def test_what_lies_beyond_a_simulator_is_not_run() -> None:
    assert not [row.id for row in library.rows() if "X" in row.needs and row.runnable]


def test_each_source_is_explained() -> None:
    known = library.terms()["sources"]
    for row in library.rows():
        assert any(row.source.startswith(name) for name in known), f"{row.id}: {row.source}"


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_training_scenarios(scenario: str) -> None:
    found = {row.id for row in library.rows() if scenario in row.scenarios}
    assert found == set(SCENARIOS[scenario].split())


def test_layers_come_in_the_robots_order() -> None:
    numbers = [int(row.layer[1:]) for row in library.rows()]
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(1, 11))


def test_every_site_is_struck_by_some_hazard() -> None:
    struck = {struck.site for row in library.rows() for case in row.case for struck in case.fault}
    assert struck == set(SITES)


def test_find_suggests_an_id() -> None:
    assert library.find("B27").source == "SEED"
    with pytest.raises(
        UserError, match=r"unknown hazard 'C9', expected an id .* Did you mean 'C\d9'"
    ):
        library.find("C9")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'site = "usb_out"',
            'site = "usb_uot"',
            r"L7.toml: hazard X01: case.0.fault.0: unknown site .* 'usb_out'",
        ),
        (
            'channel = "elbow"',
            'channel = "elbo"',
            r"unknown channel of site usb_out 'elbo'.*Did you mean 'elbow'",
        ),
        (
            'effect = "overwrite"',
            'effect = "overrite"',
            r"unknown effect 'overrite'.*Did you mean 'overwrite'",
        ),
        (
            'effect = "overwrite", value = 1, unit = "cnt"',
            'effect = "drop"',
            r"'drop' belongs to site 'network'",
        ),
        ("value = 1, ", "", r"effect 'overwrite' takes a value, got None"),
        ('unit = "cnt"', 'unit = "rad"', r"unit: got 'rad', expected 'cnt'"),
        (
            "start_ms = 1",
            'start_ms = 1, trigger = "pedl"',
            r"unknown trigger 'pedl'.*Did you mean 'pedal'",
        ),
        (
            "start_ms = 1",
            "start_ms = 1, begin = 2",
            r"fault.0.begin: Extra inputs are not permitted",
        ),
        ("value = 1,", "value = { unifrm = [0, 1] },", r"unknown distribution 'unifrm'"),
        (
            "start_ms = 1",
            "start_ms = 1, period_ms = 20",
            r"period_ms belongs to effect 'periodic', got .*'overwrite'",
        ),
        ('hazards = ["H2"]', 'hazards = ["H9"]', r"unknown hazards 'H9', expected one of H1-1"),
        (
            'expected_class = ["jump"]',
            'expected_class = ["leap"]',
            r"unknown expected_class 'leap'",
        ),
        ('source = "none"', 'source = ""', r"hazard X01: source: String should have at least 1"),
        (
            'source = "none"',
            'source = "x"\ndocumented_only = "why"',
            r"either cases, or documented_only",
        ),
        ("[[hazard.case]]", "[[hazard.case]]\nruns = 3", r"design 'grid' with runs 3"),
    ],
)
def test_a_wrong_row_is_told_with_its_place(old: str, new: str, message: str) -> None:
    assert library.parse(ROW, "L7.toml")[0].runnable
    assert ROW.count(old) == 1
    with pytest.raises(UserError, match=message):
        library.parse(ROW.replace(old, new), "L7.toml")


def test_expected_classes_and_departures_say_something() -> None:
    words = library.terms()["classes"]
    for row in library.rows():
        assert row.expected_class and set(row.expected_class) <= set(words), row.id
        assert not row.departure or row.runnable, f"{row.id}: what is not run departs from nothing"
