"""The page in a real browser, from a file: what a new user does with it, and the native run that
must say the same.
"""

import os
import re
import subprocess
import sysconfig
import tomllib

import pytest
from chromium import NEEDED, PATIENCE_MS

from ravenjax.analyses.explorer import page
from ravenjax.campaign import loading
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.stop import adaptive
from ravenjax.store import manifest
from ravenjax.store.folder import Results

pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [pytest.mark.slow, NEEDED]
CLIPBOARD = """Object.defineProperty(navigator, "clipboard", {
  value: { writeText: async (text) => (window.copied = text) },
});"""
CELLS = """() => Object.fromEntries(
  [...document.querySelectorAll("#numbers-of-run tr")].map((row) => [...row.cells].map((cell) => cell.textContent)),
)"""  # noqa: E501
SAID = """() => {
  const said = document.getElementById("said").textContent;
  return said.includes("unintended motion") && said;
}"""
VIEW = "#at=usb_out&arm=gold&on=shoulder&does=overwrite&size=20000&from=700&for=64&map=value~start_ms&ms=800"  # noqa: E501
FILE = """
[campaign]
name = "small"
duration_s = 1.2
arms = ["gold"]
[operator]
motion = "suture"
seed = 1
[haptics]
threshold_mm = [3, 2]
[[group]]
name = "motor"
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow"]
effect = "overwrite"
value = [-20000, 12000, 20000]
start_ms = 700
duration_ms = [16, 64]
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explored")
    (folder / "small.toml").write_text(FILE)
    adaptive.run_adaptively(
        loading.load_campaign(folder / "small.toml"), folder / "results", "simd"
    )
    return page.build_page(folder / "results", folder / "page.html")


@pytest.fixture
def window(browser, place):
    """The page in a window; at the end it fails where the page asked a network for anything, or
    told of an error.
    """
    context = browser.new_context(viewport={"width": 1366, "height": 900})
    asked, told = [], []

    def guard(route):
        if route.request.url.startswith(("file:", "data:", "blob:")):
            route.continue_()
        else:
            asked.append(route.request.url)
            route.abort()

    context.route("**/*", guard)
    shown = context.new_page()
    shown.set_default_timeout(PATIENCE_MS)
    shown.on("console", lambda message: told.append(f"{message.type}: {message.text}"))
    shown.on("pageerror", lambda error: told.append(f"pageerror: {error}"))
    shown.add_init_script(CLIPBOARD)
    shown.goto(place.as_uri())
    yield shown
    context.close()
    assert asked == []
    assert told == []


def filled(shown):
    """Wait until the map of the present question is complete; a question that changes makes it
    incomplete at once.
    """
    shown.wait_for_function("document.body.dataset.filled === '1'")


def test_a_new_user_asks_moves_a_control_opens_a_run_and_gets_the_same_natively(window, tmp_path):
    filled(window)
    answer = window.inner_text("#answer")
    assert "evade every safety check" in answer
    assert sum(int(one) for one in window.locator("#legend b").all_inner_texts()) >= 1000
    window.select_option("#channel", "gold/elbow")
    filled(window)
    assert window.inner_text("#answer") != answer
    field = window.locator("#field")
    box = field.bounding_box()
    field.click(position={"x": 0.9 * box["width"], "y": 0.35 * box["height"]})
    window.wait_for_selector("#run:not([hidden])")
    verdict = window.evaluate("document.body.dataset.verdict")
    assert verdict.count("/") == 2
    window.locator("#time").fill("705")
    assert window.inner_text("#now").startswith("705 ms")
    assert "motor command after the checks" in window.inner_text("#chain")
    assert "ms=705" in _when(window, "location.hash.includes('ms=705') && location.hash")
    window.click("[data-copy=command]")
    command = _when(window, "window.copied")
    path = f"{sysconfig.get_path('scripts')}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(
        ["bash", "-ec", command], cwd=tmp_path, env=os.environ | {"PATH": path}, check=True
    )
    folder = tmp_path / "explored"
    native = Results(manifest.read_manifest(folder).shape, folder).frame().iloc[0]
    assert native["verdict"] == verdict
    shown = window.evaluate(CELLS)
    assert float(shown["unintended_mm"]) == pytest.approx(
        native["unintended_mm"], rel=1e-3, abs=1e-3
    )
    assert int(shown["first_active_ms"]) == native["first_active_ms"]


def test_an_address_brings_the_same_view_and_the_smallest_harmful_size_is_that_natively(
    window, place, tmp_path
):
    window.goto(place.as_uri() + VIEW)
    window.reload()
    window.wait_for_selector("#run:not([hidden])")
    assert window.input_value("#across") == "value"
    assert window.input_value("#up") == "start_ms"
    window.click("#smallest")
    said = _when(window, SAID)
    bad, safe = (int(word) for word in re.findall(r"ith (\S+)", said))
    assert bad == safe + 1
    raw = tomllib.loads(_copied(window, "toml"))
    assert raw["group"][0]["fault"][0]["value"] == bad
    raw["group"][0]["fault"][0]["value"] = [safe, bad]
    adaptive.run_adaptively(validate_tables(raw), tmp_path / "native", "simd")
    native = Results(manifest.read_manifest(tmp_path / "native").shape, tmp_path / "native").frame()
    assert (native["unintended_first_ms"] >= 0).tolist() == [False, True]


def test_a_folders_runs_are_listed_and_one_of_them_opens_with_its_verdict(window, place):
    filled(window)
    assert "12 runs" in window.inner_text("#table-lead")
    window.locator("#table-rows button").first.click()
    window.wait_for_selector("#run:not([hidden])")
    row = int(window.locator("#table-rows th").first.inner_text().split()[0])
    folder = place.parent / "results"
    native = Results(manifest.read_manifest(folder).shape, folder).frame().iloc[row]
    assert window.evaluate("document.body.dataset.verdict") == native["verdict"]


def test_a_page_that_cannot_compute_says_so(browser, place):
    shown = browser.new_page()
    shown.add_init_script("delete globalThis.Worker")
    shown.goto(place.as_uri())
    shown.wait_for_function("document.body.dataset.failed === '1'")
    answer = shown.inner_text("#answer")
    assert answer.startswith("This page cannot continue: Worker is not defined")
    shown.close()


def test_another_threshold_of_the_cue_has_another_answer_and_says_where_the_cue_comes_anyway(
    window, tmp_path
):
    filled(window)
    evading = window.inner_text("#answer strong")
    assert "the surgeon feels a cue in" in window.inner_text("#answer")
    felt = _felt(window)
    window.locator("#situation > summary").click()
    _cue_at(window, "6")
    assert window.inner_text("#answer strong") == evading
    assert _felt(window) < felt
    _cue_at(window, "0.5")
    said = window.inner_text("#answer")
    window.locator("#field").press("Enter")
    window.wait_for_selector("#run:not([hidden])")
    raw = tomllib.loads(_copied(window, "toml"))
    assert raw["haptics"]["threshold_mm"] == [0.5, 2]
    adaptive.run_adaptively(validate_tables(raw), tmp_path / "native", "simd")
    native = (
        Results(manifest.read_manifest(tmp_path / "native").shape, tmp_path / "native")
        .frame()
        .iloc[0]
    )
    assert native["golden_cue0_first_ms"] > 0
    assert f"the cue comes without a fault, too, at {native['golden_cue0_first_ms']} ms" in said
    assert _felt(window) == 0


def test_another_motion_of_the_hands_has_another_answer_that_is_the_native_one(window, tmp_path):
    filled(window)
    answer = window.inner_text("#answer")
    window.locator("#situation > summary").click()
    window.select_option("#motion", "circle")
    filled(window)
    assert window.inner_text("#answer") != answer
    window.locator("#field").press("Enter")
    window.wait_for_selector("#run:not([hidden])")
    assert "motion=circle" in _when(window, "location.hash.includes('ms=') && location.hash")
    raw = tomllib.loads(_copied(window, "toml"))
    assert raw["operator"] == {"motion": "circle", "seed": 1}
    adaptive.run_adaptively(validate_tables(raw), tmp_path / "native", "simd")
    native = (
        Results(manifest.read_manifest(tmp_path / "native").shape, tmp_path / "native")
        .frame()
        .iloc[0]
    )
    assert window.evaluate("document.body.dataset.verdict") == native["verdict"]
    shown = window.evaluate(CELLS)
    assert float(shown["unintended_mm"]) == pytest.approx(
        native["unintended_mm"], rel=1e-3, abs=1e-3
    )


def _cue_at(window, threshold_mm):
    number = window.locator("[id='p-haptics.cues.0.threshold_m-number']")
    number.fill(threshold_mm)
    number.press("Tab")
    filled(window)


def _felt(window):
    return int(window.locator("#legend [data-class=felt] b").text_content())


def _when(window, expression):
    return window.wait_for_function(expression).json_value()


def _copied(window, name):
    window.click(f"[data-copy={name}]")
    return _when(window, "window.copied")
