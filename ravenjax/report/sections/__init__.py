"""Sections of the report. Each is a module here with its query and figures, and a template of its
name beside it.

A module that has sections lists them as SECTIONS; nothing else needs to know of them.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data.runs import Runs


class Section(NamedTuple):
    """One section of the page."""

    name: str  # its id, and its template's name
    title: str  # in the list of links
    place: int  # sections are in this order
    # what its template reads, of the runs and of the result's folder; None: it has nothing to say
    content: Callable[[Runs, Path], dict[str, Any] | None]


def all_sections() -> list[Section]:
    """Every section in the order of the page."""
    modules = [
        importlib.import_module(f"{__name__}.{module.name}")
        for module in pkgutil.iter_modules(__path__)
    ]
    found = [one for module in modules for one in getattr(module, "SECTIONS", ())]
    return sorted(found, key=lambda one: one.place)
