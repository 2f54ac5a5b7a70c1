"""Self-contained pages: templates, style and plotly in one file that asks nothing of a network."""

from __future__ import annotations

import functools
import json
from typing import Any

from ravenjax.trainer.debrief import words


def page(template: str, **told: Any) -> str:
    """A page of `templates/`, with plotly inside."""
    import markupsafe
    import plotly.offline

    plotly_js = markupsafe.Markup(plotly.offline.get_plotlyjs())
    return _environment().get_template(template).render(plotly_js=plotly_js, **told)


@functools.cache
def _environment() -> Any:
    import jinja2
    import markupsafe

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ravenjax.trainer"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "title": words.title,
        "milliseconds": words.milliseconds,
        "moment": words.moment,
        "length": words.length,
        "depth": words.depth,
        "in_script": lambda text: markupsafe.Markup(text.replace("<", "\\u003c")),
        "as_json": json.dumps,
    }
    return environment
