"""A browser, and a session without its physics, for the tests of a module."""

import pytest
from fake_session import FakeSession
from page_visit import CHROMIUM, FLAT


@pytest.fixture(scope="module")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        yield playwright.chromium


@pytest.fixture(scope="module")
def browser(chromium):
    launched = chromium.launch(executable_path=CHROMIUM, args=FLAT)
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    made = FakeSession(folder=tmp_path_factory.mktemp("session"))
    made.wait()
    yield made
    made.close()
