"""Code that these tests make is that of users."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _usual_code(usual_code):
    return usual_code
