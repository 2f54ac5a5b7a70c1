"""Commands on the studies of a checkout, `analysis/studies`: `reproduce` runs them, `credibility`
tells what each of their claims rests on.

The package comes without them; they are loaded by path when a command asks for them.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import ravenjax
from ravenjax.errors import UserError


def load(name: str = "") -> Any:
    """Module `name` of `analysis/studies`, or the whole. Raises UserError outside of a checkout."""
    folder = Path(ravenjax.__file__).resolve().parents[1] / "analysis"
    if not (folder / "studies" / "__init__.py").is_file():
        raise UserError(
            "the studies are no part of the installed package, and this is no checkout:"
            f" {folder / 'studies'} is missing; clone the repository and install it with"
            " `pip install -e .`"
        )
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    return importlib.import_module(f"studies.{name}" if name else "studies")


def reproduce(
    name: str | None = None,
    *,
    out: Annotated[Path, Parameter(help="folder; each study has one inside")] = Path(
        "results/reproduce"
    ),
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    keep: Annotated[
        Path | None, Parameter(help="also copy the findings, without pictures, into this folder")
    ] = None,
    as_json: Annotated[
        bool,
        Parameter(
            name="--json", negative="", help="list the studies as JSON; of a study, its findings"
        ),
    ] = False,
) -> None:
    """Run a published experiment, or a study of our own, and set what is predicted beside what was
    published.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    """
    load("commands").reproduce(name, out, engine, keep, as_json)


def credibility(
    folder: Path = Path("results/reproduce"),
    *,
    out: Annotated[Path | None, Parameter(help="write it to this file; default: print it")] = None,
) -> None:
    """Tell for each claim of the studies what it rests on, in the order of FDA's guidance of 2023
    (Markdown).

    Parameters
    ----------
    folder
        Findings of `ravenjax reproduce`: its folder --out, or --keep.
    """
    load("commands").credibility(folder, out)
