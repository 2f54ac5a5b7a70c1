"""Run ids: a hash of what a row holds and of nothing else, written and found as hex digits."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from ravenjax.campaign.faults import run_id

WORDS = {"site": pd.Categorical(["dac", "", "dac"]), "arm": pd.Categorical(["gold", "", "green"])}
NUMBERS = {"seed": np.array([1, 2, 3]), "value": np.array([0.5, np.nan, -0.0])}


def test_the_hash_of_a_number_is_that_of_splitmix64():
    """The generator's first outputs from seed 0, as its authors' reference implementation prints
    them.
    """
    states = np.arange(1, 4, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    assert [hex(x) for x in run_id.mixed(states)] == [
        "0xe220a8397b1dcdaf",
        "0x6e789e6aa1b965f4",
        "0x6c45d188009454f",
    ]


def test_order_of_columns_and_form_of_numbers_do_not_count():
    ids = run_id.of("common", WORDS, NUMBERS)
    backwards = run_id.of("common", dict(reversed(WORDS.items())), dict(reversed(NUMBERS.items())))
    assert (ids == backwards).all()
    plain = {"seed": np.array([1.0, 2.0, 3.0]), "value": np.array([0.5, np.nan, 0.0])}
    assert (ids == run_id.of("common", WORDS, plain)).all()
    other_codes = {
        name: column.set_categories(["x", *column.categories]) for name, column in WORDS.items()
    }
    assert (ids == run_id.of("common", other_codes, NUMBERS)).all()


def test_what_a_row_does_not_have_does_not_count():
    """Rows of a table that has one slot and one parameter more."""
    ids = run_id.of("common", WORDS, NUMBERS)
    more = {"site1": pd.Categorical(["", "", "dac"])}
    wider = run_id.of("common", WORDS | more, NUMBERS | {"a": np.array([np.nan, 1.0, np.nan])})
    assert (ids == wider).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("common", "words", "numbers"),
    [
        ("another", {}, {}),
        ("common", {"arm": pd.Categorical(["green", "gold", "gold"])}, {}),
        ("common", {}, {"seed": np.array([2, 3, 1])}),
        ("common", {}, {"value": np.array([1.5, 0.0, 0.5])}),
    ],
)
def test_everything_else_counts_in_every_row(common, words, numbers):
    ids = run_id.of("common", WORDS, NUMBERS)
    assert not (ids == run_id.of(common, WORDS | words, NUMBERS | numbers)).any()


def test_copies_are_told_apart_by_their_order():
    row = {"a": np.array([7.0, 5.0, 7.0, 7.0])}
    ids = run_id.of("", {}, row)
    assert len(set(ids.tolist())) == 4
    assert (ids[:2] == run_id.of("", {}, {"a": np.array([7.0, 5.0])})).all()
    assert (ids[[0, 2, 3]] == run_id.of("", {}, {"a": np.array([7.0, 7.0, 7.0])})).all()


def test_text_is_16_hex_digits_and_found_again():
    ids = np.array([0xABC, 0xABCD000000000000, 2**64 - 1, 0xABCE000000000000], np.uint64)
    text = run_id.text(ids).to_pylist()
    assert text == ["0000000000000abc", "abcd000000000000", "f" * 16, "abce000000000000"]
    for row, digits in enumerate(text):
        assert run_id.beginning(ids, digits).tolist() == [row]
    assert run_id.beginning(ids, "abc").tolist() == [1, 3]
    assert [len(run_id.beginning(ids, wrong)) for wrong in ("", "xyz", "0x1", "+1", "0" * 17)] == [
        0
    ] * 5


def test_streams_of_two_purposes_are_strangers():
    ids = run_id.mixed(np.arange(1, 4097, dtype=np.uint64))
    one, other = run_id.stream(ids, "slot 0"), run_id.stream(ids, "slot 1")
    assert one.dtype == np.uint32 and not (one == other).any()
    ones = np.unpackbits((one ^ other).view(np.uint8)).mean()
    assert abs(ones - 0.5) < 0.01, "5 standard deviations of a fair coin are 0.007"
