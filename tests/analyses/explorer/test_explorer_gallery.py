"""A gallery in a real browser, from a file: its index opens, and each link computes a map."""

import pytest
from chromium import CHROMIUM, NEEDED, PATIENCE_MS

from ravenjax.analyses.explorer import gallery
from ravenjax.errors import UserError

FILE = """
[campaign]
name = "{name}"
description = "Faults of {name} & others"
duration_s = 0.5
arms = ["gold"]
[operator]
motion = "reach"

[[group]]
name = "motor"
[[group.fault]]
site = "usb_out"
channel = "{name}"
effect = "overwrite"
value = [-20000, 20000]
start_ms = 250
duration_ms = 64
"""


def written(folder, name):
    path = folder / f"{name}.toml"
    path.write_text(FILE.format(name=name))
    return path


def test_two_campaigns_of_one_name_are_refused(tmp_path):
    path = written(tmp_path, "elbow")
    with pytest.raises(UserError, match="more than one campaign has the name elbow"):
        gallery.build_gallery(tmp_path / "pages", [path, path])
    assert not (tmp_path / "pages").exists()


def test_a_campaign_without_a_fault_has_no_page_and_says_so(tmp_path):
    with pytest.raises(UserError, match="'healthy_robot' has no fault"):
        gallery.build_gallery(tmp_path, ["healthy_robot"])


@pytest.mark.slow
@NEEDED
def test_the_index_opens_from_a_file_and_each_link_computes(tmp_path):
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
    )
    names = ["elbow", "shoulder"]
    cards = gallery.build_gallery(
        tmp_path, [*(written(tmp_path, name) for name in names), "drawn_robots"]
    )
    assert [card.file for card in cards] == ["elbow.html", "shoulder.html", ""]
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        window = browser.new_page(viewport={"width": 360, "height": 800})
        window.set_default_timeout(PATIENCE_MS)
        asked, told = [], []
        window.on("request", lambda request: asked.append(request.url))
        window.on("pageerror", lambda error: told.append(str(error)))
        index = (tmp_path / gallery.INDEX).as_uri()
        window.goto(index)
        assert window.evaluate("document.documentElement.scrollWidth") <= 360
        assert window.locator(".gallery h2").all_inner_texts() == names
        assert window.locator(".gallery a p").nth(1).inner_text() == "Faults of elbow & others"
        assert cards[2].reason in window.inner_text(".without")
        for name in names:
            window.goto(index)
            window.click(f".gallery a:has-text('{name}')")
            window.wait_for_function("document.body.dataset.filled === '1'")
            assert window.title().startswith(name)
        assert told == []
        assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
        browser.close()
