"""Runs a search file, or finishes it: template, evaluator, the search of its kind, output."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax.analyses.search import output
from ravenjax.analyses.search.boundary import bisection
from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading
from ravenjax.analyses.search.file import outcome as outcomes
from ravenjax.analyses.search.file.config import Boundary, Rare, SearchConfig
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.findings import SearchFindings, plain
from ravenjax.analyses.search.indices import analysis
from ravenjax.analyses.search.journal import Journal
from ravenjax.analyses.search.rare import simulation
from ravenjax.campaign.progress import OnProgress, ProgressFile
from ravenjax.store import files, manifest
from ravenjax.store.access import lock


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """A search that has run."""

    out: Path  # its folder
    findings: SearchFindings
    record: dict[str, Any]  # what search.json says beside the findings
    sentences: list[str]  # the answer in short


def run(
    file: str | Path | SearchConfig,
    out: str | Path | None = None,
    engine: str = "auto",
    overrides: Sequence[str] = (),
    on_progress: OnProgress | None = None,
) -> SearchResult:
    """Run the search of a file, of a bundled one by name, or a loaded one, and write it into `out`,
    or finish it where `out` holds a part of it.

    out: folder, by default results/NAME. overrides: `key.path=value`, of a file. Raises UserError
    and StoreError for what the user can mend.
    """
    config = file if isinstance(file, SearchConfig) else loading.load(file, overrides)
    folder = Path("results") / config.campaign.campaign.name if out is None else Path(out)
    wanted = [outcomes.parse(text) for text in config.search.outcomes]
    evaluator = Evaluator(
        Template(config.campaign), wanted, engine, margins=isinstance(config.search, Rare)
    )
    files.require_writable(folder)
    with lock.held(folder):
        return _into(folder, config, evaluator, on_progress)


def _into(
    folder: Path, config: SearchConfig, evaluator: Evaluator, on_progress: OnProgress | None
) -> SearchResult:
    """Search, in a folder that nobody else writes to."""
    search, identity = config.search, _identity(config, evaluator)
    earlier = output.open_folder(folder, identity)
    journal = Journal(folder, manifest.config_hash(identity), earlier.get("rows_sha256"))
    estimates = {Boundary: bisection.due, Rare: simulation.due}
    due = estimates.get(type(search), analysis.due)(evaluator.template, search)  # pyright: ignore[reportArgumentType]
    evaluator.keep_in(journal, due, ProgressFile(folder, on_progress))
    try:
        with journal:
            findings = _find(config, evaluator, folder)
    except BaseException:
        evaluator.progress.tell("stopped")
        raise
    record = (
        identity | _record(config, evaluator) | {"rows_sha256": journal.conclude(evaluator.rows())}
    )
    sentences = output.write(folder, record, findings)
    journal.forget()
    evaluator.progress.tell("done")
    return SearchResult(folder, findings, record, sentences)


def _find(config: SearchConfig, evaluator: Evaluator, folder: Path) -> SearchFindings:
    """The search of its kind."""
    search, template = config.search, evaluator.template
    if isinstance(search, Boundary):
        return bisection.find(template, search, evaluator, folder)
    if isinstance(search, Rare):
        return simulation.find(template, search, evaluator)
    return analysis.find(template, search, evaluator)


def _identity(config: SearchConfig, evaluator: Evaluator) -> dict[str, Any]:
    """What decides what comes out, as JSON has it."""
    return plain(
        {
            "config": config.resolved(),
            "config_hash": manifest.config_hash(config.resolved()),
            "code": manifest.code_hash()[:16],
            "engine": evaluator.engine.name,
            "device": evaluator.engine.device,
            "versions": manifest.package_versions(),
        }
    )


def _record(config: SearchConfig, evaluator: Evaluator) -> dict[str, Any]:
    status = evaluator.progress.status
    return {
        "kind": config.search.kind,
        "name": config.campaign.campaign.name,
        "file": str(config.source) if config.source is not None else None,
        "seed": config.campaign.campaign.seed,
        "runs": evaluator.runs,
        "batches": evaluator.batches,
        # runs of the last start, whose times follow
        "computed": status.computed,
        "compile_s": status.compile_s,
        "run_s": evaluator.run_s,
        "runs_per_s": status.computed / evaluator.run_s if evaluator.run_s else None,
    }
