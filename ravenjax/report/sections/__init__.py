"""Collects the sections of the report.

Each section is a module of this package and a template with the same name. The module computes the
numbers and figures, and lists its sections in SECTIONS. A section needs no other registration.
"""

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data.runs import Runs


class Section(NamedTuple):
    """One section of the page."""

    name: str  # id of the section, and name of its template
    title: str  # in the list of links
    place: int  # sections are sorted by this number
    # Returns the template's variables, from the runs and the result folder; None: no section.
    content: Callable[[Runs, Path], dict[str, Any] | None]


def all_sections() -> list[Section]:
    """Return every section in the order of the page."""
    modules = [
        importlib.import_module(f"{__name__}.{module.name}")
        for module in pkgutil.iter_modules(__path__)
    ]
    sections = [section for module in modules for section in getattr(module, "SECTIONS", ())]
    return sorted(sections, key=lambda section: section.place)
