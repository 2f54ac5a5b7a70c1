"""`reference`: the reference of campaign files, and the generated pages of the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console


def reference(
    *,
    out: Annotated[
        Path | None, Parameter(help="also write it to this file; default: print it")
    ] = None,
    pages: Annotated[
        Path | None,
        Parameter(
            help="write every page of the documentation's reference into this folder instead"
        ),
    ] = None,
) -> None:
    """Print the reference of campaign files: every key with its type, unit, range, default and
    meaning (Markdown).
    """
    from ravenjax.store import files

    if pages is not None:
        from ravenjax.cli import docs_pages

        pages.mkdir(parents=True, exist_ok=True)
        for name, text in docs_pages.pages().items():
            files.write_aside(
                pages / name, lambda target, text=text: target.write_text(text, encoding="utf-8")
            )
            console.out.print(f"wrote {pages / name}", highlight=False, soft_wrap=True)
        return
    from ravenjax.campaign.inspection import reference as text
    from ravenjax.robots.raven2 import ROBOT

    if out is None:
        print(text.page(ROBOT), end="")
        return
    files.write_aside(out, lambda target: target.write_text(text.page(ROBOT), encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)
