"""Commands whose code is in the folder `analysis` of a checkout.

`reproduce` runs studies, `credibility` prints the evidence for each of their claims, and `evidence`
writes tables and an argument for a risk file.
"""

from pathlib import Path

from ravenjax.cli.console import AsJson, Engine, Switch, load_module


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
    commands = load_module("evidence.commands")
    return commands.evidence(folders, out, check, xlsx, credibility, as_json)
