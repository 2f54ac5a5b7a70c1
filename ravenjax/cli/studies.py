"""Commands on the studies of a checkout, in `analysis/studies`.

`reproduce` runs them; `credibility` prints the evidence for each of their claims.
"""

from __future__ import annotations

from pathlib import Path

from ravenjax.cli.console import AsJson, Engine, load_module


def reproduce(
    name: str | None = None,
    *,
    out: Path = Path("results/reproduce"),
    engine: Engine = "auto",
    keep: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Repeat a published experiment, or run a study, and compare prediction and publication.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    out
        folder for the results; each study gets its own folder in it
    keep
        also copy the findings, without pictures, into this folder
    """
    load_module("studies.commands").reproduce(name, out, engine, keep, as_json)


def credibility(
    folder: Path = Path("results/reproduce"),
    *,
    out: Path | None = None,
) -> None:
    """Print the evidence for each claim of the studies, in the order of FDA's guidance of 2023.

    Parameters
    ----------
    folder
        Findings of `ravenjax reproduce`: its folder --out, or --keep.
    out
        write it to this file; default: print it
    """
    load_module("studies.commands").credibility(folder, out)
