"""The page of definitions says what the package says."""

from pathlib import Path

from ravenjax import robots
from ravenjax.outcomes import definitions, events
from ravenjax.outcomes.events import Rules

DOCS = Path(__file__).resolve().parents[2] / "docs"


def table() -> str:
    """The table of definitions as the page has it."""
    return "\n".join(
        f"| **{one.word}** ({one.kind}) | {one.meaning} |"
        for one in definitions.definition_rows(Rules(), robots.USUAL)
    )


def test_the_page_holds_every_definition_and_event():
    page = (DOCS / "outcomes.md").read_text(encoding="utf-8")
    assert table() in page, f"write this table into docs/outcomes.md:\n{table()}"
    assert ", ".join(f"`{name}`" for name in events.EVENTS) in page
