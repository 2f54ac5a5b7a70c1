"""Commands that compute: `run`, `search`, `reproduce`."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import Overrides
from ravenjax.cli.results import write_report

if TYPE_CHECKING:
    from ravenjax.store.results import Results


def run(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="result folder; default results/NAME of the campaign")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
    chunk: Annotated[int | None, Parameter(help="runs per part of the result")] = None,
    limit: Annotated[int | None, Parameter(help="compute only the first runs")] = None,
    executor: Annotated[
        str | None, Parameter(help="local (this process), processes (of this machine) or ray (a cluster)")
    ] = None,
    workers: Annotated[
        int | None, Parameter(help="processes or tasks side by side; default one a GPU, or one for some cores")
    ] = None,
    ray_address: Annotated[str | None, Parameter(help="of a running Ray cluster; default one on this machine")] = None,
    shard: Annotated[str | None, Parameter(help="i/N: only the i-th of N shares, for batch schedulers")] = None,
    report: Annotated[bool, Parameter(help="write report.html at the end")] = True,
) -> None:
    """Run a campaign, or finish it where OUT holds a part of it.

    Exit codes: 0 done, 2 something to mend (the campaign file, a full disk, workers that die), 128 + n ended by signal
    n: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP. Whatever ends it, finished parts are kept and the same command goes on.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.campaign import loading
    from ravenjax.campaign.executors import choice, shards

    sizes = {"chunk": chunk, "limit": limit}
    given = [*(overrides or ()), *(f"campaign.{key}={value}" for key, value in sizes.items() if value is not None)]
    share = shards.parse(shard) if shard is not None else None
    who = choice.executor(executor, workers, ray_address)
    config = loading.load(file, given)
    folder = out or Path("results") / config.campaign.name / (share.folder if share is not None else "")

    from ravenjax.campaign import adaptive

    with _ended_by_signals(), terminal.Watch(console.out) as watch:
        results = adaptive.run(config, folder, engine, on_progress=watch, executor=who, shard=share, command=sys.argv)
    _summary(folder, results)
    if share is not None:
        console.out.print(f"one of {share.of} shards; `ravenjax merge OUT SHARD...` joins them", highlight=False)
    elif report:
        write_report(folder)


def _summary(folder: Path, results: Results) -> None:
    """What came out: verdicts, failures by cause, where it is."""
    from ravenjax import terminal
    from ravenjax.campaign import decisions
    from ravenjax.store import manifest

    record = manifest.read(folder)
    if record.done and (rows := terminal.outcome_rows(results.verdicts())):
        columns = ("response / haptic / jump", "runs", "share, 95 % interval")
        console.out.print(terminal.table("Faulty runs", columns, rows))
    if rows := terminal.failure_rows(record.failures, record.done):
        console.out.print(terminal.table("Runs without a valid outcome", ("cause", "runs", "share"), rows))
    if why := decisions.sentence(folder):
        console.out.print(why, markup=False, highlight=False)
    console.out.print(f"results: {folder}", highlight=False, soft_wrap=True)


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the work as Ctrl-C does, with exit code 128 + the signal's number."""

    def leave(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():  # then signals are somebody else's
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as nohup has it
            signal.signal(number, leave)
    try:
        yield
    except SystemExit:
        console.err.print("ended by a signal; finished parts are kept, and the same command goes on", highlight=False)
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def search(
    file: str,
    *,
    out: Annotated[Path | None, Parameter(help="folder; default results/NAME of the search")] = None,
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
    overrides: Overrides = None,
) -> None:
    """Find what matters: the smallest harmful fault, the parameters that decide, how rare an outcome is.

    Whatever ends it, finished runs are kept and the same command goes on. Exit codes as of `run`.

    Parameters
    ----------
    file
        Search file, or the name of a bundled one (see `ravenjax campaigns`).
    """
    from ravenjax import terminal
    from ravenjax.search import runner

    with _ended_by_signals(), terminal.Watch(console.out) as watch:
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
