"""Loads modules that only a checkout of the repository has: studies, benchmark and evidence in
`analysis`.

The installed package does not contain them. They are loaded by path when a command needs them.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import ravenjax
from ravenjax.errors import UserError


def root() -> Path:
    """Return the folder that contains the package's folder; in a checkout, the repository."""
    return Path(ravenjax.__file__).resolve().parents[1]


def load_module(name: str) -> Any:
    """Return module `name` of the folder `analysis`, such as "studies.claims". Raises UserError
    outside of a checkout.
    """
    analysis = root() / "analysis"
    folder = analysis / name.partition(".")[0]
    if not (folder / "__init__.py").is_file():
        raise UserError(
            f"this command needs a checkout of the repository, and this is no checkout: {folder} is"
            " missing; clone the repository and install it with `pip install -e .`"
        )
    if str(analysis) not in sys.path:
        sys.path.insert(0, str(analysis))
    return importlib.import_module(name)
