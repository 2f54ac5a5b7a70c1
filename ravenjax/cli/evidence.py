"""The command `evidence`: writes tables and an argument for a risk file, and checks whether they
still hold.
"""

from __future__ import annotations

from pathlib import Path

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Switch


def evidence(
    *folders: Path,
    out: Path | None = None,
    check: Path | None = None,
    xlsx: Switch = False,
    credibility: Path | None = None,
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
    out
        folder to write into; default FOLDER/evidence of a single one
    check
        compute the checksums of evidence in this folder again, and write nothing new
    xlsx
        the tables as one workbook, too (extra: xlsx)
    credibility
        findings of `ravenjax reproduce`: report what the simulator's credibility rests on, too
    """
    commands = console.load_module("evidence.commands")
    return commands.evidence(folders, out, check, xlsx, credibility, as_json)
