"""`explore`: a campaign as one page on which anybody asks its robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson


def explore(
    source: str,
    *,
    out: Annotated[
        Path | None, Parameter(name=("--out", "-o"), help="the page; default NAME.explore.html, or DIR/explore.html")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a page that computes a campaign's faults in any browser: a map, runs in 3D, the smallest harmful fault.

    The page holds the robot, its control software and its checks as WebAssembly, opens from a file and asks no network.
    Given a result folder it shows that folder's runs, too.

    Parameters
    ----------
    source
        Campaign file, the name of a bundled one (see `ravenjax campaigns`), or what `ravenjax run` wrote.
    """
    from ravenjax.explorer import page

    path = page.build(source, out)
    if as_json:
        console.emit_json({"page": path, "bytes": path.stat().st_size})
        return
    console.say(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
