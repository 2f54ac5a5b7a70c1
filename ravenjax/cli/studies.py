"""Commands on the studies of a checkout, `analysis/studies`: `reproduce` runs them, `credibility`
tells what each of their claims rests on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli.checkout import load_module


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
    """Repeat a published experiment, or run a study, and compare prediction and publication.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    """
    load_module("studies.commands").reproduce(name, out, engine, keep, as_json)


def credibility(
    folder: Path = Path("results/reproduce"),
    *,
    out: Annotated[Path | None, Parameter(help="write it to this file; default: print it")] = None,
) -> None:
    """Print the evidence for each claim of the studies, in the order of FDA's guidance of 2023.

    Parameters
    ----------
    folder
        Findings of `ravenjax reproduce`: its folder --out, or --keep.
    """
    load_module("studies.commands").credibility(folder, out)
