"""`credibility`: what each claim of the studies rests on, from their findings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console


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
    from ravenjax.errors import UserError
    from ravenjax.store import files
    from ravenjax.studies import catalogue
    from ravenjax.studies.framework import credibility as page
    from ravenjax.studies.framework import writing

    records = writing.records(folder, catalogue.NAMES)
    if not records:
        raise UserError(
            f"{folder}: no findings of a study there; run `ravenjax reproduce NAME --out {folder}`"
            " first"
        )
    text = page.page(records, out.parent.as_posix() if out else "")
    if out is None:
        print(text, end="")
        return
    files.write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)
