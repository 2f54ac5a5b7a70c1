"""Runs a search file, or continues an interrupted search."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax.analyses.search import indices, output, rare
from ravenjax.analyses.search.boundary import bisection
from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading
from ravenjax.analyses.search.file import outcome as outcomes
from ravenjax.analyses.search.file.config import Rare, SearchConfig
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
from ravenjax.campaign.progress import OnProgress, ProgressFile
from ravenjax.store import files, manifest
from ravenjax.store.access import lock

KINDS: dict[str, tuple[Any, str]] = {
    "boundary": (bisection, "boundary.md.j2"),
    "sobol": (indices, "indices.md.j2"),
    "morris": (indices, "indices.md.j2"),
    "rare": (rare, "rare.md.j2"),
}
"""For each kind of search: the module with `due`, `find` and `draw`, and the template."""


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """A finished search."""

    out: Path  # folder of the search
    record: dict[str, Any]  # content of search.json; `result` holds the numbers that were found
    sentences: list[str]  # the result in short sentences


def run_search(
    file: str | Path | SearchConfig,
    out: str | Path | None = None,
    engine: str = "auto",
    overrides: Sequence[str] = (),
    on_progress: OnProgress | None = None,
) -> SearchResult:
    """Run a search and write it into `out`, or finish it if `out` holds a part of it.

    The search is a file, a bundled one by name, or a loaded one. `out`: folder, by default
    results/NAME. `overrides`: `key.path=value`, for a file. Raises UserError and StoreError for
    errors that the user can fix.
    """
    config = file if isinstance(file, SearchConfig) else loading.load_search(file, overrides)
    folder = Path("results") / config.campaign.campaign.name if out is None else Path(out)
    wanted = [outcomes.parse_outcome(text) for text in config.search.outcomes]
    evaluator = Evaluator(
        Template(config.campaign), wanted, engine, margins=isinstance(config.search, Rare)
    )
    files.require_writable(folder)
    with lock.hold_lock(folder):
        return _into(folder, config, evaluator, on_progress)


def _into(
    folder: Path, config: SearchConfig, evaluator: Evaluator, on_progress: OnProgress | None
) -> SearchResult:
    search, identity = config.search, _identity(config, evaluator)
    earlier = output.open_folder(folder, identity)
    journal = Journal(folder, manifest.config_hash(identity), earlier.get("rows_sha256"))
    kind, template = KINDS[search.kind]
    due = kind.due(evaluator.template, search)
    evaluator.keep_in(journal, due, ProgressFile(folder, on_progress))
    try:
        result = kind.find(evaluator.template, search, evaluator, folder)
    except BaseException:
        evaluator.progress.tell("stopped")
        raise
    campaign = config.campaign.campaign
    record = identity | {
        "kind": search.kind,
        "name": campaign.name,
        "file": str(config.source) if config.source is not None else None,
        "seed": campaign.seed,
        "runs": evaluator.runs,
        "batches": evaluator.batches,
        # Runs that this start has computed.
        "computed": evaluator.progress.status.computed,
        "rows_sha256": journal.conclude(evaluator.rows()),
        "result": result,
    }
    sentences = output.write_search(folder, record, template, kind.draw)
    journal.forget()
    evaluator.progress.tell("done")
    return SearchResult(folder, record, sentences)


def _identity(config: SearchConfig, evaluator: Evaluator) -> dict[str, Any]:
    """Return everything that decides the result, as JSON values."""
    return files.json_values(
        {
            "config": config.resolved(),
            "config_hash": manifest.config_hash(config.resolved()),
            "code": manifest.code_hash()[:16],
            "engine": evaluator.engine.name,
            "device": evaluator.engine.device,
            "versions": manifest.package_versions(),
        }
    )
