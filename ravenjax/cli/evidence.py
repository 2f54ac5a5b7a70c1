"""`evidence`: tables and an argument for a risk file, and whether they still hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import checkout
from ravenjax.cli.console import AsJson


def evidence(
    *folders: Path,
    out: Annotated[
        Path | None, Parameter(help="folder to write into; default FOLDER/evidence of a single one")
    ] = None,
    check: Annotated[
        Path | None,
        Parameter(
            help="compute the checksums of evidence in this folder again, and write nothing new"
        ),
    ] = None,
    xlsx: Annotated[
        bool, Parameter(negative="", help="the tables as one workbook, too (extra: xlsx)")
    ] = False,
    credibility: Annotated[
        Path | None,
        Parameter(
            help=(
                "findings of `ravenjax reproduce`: report what the simulator's credibility rests"
                " on, too"
            )
        ),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Write evidence for a risk file: failure modes, hazards, unsafe control actions, an argument.

    Every number leads to runs, and every file has a checksum. It claims no conformity with any
    standard. With --check the exit code is 1 if something no longer holds; the argument shows
    it in red.

    Parameters
    ----------
    folders
        What `ravenjax run` wrote, one folder or several.
    """
    commands = checkout.load_module("evidence.commands")
    return commands.evidence(folders, out, check, xlsx, credibility, as_json)
