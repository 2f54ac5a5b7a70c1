"""Which writing of the geometry a setup gets."""

from __future__ import annotations

import pytest

from ravenjax.numbers.setup import CAMPAIGN, ORIGINAL, REFERENCE, Precision
from ravenjax.robots.raven2.original.evaluation import LITERAL, SHARING, evaluation
from ravenjax.robots.raven2.setup import RavenSetup


@pytest.mark.parametrize(
    ("precision", "expected"),
    [
        (ORIGINAL, LITERAL),
        (Precision(narrow="float32", wide="float64"), LITERAL),  # whatever the width of the plant
        (CAMPAIGN, SHARING),
        (REFERENCE, SHARING),
    ],
)
def test_only_the_originals_widths_get_its_order_of_operations(precision, expected):
    assert evaluation(RavenSetup(precision=precision)) is expected
