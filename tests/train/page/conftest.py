"""A browser, and a session without its physics, for the tests of a module."""

import pytest
from chromium import CHROMIUM
from fake_session import FakeSession


@pytest.fixture(scope="module")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        yield playwright.chromium


@pytest.fixture(scope="module")
def browser(chromium):
    # without the scene: sixty frames a second, with a GPU or not
    arguments = ["--no-sandbox", "--disable-gpu"]
    launched = chromium.launch(executable_path=CHROMIUM, args=arguments)
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    made = FakeSession(folder=tmp_path_factory.mktemp("session"))
    made.wait()
    yield made
    made.close()
