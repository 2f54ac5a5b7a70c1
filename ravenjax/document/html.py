"""Makes HTML pages that work without a network, from templates and from Markdown.

The module provides the style sheet, the script and the template filters of all pages.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources

import jinja2
from markupsafe import Markup, escape

from ravenjax.document import palette
from ravenjax.document.chart import Chart

_NAME = "<!--drawing-->"
_TAG = re.compile(r"<(/?)(thead|tbody|tfoot|table|th)\b([^<>]*)>")
_WIDE = re.compile(r"""\b(colspan|rowspan)=["']?(\d+)""")
_TEMPLATES = resources.files("ravenjax.document") / "templates"


def template_environment(*packages: str) -> jinja2.Environment:
    """Return a Jinja environment for these packages' templates, with style and script of pages."""
    loaders = [jinja2.PackageLoader(name) for name in (*packages, "ravenjax.document")]
    templates = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style, script = (
        Markup((_TEMPLATES / f"document.{kind}").read_text(encoding="utf-8"))
        for kind in ("css", "js")
    )
    style = Markup(palette.palette_css()) + style
    templates.globals |= {"document_style": style, "document_script": script}
    templates.tests |= {"nan": math.isnan, "finite": math.isfinite}
    templates.filters |= {
        "drawings": _drawings,
        "values": lambda chart: escape_json(chart.values()),
        "data": escape_json,
    }
    return templates


def _drawings(chart: Chart, described_by: str, *kinds: str) -> Markup:
    # Imported here because the import is slow and most pages have no chart.
    from ravenjax.document.drawing import page_drawings

    return page_drawings(chart, described_by, kinds)


def escape_json(json: str) -> Markup:
    """Escape JSON text for a <script>, so that nothing in it ends the element."""
    return Markup(json.replace("<", "\\u003c"))


def from_markdown(text: str, drawings: Mapping[str, str] | None = None) -> str:
    """Convert Markdown (CommonMark with tables) to an HTML page. The first heading is its title.

    `drawings`: SVG text by the file name of an image, to embed in the page. Other images are
    replaced by their description. The caption of a table is the heading before it. Headings get
    anchors and a list of links.
    """
    from markdown_it import MarkdownIt

    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    for name, drawing in (drawings or {}).items():
        # The placeholder _NAME keeps backslashes of the SVG out of the replacement text.
        body = re.sub(
            rf'<p><img src="{re.escape(name)}" alt="([^"]*)" ?/?></p>',
            rf'<figure class="drawing" role="img" aria-label="\1">{_NAME}</figure>',
            body,
        ).replace(_NAME, inline_svg(drawing, name))
    body = re.sub(r'<img src="[^"]*" alt="([^"]*)" ?/?>', r"\1", body)
    # The first cell of a row is its heading.
    body = re.sub(r"(<tr>\s*)<td([^>]*)>(.*?)</td>", r"\1<th\2>\3</th>", body, flags=re.DOTALL)
    title, body, sections = _with_headings(body)
    page = template_environment().get_template("markdown.html.j2")
    return with_scopes(page.render(title=title, body=Markup(body), sections=sections))


def inline_svg(text: str, name: str) -> str:
    """Return the text of an SVG file as an element of a page, with unique ids."""
    from ravenjax.document.drawing import with_own_ids

    body = text[text.index("<svg") :].strip()
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = with_own_ids(body, re.sub(r"\W", "-", name.removesuffix(".svg")))
    return body.replace("<svg ", '<svg aria-hidden="true" ', 1)


def _with_headings(body: str):
    """Return the title, the body without it, and (id, heading) of each section. Tables get captions
    and a scrollable container.
    """
    heading = re.search(r"<h1>(.*?)</h1>\n?", body, re.DOTALL)
    title = heading[1] if heading else ""
    body = body[: heading.start()] + body[heading.end() :] if heading else body
    sections = []
    section = _plain(title)
    out = []
    # Headings and table tags are parts, too, because the pattern is a group.
    for part in re.split(r"(<h2>.*?</h2>|<table>)", body, flags=re.DOTALL):
        if part.startswith("<h2>"):
            section = _plain(part)
            name = re.sub(r"\W+", "-", section.lower()).strip("-") or "section"
            if name in dict(sections):
                name = f"{name}-{len(sections)}"
            sections.append((name, section))
            part = part.replace("<h2>", f'<h2 id="{name}">', 1)
        elif part == "<table>":
            part = (
                '<div class="scroll"><table class="wordy"><caption'
                f' class="unseen-by-eye">{escape(section)}</caption>'
            )
        out.append(part)
    return _plain(title), "".join(out).replace("</table>", "</table></div>"), sections


def _plain(html: str) -> str:
    return str(Markup(html).striptags())


def with_scopes(html: str) -> str:
    """Return HTML with `scope` in every <th>: column, row, or a group if it spans several."""
    table_part = ""

    def heading(tag_match: re.Match[str]):
        # Adds `scope`, by which screen readers find the head of a cell.
        nonlocal table_part
        closing, tag, attributes = tag_match.groups()
        if tag != "th":
            table_part = "" if closing else tag
            return tag_match[0]
        if closing or "scope=" in attributes:
            return tag_match[0]
        kind = "col" if table_part in ("thead", "tfoot") else "row"
        spans = {name: int(number) for name, number in _WIDE.findall(attributes)}
        group = "group" if spans.get("colspan" if kind == "col" else "rowspan", 1) > 1 else ""
        return f'<th scope="{kind}{group}"{attributes}>'

    return _TAG.sub(heading, html)


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = []
    for row in (columns, tuple("---" for _ in columns), *rows):
        # A cell may not contain a line break, and a "|" in it is escaped.
        cells = [" ".join(cell.split()).replace("|", "\\|") for cell in row]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
