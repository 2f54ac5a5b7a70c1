"""A browser for the tests of a module."""

import pytest
from chromium import ARGUMENTS, CHROMIUM


@pytest.fixture(scope="module")
def browser():
    """Chromium, launched once."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield launched
        launched.close()
