"""Commands that compute: `run`, `search`, `reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import Overrides
from ravenjax.cli.results import write_report


def run(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="result folder; default results/NAME of the campaign")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
    chunk: Annotated[int | None, Parameter(help="runs per part of the result")] = None,
    limit: Annotated[int | None, Parameter(help="compute only the first runs")] = None,
    report: Annotated[bool, Parameter(help="write report.html at the end")] = True,
) -> None:
    """Run a campaign, or finish it where OUT holds a part of it.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.campaign import loading

    sizes = {"chunk": chunk, "limit": limit}
    given = [*(overrides or ()), *(f"campaign.{key}={value}" for key, value in sizes.items() if value is not None)]
    config = loading.load(file, given)
    folder = out or Path("results") / config.campaign.name

    from ravenjax.campaign import runner

    with terminal.Watch(console.out) as watch:
        results = runner.run_campaign(config, folder, engine, on_progress=watch)
    rows = terminal.outcome_rows(results.verdicts())
    if rows:
        console.out.print(
            terminal.table("Faulty runs", ("response / haptic / jump", "runs", "share, 95 % interval"), rows)
        )
    console.out.print(f"results: {folder}", highlight=False, soft_wrap=True)
    if report:
        write_report(folder)


def search(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="folder; default results/NAME of the search")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
) -> None:
    """Find what matters: the smallest harmful fault, the parameters that decide, how rare an outcome is.

    Parameters
    ----------
    file
        Search file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.search import runner

    with terminal.Watch(console.out) as watch:
        found = runner.run(file, out, engine, overrides or (), watch)
    for sentence in found.findings.sentences:
        console.out.print(f"- {sentence}", markup=False, highlight=False)
    console.out.print(f"search: {found.out}", highlight=False, soft_wrap=True)


def reproduce(
    name: str | None = None,
    *,
    out: Annotated[Path, Parameter(help="folder; each study has one inside")] = Path("results/reproduce"),
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    keep: Annotated[Path | None, Parameter(help="also copy the findings, without pictures, into this folder")] = None,
) -> None:
    """Run a published experiment, or a study of our own, and set what is predicted beside what was published.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    """
    from ravenjax import terminal
    from ravenjax.studies import catalogue, markdown, running, writing

    if name is None:
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}")
            for one in map(catalogue.find, catalogue.NAMES)
        ]
        console.out.print(
            terminal.table("Studies: ravenjax reproduce NAME", ("name", "what", "targets", "minutes"), rows)
        )
        return
    for study in catalogue.NAMES if name == "all" else (catalogue.find(name).name,):
        with terminal.Watch(console.out) as watch:
            findings = running.reproduce(study, out, engine, watch)
        if findings.lines:
            title = catalogue.find(study).title
            console.out.print(terminal.table(title, markdown.BRIEF_COLUMNS, markdown.line_rows(findings)))
        console.out.print(f"findings: {out / study / writing.PAGE}", highlight=False, soft_wrap=True)
        if keep is not None:
            writing.keep(out / study, keep / study)
