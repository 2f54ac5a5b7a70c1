"""Adds the scope of each heading to the tables of a page, for screen readers, and writes Markdown
tables.
"""

import re
from collections.abc import Iterable, Sequence

_TAG = re.compile(r"<(/?)(thead|tbody|tfoot|table|th)\b([^<>]*)>")
_WIDE = re.compile(r"""\b(colspan|rowspan)=["']?(\d+)""")


def with_scopes(html: str) -> str:
    """Return HTML with `scope` in every <th> that has none: a column in thead and tfoot, else a
    row; a group if the heading spans several.
    """
    part = ""

    def heading(tag_match: re.Match[str]) -> str:
        nonlocal part
        closing, tag, attributes = tag_match.groups()
        if tag != "th":
            part = "" if closing else tag
            return tag_match[0]
        if closing or "scope=" in attributes:
            return tag_match[0]
        kind = "col" if part in ("thead", "tfoot") else "row"
        spans = {name: int(number) for name, number in _WIDE.findall(attributes)}
        group = "group" if spans.get("colspan" if kind == "col" else "rowspan", 1) > 1 else ""
        return f'<th scope="{kind}{group}"{attributes}>'

    return _TAG.sub(heading, html)


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    cells = [columns, tuple("---" for _ in columns), *rows]
    return "\n".join(
        "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in row) + " |"
        for row in cells
    )
