"""The command `explore`: writes a campaign as one page that simulates its robot in a browser."""

import dataclasses
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson
from ravenjax.errors import UserError


def explore(
    *sources: str,
    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None,
    gallery: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Write a page that simulates faults of a campaign in any browser.

    The page contains the robot, its control software and its checks as WebAssembly. It is one
    file and needs no network. For a result folder it also shows that folder's runs.

    Parameters
    ----------
    sources
        Campaign file, the name of a bundled one (see `ravenjax campaigns`), or what `ravenjax
        run` wrote.
    out
        the page; default NAME.explore.html, or DIR/explore.html
    gallery
        a folder: pages of several campaigns, of all bundled ones unless named, and an index
    """
    if gallery is not None:
        _gallery(gallery, sources, out, as_json)
        return
    if len(sources) != 1:
        raise UserError(
            f"got {len(sources)} campaigns, expected one; write --gallery DIR for pages of several"
        )
    from ravenjax.analyses.explorer import page

    path = page.build_page(sources[0], out)
    if as_json:
        console.emit_json({"page": path, "bytes": path.stat().st_size})
        return
    console.print_text(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")


def _gallery(folder: Path, sources: tuple[str, ...], out: Path | None, as_json: bool) -> None:
    if out is not None:
        raise UserError(
            "got --out and --gallery; leave out --out: a gallery's pages are named after their"
            " campaigns"
        )
    from ravenjax.analyses.explorer import gallery

    cards = gallery.build_gallery(folder, sources)
    if as_json:
        console.emit_json(
            {
                "index": folder / gallery.INDEX,
                "campaigns": [dataclasses.asdict(card) for card in cards],
            }
        )
        return
    for card in cards:
        console.print_text(f"{card.campaign}: {card.file or 'no page, ' + card.reason}")
    console.print_text(str(folder / gallery.INDEX))
