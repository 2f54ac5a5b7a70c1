"""Tables of a page in a real browser: they fold, search and sort, by themselves, and print what
is shown.
"""

import pytest
from chromium import CHROMIUM, NEEDED

from ravenjax.document import html

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = NEEDED

NUMBERS = ["12", "−3.5 mm", "1,200", "–", *(f"{n}.5 (1 to 9)" for n in range(20, 36))]
LONG = "# Long\n\n## Numbers\n\n| name | number | a | b | c |\n|---|---|---|---|---|\n" + "".join(
    f"| row {n} | {text} | 1 | 2 | 3 |\n" for n, text in enumerate(NUMBERS)
)
PARTS = (
    "<table><thead><tr><th>detector, level</th><th>caught</th></tr></thead><tbody>"
    + "".join(
        f'<tr class="{"first" if level == 0 else ""}"><th>{f"detector {d} " if level == 0 else ""}level'  # noqa: E501
        f" {level}</th><td>{d * level}</td></tr>"
        for d in range(6)
        for level in range(4)
    )
    + "</tbody></table>"
)


@pytest.fixture(scope="module")
def page():
    text = html.from_markdown(LONG).replace("</section>", f"</section><section>{PARTS}</section>")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        opened = launched.new_page(viewport={"width": 1280, "height": 900})
        opened.set_content(text)
        yield opened
        launched.close()


def names(page, table, visible=True):
    kept = ".filter((row) => row.getBoundingClientRect().height > 0)" if visible else ""
    rows = f"[...document.querySelectorAll('table')[{table}].tBodies[0].rows]"
    return page.evaluate(f"{rows}{kept}.map((row) => row.cells[0].innerText)")


def test_a_long_table_shows_its_first_rows_and_all_when_asked(page):
    tools = page.locator(".tools").first
    assert names(page, 0) == [f"row {n}" for n in range(10)]
    assert tools.locator(".said").inner_text() == f"first 10 of {len(NUMBERS)} rows"
    tools.locator("button").click()
    assert len(names(page, 0)) == len(NUMBERS) and tools.locator("button").inner_text() == "fold"
    tools.locator("button").click()
    assert len(names(page, 0)) == 10


def test_searching_looks_at_every_row(page):
    tools = page.locator(".tools").first
    tools.locator("input").fill("ROW 1")
    assert names(page, 0) == ["row 1", *(f"row {n}" for n in range(10, 20))]
    assert tools.locator(".said").inner_text() == f"11 of {len(NUMBERS)} rows match"
    tools.locator("input").fill("")
    assert len(names(page, 0)) == 10


def test_numbers_sort_as_numbers_and_what_is_none_comes_last(page):
    button = page.locator("th button.sort").nth(1)
    button.click()
    order = names(page, 0, visible=False)
    assert (
        order[0] == "row 2" and order[-1] == "row 3" and order[-2] == "row 1"
    )  # 1,200 first; −3.5; a dash
    button.click()
    order = names(page, 0, visible=False)
    assert order[0] == "row 1" and order[-1] == "row 3"
    assert page.locator("th").nth(1).get_attribute("aria-sort") == "ascending"
    button.click()
    assert names(page, 0, visible=False) == [f"row {n}" for n in range(len(NUMBERS))]
    assert page.locator("th").nth(1).get_attribute("aria-sort") is None


@pytest.mark.slow
def test_paper_shows_what_the_screen_shows(page):
    page.emulate_media(media="print")
    assert names(page, 0) == [f"row {n}" for n in range(10)]
    assert (
        page.locator(".said").first.is_visible()
        and not page.locator(".tools input").first.is_visible()
    )
    assert page.locator("th").nth(1).inner_text() == "number"
    page.emulate_media(media="screen")
