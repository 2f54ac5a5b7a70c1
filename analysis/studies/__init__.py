"""Implements the studies of `ravenjax reproduce`: published experiments repeated, and further
questions answered by campaigns.
"""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from ravenjax.errors import UserError, suggest_name

if TYPE_CHECKING:
    from studies.study import Study

_ABOUT = tomllib.loads((Path(__file__).parent / "studies.toml").read_text(encoding="utf-8"))
NAMES = tuple(_ABOUT)
"""The studies in the order in which they are listed."""


def find(name: str) -> Study:
    """Return the study with a name: STUDY of its module. Raises UserError."""
    if name not in NAMES:
        raise UserError(
            f"unknown study {name!r}, expected one of {', '.join(NAMES)}{suggest_name(name, NAMES)}"
        )
    return importlib.import_module(f"studies.{_ABOUT[name].get('module', name)}").STUDY
