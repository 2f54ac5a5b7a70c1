"""The report in a real browser: offline, without an error, every figure drawn, nothing wider
than the window.
"""

import csv
import io
import xml.etree.ElementTree as ET

import pytest
import reacting_results as reacting
import synthetic_results as synthetic
from chromium import CHROMIUM, NEEDED

from ravenjax.report import page

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [pytest.mark.slow, NEEDED]

ARGUMENTS = ["--no-sandbox"]  # a container has none


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "reacting"
    frame = reacting.frame(300)
    # A hazard of the library, for the risk table.
    frame.loc[frame["group"] == "encoder", "group"] = "C09 encoder"
    return page.build_report(synthetic.folder(folder, frame, reacting.manifest(len(frame))))


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield launched
        launched.close()


class Window:
    """The report in a window; close() fails where the page asked a network for anything, or told
    of an error.
    """

    def __init__(self, browser, report, width, scheme="light"):
        self.context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme
        )
        self.asked, self.told = [], []
        self.context.route("**/*", self._guard)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.told.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.told.append(f"pageerror: {error}"))
        self.page.goto(report.as_uri())
        # On a phone all sections but the first are closed.
        folds = self.page.locator("button.fold[aria-expanded=false]")
        assert (folds.count() > 5) == (width <= 640)
        folds.evaluate_all("(found) => found.forEach((button) => button.click())")

    def _guard(self, route):
        if route.request.url.startswith(("file:", "data:", "blob:")):
            route.continue_()
        else:
            self.asked.append(route.request.url)
            route.abort()

    def close(self):
        self.context.close()
        assert self.asked == []
        assert self.told == []


@pytest.fixture(scope="module")
def opened(browser, report):
    window = Window(browser, report, 1280)
    yield window.page
    window.close()


VISIBLE = "(one) => one.getBoundingClientRect().height > 0"


@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), (360, "light"), (1280, "dark"), (1920, "light")]
)
def test_the_page_opens_offline_and_fits(browser, report, width, scheme):
    window = Window(browser, report, width, scheme)
    ask = window.page.evaluate
    ask("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    assert ask("document.documentElement.scrollWidth") <= width
    cut = "[...document.querySelectorAll('.cards td')].some((x) => x.scrollWidth > x.offsetWidth)"
    assert not ask(cut)
    charts = ask(
        "[...document.querySelectorAll('figure.plot')].map((place) => place.dataset.figure)"
    )
    assert {"curves", "roc", "precision_recall", "tradeoff"} <= set(charts)
    shown = ask(
        "[...document.querySelectorAll('figure.plot')].map((place) =>"
        f" [...place.querySelectorAll(':scope > svg')].filter({VISIBLE}).length)"
    )
    assert set(shown) == {1}  # one drawing of each chart, wide or narrow
    letters = ask(
        "[...document.querySelectorAll('figure.plot > svg text')]"
        ".filter((one) => one.getBoundingClientRect().height > 0)"
        ".map((one) => one.getBoundingClientRect()).map((box) => [box.left, box.right, box.height])"
    )
    assert letters and min(high for *_, high in letters) >= 8  # px, readable
    assert min(left for left, *_ in letters) >= 0 and max(right for _, right, _ in letters) <= width
    named = ask("[...document.querySelectorAll('main section, footer')].map((part) => part.id)")
    linked = ask("[...document.querySelectorAll('nav a')].map((link) => link.hash.slice(1))")
    assert named == linked and {"detectors", "reaction"} <= set(named)
    colours = [
        ask(f"getComputedStyle(document.body).{name}") for name in ("color", "backgroundColor")
    ]
    ink, ground = (
        sum(map(int, one.removeprefix("rgb(").removesuffix(")").split(","))) for one in colours
    )
    assert (ink > ground) == (scheme == "dark") and abs(ink - ground) > 400
    axis = ask(
        "getComputedStyle([...document.querySelectorAll('[data-figure=curves] text')].at(-1)).fill"
    )
    assert axis == colours[0]
    window.close()


def test_on_paper_nothing_is_cut(browser, report):
    window = Window(browser, report, 700)  # px of A4 between its margins
    window.page.emulate_media(media="print")
    ask = window.page.evaluate
    wide = ask(
        "[...document.querySelectorAll('section, header, table, figure,"
        " svg')].filter((one) => { const box = one.getBoundingClientRect(); return"
        " box.width > 0 && box.right > innerWidth + 1; }).map((one) => one.tagName + ' ' +"
        " one.className + ' ' + one.closest('section, header')?.id)"
    )
    assert wide == []
    heads = ask(
        "[...document.querySelectorAll('.groups thead th')].map((head) => head.innerText.trim())"
    )
    # The buttons that sort are gone, their words are not.
    assert "group" in [head.lower() for head in heads]
    assert ask("getComputedStyle(document.querySelector('nav')).display") == "none"
    window.close()
    printed = browser.new_page()
    printed.goto(report.as_uri())
    pdf = printed.pdf(prefer_css_page_size=True)
    printed.close()
    pages = pdf.count(b"/Type /Page\n") + pdf.count(b"/Type/Page/")
    assert pdf.startswith(b"%PDF") and 3 <= pages <= 25


def test_values_are_read_off_a_chart(opened):
    area = opened.locator("[data-figure=curves] svg.wide")
    area.scroll_into_view_if_needed()
    box = area.locator(".hit").bounding_box()
    opened.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.5)
    told = opened.locator(".tip").inner_text()
    assert "ms" in told and "haptic cue" in told and "%" in told
    opened.mouse.move(2, 2)
    assert not opened.locator(".tip").is_visible()


def test_a_curve_is_hidden_and_shown_by_its_name(opened):
    button = opened.locator("[data-figure=curves] .legend button").first
    mark = opened.locator("[data-figure=curves] svg.wide .mark[data-series='0']").last
    button.click()
    assert button.get_attribute("aria-pressed") == "false" and not mark.is_visible()
    button.click()
    assert button.get_attribute("aria-pressed") == "true" and mark.is_visible()


def test_every_table_comes_as_csv(opened):
    names = opened.evaluate(
        "[...document.querySelectorAll('[data-csv]')].map((button) => button.dataset.csv)"
    )
    wanted = {"faults_by_layer", "detector_thresholds", "cues", "reaction_pairs"}
    assert wanted <= set(names)
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
    root = ET.fromstring(text)
    words = [part.text for part in root.iter("{http://www.w3.org/2000/svg}text")]
    assert any("share of" in word for word in words) and any(
        "stop by a check" in word or "built-in" in word for word in words
    )  # axis, legend
    assert "var(" not in text and "class=" not in text  # needs no style sheet
