"""Collects the sections of the report.

Modules of this package compute the numbers and figures of sections (SECTIONS: name to content).
Each section also has a template. sections.toml contains the titles in the order of the page.
"""

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax import resources
from ravenjax.report.data.runs import Runs

Content = Callable[[Runs, Path], dict[str, Any] | None]
"""Returns the variables of a section's template from runs and folder; None: no such section."""


class Section(NamedTuple):
    """One section of the page."""

    name: str  # id of the section, and name of its template
    title: str  # in the list of links
    content: Content


def all_sections() -> list[Section]:
    """Return every section in the order of the page."""
    contents: dict[str, Content] = {}
    for module in pkgutil.iter_modules(__path__):
        section_module = importlib.import_module(f"{__name__}.{module.name}")
        contents |= getattr(section_module, "SECTIONS", {})
    titles = resources.read_tables(__file__, "sections.toml")
    return [Section(name, title, contents[name]) for name, title in titles.items()]
