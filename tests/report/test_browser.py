"""The report in a real browser: offline, without an error, every figure drawn, nothing wider than the window."""

from __future__ import annotations

import csv
import io
import shutil

import numpy as np
import pytest
import reacting_results as reacting

from ravenjax.report import page
from ravenjax.store import trace_log
from ravenjax.store.folder import ResultFolder

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (pip install playwright)")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the path (apt-get install chromium)")

ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader"]  # a container has no sandbox, and no GPU for WebGL
OF_DRIVER = ("GPU stall due to ReadPixels", "willReadFrequently")
"""Remarks of a software GPU driver, which no page can answer for."""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "reacting"
    frame = reacting.frame(300)
    frame.loc[frame["group"] == "encoder", "group"] = "C09 encoder"  # a hazard of the library, for the risk table
    results = ResultFolder.open(folder, reacting.manifest(len(frame)))
    for rows in results.missing(500):
        results.add(frame.iloc[rows.start : rows.stop])
    results.close(compile_s=1.0, run_s=1.0, rows=len(frame))
    time = np.arange(800)
    model = np.stack([0.01 * np.sin(time / 100), 0.01 * np.cos(time / 100), 1e-5 * time], axis=1)
    worst = frame.loc[frame["failed"] == ""].nlargest(2, "peak_live_deviation_mm")
    (folder / "traces").mkdir()
    for run_id in worst["run_id"]:
        series = {"gold/model_position": model, "gold/tip": model + 1e-5 * time[:, None], "gold/position": model}
        trace_log.write(folder / "traces" / f"{run_id}.mcap", series)
    return page.build(folder)


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield launched
        launched.close()


class Window:
    """The report in a window; close() fails where the page asked a network for anything, or told of an error."""

    def __init__(self, browser, report, width, scheme="light"):
        self.context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.asked, self.told = [], []
        self.context.route("**/*", self._guard)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.told.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.told.append(f"pageerror: {error}"))
        self.page.goto(report.as_uri())
        self.page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        self.page.wait_for_function(
            "[...document.querySelectorAll('.figure')].every((place) => place.querySelector('.main-svg'))"
        )

    def _guard(self, route):
        if route.request.url.startswith(("file:", "data:", "blob:")):
            route.continue_()
        else:
            self.asked.append(route.request.url)
            route.abort()

    def close(self):
        self.context.close()
        assert self.asked == []
        assert [text for text in self.told if not any(part in text for part in OF_DRIVER)] == []


@pytest.fixture(scope="module")
def opened(browser, report):
    window = Window(browser, report, 1280)
    yield window.page
    window.close()


@pytest.mark.parametrize(
    ("width", "scheme"),
    [(1280, "light"), *(pytest.param(*look, marks=pytest.mark.slow) for look in ((1280, "dark"), (420, "light")))],
)
def test_the_page_opens_offline_and_fits(browser, report, width, scheme):
    window = Window(browser, report, width, scheme)
    ask = window.page.evaluate
    assert ask("document.documentElement.scrollWidth") <= width
    figures = ask("[...document.querySelectorAll('.figure')].map((place) => place.dataset.figure)")
    assert {"curves", "lead", "roc", "precision_recall", "tradeoff", "spared", "exceedance", "path-0"} <= set(figures)
    empty = ask(
        "[...document.querySelectorAll('.figure')].filter((place) => !place.data || !place.data.length"
        " || place.clientHeight < 100).map((place) => place.dataset.figure)"
    )
    assert empty == []
    named = ask("[...document.querySelectorAll('main section, footer')].map((part) => part.id)")
    linked = ask("[...document.querySelectorAll('nav a')].map((link) => link.hash.slice(1))")
    assert named == linked and {"detectors", "reaction", "robots", "risk", "paths", "precision"} <= set(named)
    colours = [ask(f"getComputedStyle(document.body).{name}") for name in ("color", "backgroundColor")]
    ink, ground = (sum(map(int, one.removeprefix("rgb(").removesuffix(")").split(","))) for one in colours)
    assert (ink > ground) == (scheme == "dark") and abs(ink - ground) > 400
    axis = ask("document.querySelector('[data-figure=curves]').layout.font.color")
    assert axis == ("#c9cdd2" if scheme == "dark" else "#3a424c")
    window.close()


def test_classes_are_chosen_by_a_tab(opened):
    shown = (
        "[...document.querySelectorAll('.tab')].filter((part) => part.offsetParent).map((part) => part.dataset.kind)"
    )
    assert opened.evaluate(shown) == ["layer"]
    opened.click("label[for=class-group]")
    assert opened.evaluate(shown) == ["group"]


def test_every_table_comes_as_csv(opened):
    names = opened.evaluate("[...document.querySelectorAll('[data-csv]')].map((button) => button.dataset.csv)")
    assert {"faults_by_layer", "detector_levels", "cues", "reaction_pairs", "dependences", "precision"} <= set(names)
    for name in names:
        text = opened.evaluate(f"JSON.parse(document.getElementById('csv-{name}').textContent)")
        rows = list(csv.reader(io.StringIO(text)))
        assert len(rows) > 1 and {len(row) for row in rows} == {len(rows[0])}, name
    with opened.expect_download() as waiting:
        opened.click("[data-csv=cues]")
    assert waiting.value.suggested_filename == "synthetic_cues.csv"
    assert waiting.value.path().read_text(encoding="utf-8").startswith("number,cue_threshold_mm,")


@pytest.mark.parametrize("name", ["curves", "roc"])
def test_a_figure_comes_as_svg(opened, name):
    with opened.expect_download() as waiting:
        opened.click(f"[data-svg={name}]")
    text = waiting.value.path().read_text(encoding="utf-8")
    assert text.startswith("<svg") and text.rstrip().endswith("</svg>") and "share of" in text


def test_a_path_is_played(opened):
    player = opened.locator("[data-path=path-0]")
    place = "document.querySelector('[data-figure=path-0]')"
    start = opened.evaluate(f"{place}.data.at(-2).x[0]")
    player.locator("input").fill("150")
    assert "ms" in player.locator("output").inner_text()
    opened.wait_for_function(f"{place}.data.at(-2).x[0] !== {start}")
    player.locator("input").fill("0")  # the whole way is left: it does not end by itself before the second click
    player.locator("button").click()
    assert player.locator("button").inner_text() == "stop"
    player.locator("button").click()
    assert player.locator("button").inner_text() == "play"
