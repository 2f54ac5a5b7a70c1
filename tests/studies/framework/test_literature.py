"""Published numbers: each file is well formed, and a bad one is refused with its place."""

from __future__ import annotations

import math
import tomllib

import pytest

from ravenjax.errors import UserError
from studies.framework import literature

FILES = sorted(path.stem for path in literature.FOLDER.glob("*.toml"))
ROW = '[[number]]\nkey = "a.peak"\nvalue = 2.0\nunit = "mm"\nsource = "Figure 1"\n'


def test_seed_is_there_and_every_number_has_a_source():
    published = literature.read("seed")
    assert len(published.numbers) > 30 and len(published.bands) == 7
    assert all(
        row.source and row.key for row in (*published.numbers.values(), *published.bands.values())
    )


def test_the_readings_of_the_paper_are_those_of_the_fault_specification():
    published = literature.read("seed")
    assert [published.value(f"fault_free.peak.{s}") for s in ("0.05", "0.1", "0.15", "0.2")] == [
        0.9,
        2.1,
        2.85,
        3.6,
    ]
    assert [published.value(f"fault_free.mean.{s}") for s in ("0.05", "0.1", "0.15", "0.2")] == [
        0.3,
        0.6,
        0.9,
        1.4,
    ]
    assert [published.value(f"burst.{k}.peak") for k in (1, 2, 3, 4)] == [3.65, 3.3, 5.0, 6.65]
    assert [published.value(f"pulse.{k}.force") for k in (1, 2, 3, 4)] == [
        0.0166,
        0.0133,
        0.0296,
        0.05,
    ]
    assert published.band("a6.mean") == (0.7, 2.5) and published.band("a5.onset") == (0.15, 0.25)


def test_what_was_read_off_a_figure_has_a_reading_error():
    for row in literature.read("seed").numbers.values():
        if row.source.startswith("read off"):
            assert row.error is not None, row.key


def test_an_estimate_has_the_interval_of_its_reading():
    text = (
        ROW
        + "error = 0.1\n"
        + ROW.replace("a.peak", "b")
        + ROW.replace("a.peak", "c")
        + "low = 1.5\nhigh = 3.0\n"
    )
    published = literature.parse(text, "test")
    read = published.estimate("a.peak")
    assert (read.value, read.low, read.high, read.n, read.of) == (2.0, 1.9, 2.1, 0, "Figure 1")
    assert math.isnan(published.estimate("b").low)
    assert (published.estimate("c").low, published.estimate("c").high) == (1.5, 3.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROW + ROW, "stand twice: a.peak"),
        (ROW.replace('source = "Figure 1"\n', ""), "number.0.source"),
        (ROW + "error = 0.1\nlow = 1.0\nhigh = 3.0\n", "either error, or low and high"),
        (ROW + "low = 3.0\nhigh = 4.0\n", "low <= value <= high"),
        (ROW + "low = 1.0\n", "both low and high"),
        (ROW + "colour = 1\n", "number.0.colour"),
        ('[[band]]\nkey = "x"\nlow = 2.0\nhigh = 1.0\nunit = ""\nsource = "s"\n', "low <= high"),
        ("[[number]\n", "not valid TOML"),
    ],
)
def test_a_bad_file_is_refused(text, words):
    with pytest.raises(UserError, match=words.replace(".", r"\.")) as error:
        literature.parse(text, "here.toml")
    assert str(error.value).startswith("here.toml")


def test_unknown_names_are_told_apart():
    with pytest.raises(UserError, match="seed"):
        literature.read("nothing")
    with pytest.raises(KeyError, match="burst"):
        literature.read("seed").value("burst.1.peek")


@pytest.mark.parametrize("name", FILES)
def test_files_are_toml(name):
    assert tomllib.loads((literature.FOLDER / f"{name}.toml").read_text())
