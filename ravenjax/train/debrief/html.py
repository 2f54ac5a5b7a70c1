"""Self-contained pages: templates, style and plotly in one file that asks nothing of a network."""

from __future__ import annotations

import functools
import json
from typing import Any

from ravenjax.train.debrief import words


def page(template: str, **told: Any) -> str:
    """A page of `templates/`, with plotly inside."""
    import markupsafe
    import plotly.offline

    plotly_js = markupsafe.Markup(plotly.offline.get_plotlyjs())
    return _environment().get_template(template).render(plotly_js=plotly_js, **told)


@functools.cache
def _environment() -> Any:
    from ravenjax.document import html

    environment = html.environment("ravenjax.train")
    environment.filters |= {
        "title": words.title,
        "milliseconds": words.milliseconds,
        "moment": words.moment,
        "length": words.length,
        "depth": words.depth,
        "as_json": json.dumps,
    }
    return environment
