"""A page from Markdown: one file, headings and tables named, drawings inside."""

import re

from ravenjax.document import html

MARKDOWN = """# A <study>

Question?

## Published and predicted

| what | number |
|---|---|
| jumps \\| all | 3 |

## Published and predicted

![A caption & more](one.svg)

![Not there](two.svg)

<script>alert(1)</script>
"""
DRAWING = (
    '<?xml version="1.0"?>\n<!DOCTYPE svg>\n<svg width="10pt" viewBox="0 0 1'
    ' 1"><metadata>x</metadata>'
    + '<defs><path id="a"/></defs><use xlink:href="#a"/><g clip-path="url(#a)"/></svg>'
)


def test_one_page():
    page = html.from_markdown(MARKDOWN, {"one.svg": DRAWING})
    assert "<title>A &lt;study&gt;</title>" in page and page.count("<h1>") == 1
    ids = re.findall(r'<h2 id="([^"]+)">', page)
    assert len(ids) == len(set(ids)) == 2 and all(f'href="#{name}"' in page for name in ids)
    assert ">Published and predicted</caption>" in page and '<th scope="col">what</th>' in page
    assert '<th scope="row">jumps | all</th>\n<td>3</td>' in page
    assert "<script>alert" not in page
    assert not re.search(r'(src|href)="(?!#|data:)', page) and "@import" not in page
    # Drawings are inside the page and keep their own ids.
    assert 'aria-label="A caption &amp; more"' in page
    assert "<!DOCTYPE svg>" not in page and "<metadata>" not in page
    assert 'id="one-a"' in page and 'xlink:href="#one-a"' in page and "url(#one-a)" in page
    assert "<p>Not there</p>" in page and "two.svg" not in page
