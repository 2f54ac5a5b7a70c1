"""The page under keys, fingers and a screen reader, and the files it writes, in a real browser."""

import csv
import io
from xml.etree import ElementTree

import numpy as np
import pytest
from chromium import NEEDED, PATIENCE_MS
from PIL import Image

from ravenjax.analyses.explorer import page

pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [pytest.mark.slow, NEEDED]
HELD = """{
  const compile = WebAssembly.compile;
  const held = new Promise((resolve) => (window.begin = resolve));
  WebAssembly.compile = (code) => held.then(() => compile(code));
}"""
SVG = "{http://www.w3.org/2000/svg}"
RUN = "#at=usb_out&arm=gold&on=shoulder&does=overwrite&size=20000&from=400&for=64&map=value~duration_ms&ms=430"  # noqa: E501
FILE = """
[campaign]
name = "small"
duration_s = 0.8
arms = ["gold"]
[operator]
motion = "suture"
seed = 1
[[group]]
name = "motor"
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow"]
effect = "overwrite"
value = [-20000, 20000]
start_ms = 400
duration_ms = 64
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("used")
    (folder / "small.toml").write_text(FILE)
    return page.build_page(folder / "small.toml", folder / "page.html")


@pytest.fixture
def opened(browser, place):
    """Opens the page, as a context of these settings has it, at an address."""
    contexts, told = [], []

    def opens(address="", **settings):
        contexts.append(browser.new_context(**settings))
        shown = contexts[-1].new_page()
        shown.set_default_timeout(PATIENCE_MS)
        shown.on("pageerror", lambda error: told.append(str(error)))
        shown.goto(place.as_uri() + address)
        if address:
            shown.wait_for_selector("#run:not([hidden])")
            shown.wait_for_selector("#chain li")
        shown.wait_for_function("document.body.dataset.filled === '1'")
        return shown

    yield opens
    for context in contexts:
        context.close()
    assert told == []


def saved(shown, name):
    with shown.expect_download() as waiting:
        shown.click(f"[data-save='{name}']")
    return waiting.value.suggested_filename, waiting.value.path().read_bytes()


def picture(content):
    image = Image.open(io.BytesIO(content))
    image.load()
    return image.size, np.asarray(image.convert("RGBA")).reshape(-1, 4)


def test_the_map_is_saved_as_drawing_picture_and_table(opened):
    shown = opened(viewport={"width": 1366, "height": 900})
    points = sum(int(one) for one in shown.locator("#legend b").all_text_contents())
    name, content = saved(shown, "svg")
    assert name == "small_usb_out_overwrite.svg"
    drawing = ElementTree.fromstring(content)
    assert len(drawing.findall(f"{SVG}rect")) == points + 3  # paper, ground and frame
    words = [text.text for text in drawing.iter(f"{SVG}text")]
    assert "size, counts" in words and "lasts, ms" in words
    _, content = saved(shown, "png")
    size, pixels = picture(content)
    assert size == tuple(shown.evaluate("[field.width, field.height]"))
    assert len(np.unique(pixels, axis=0)) > 10
    name, content = saved(shown, "csv")
    rows = list(csv.DictReader(io.StringIO(content.decode())))
    assert name.endswith(".csv")
    assert len(rows) == points
    assert {"site", "value", "duration_ms", "verdict", "unintended_mm", "class"} <= set(rows[0])


def test_keys_alone_choose_a_run_scrub_it_and_lead_back(opened):
    shown = opened(viewport={"width": 1366, "height": 900})
    shown.keyboard.press("Tab")
    assert _focused(shown) == ("A", "")
    order, wanted = [], ["site", "effect", "across", "up", "field"]
    while "field" not in order:
        shown.keyboard.press("Tab")
        order.append(_focused(shown)[1])
    assert [name for name in order if name in wanted] == wanted
    assert shown.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    before = shown.inner_text("#spot")
    shown.keyboard.press("ArrowRight")
    shown.keyboard.press("ArrowUp")
    assert shown.inner_text("#spot") != before
    shown.keyboard.press("Enter")
    shown.wait_for_function("document.activeElement.id === 'run-title'")
    while _focused(shown)[1] != "time":
        shown.keyboard.press("Tab")
    at = int(shown.input_value("#time"))
    shown.keyboard.press("ArrowRight")
    assert int(shown.input_value("#time")) == at + 1
    spoken = shown.get_attribute("#time", "aria-valuetext")
    assert spoken.startswith(f"{at + 1} ms, unintended motion ")
    shown.keyboard.press("Escape")
    assert _focused(shown)[1] == "field"


def test_a_click_while_the_robot_starts_opens_the_run_once_it_is_computed(browser, place):
    shown = browser.new_page(viewport={"width": 1366, "height": 768})
    shown.set_default_timeout(PATIENCE_MS)
    shown.add_init_script(HELD)
    shown.goto(place.as_uri())
    shown.wait_for_function("document.getElementById('fault-words').textContent")
    box = shown.locator("#field").bounding_box()
    shown.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.4 * box["height"])
    assert "being computed" in shown.inner_text("#spot")
    shown.evaluate("begin()")
    shown.wait_for_selector("#run:not([hidden])")
    shown.wait_for_function("scrollY > 0")
    shown.wait_for_function("document.body.dataset.filled === '1'")
    shown.evaluate("scrollTo(0, 0)")
    box = shown.locator("#field").bounding_box()
    # A click beside the cells chooses no run.
    shown.mouse.click(box["x"] + 4, box["y"] + 4)
    assert shown.evaluate("scrollY") == 0
    shown.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 0.4 * box["height"])
    shown.wait_for_function("scrollY > 0")
    shown.close()


def test_whatever_is_used_has_a_role_and_a_name(opened):
    shown = opened(RUN, viewport={"width": 1366, "height": 900})
    tree = shown.locator("body").aria_snapshot()
    assert "evade every safety check" in tree or "evades every safety check" in tree
    for role, name in [
        ("application", "map of outcomes"),
        ("combobox", "Where the fault acts"),
        ("combobox", "What the fault does"),
        ("slider", "Size"),
        ("slider", "time, ms"),
        ("button", "Find the smallest size that does harm"),
        ("button", "Play"),
        ("img", "the robot and its instrument tips"),
        ("heading", "One operation, with the fault and without"),
        ("region", "Choose a fault"),
    ]:
        assert shown.get_by_role(role, name=name).count() >= 1, (role, name)
    nameless = [
        line
        for line in tree.splitlines()
        if line.strip() in ("- button", "- combobox", "- slider", "- spinbutton", "- img", "- link")
    ]
    assert nameless == []


def test_fingers_open_a_run_scrub_and_turn_without_scrolling_away(opened):
    shown = opened(viewport={"width": 360, "height": 740}, has_touch=True, is_mobile=True)
    field = shown.locator("#field")
    field.scroll_into_view_if_needed()
    box = field.bounding_box()
    assert shown.locator("#run").is_hidden()
    shown.touchscreen.tap(box["x"] + 0.9 * box["width"], box["y"] + 0.4 * box["height"])
    shown.wait_for_selector("#run:not([hidden])")
    shown.wait_for_selector("#chain li")
    shown.locator("#time").scroll_into_view_if_needed()
    box = shown.locator("#time").bounding_box()
    middle = box["y"] + box["height"] / 2
    _dragged(shown, [[(box["x"] + share * box["width"], middle)] for share in (0.2, 0.4, 0.6)])
    assert int(shown.input_value("#time")) == pytest.approx(0.6 * 800, abs=40)
    before = saved(shown, "figure")[1]
    turned = _after(shown, lambda x, y: [[(x, y + 20 * k)] for k in range(5)])
    nearer = _after(
        shown, lambda x, y: [[(x - 20 - 8 * k, y), (x + 20 + 8 * k, y)] for k in range(5)]
    )
    assert len({before, turned, nearer}) == 3
    assert shown.evaluate("visualViewport.scale") == 1


def _focused(shown):
    return tuple(shown.evaluate("[document.activeElement.tagName, document.activeElement.id]"))


def _after(shown, steps):
    """The robot's picture after fingers moved on it, which do not scroll the page."""
    shown.locator("#figure").scroll_into_view_if_needed()
    box = shown.locator("#figure").bounding_box()
    top = shown.evaluate("scrollY")
    _dragged(shown, steps(box["x"] + box["width"] / 2, box["y"] + box["height"] / 4))
    assert shown.evaluate("scrollY") == top
    return saved(shown, "figure")[1]


def _dragged(shown, steps):
    """Fingers go through these places, and leave."""
    client = shown.context.new_cdp_session(shown)
    for k, fingers in enumerate(steps):
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        client.send(
            "Input.dispatchTouchEvent",
            {"type": "touchMove" if k else "touchStart", "touchPoints": points},
        )
    client.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    client.detach()
