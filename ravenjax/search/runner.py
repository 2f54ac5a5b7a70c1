"""Runs a search file: template, evaluator, the search of its kind, output."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax.campaign.progress import OnProgress
from ravenjax.search import boundary, indices, loading, output, rare
from ravenjax.search import outcome as outcomes
from ravenjax.search.config import Boundary, Rare, SearchConfig
from ravenjax.search.evaluator import Evaluator
from ravenjax.search.findings import Findings
from ravenjax.search.template import Template
from ravenjax.store import manifest


@dataclasses.dataclass(frozen=True)
class Result:
    """A search that has run."""

    out: Path  # its folder
    findings: Findings
    record: dict[str, Any]  # what search.json says beside the findings


def run(
    file: str | Path | SearchConfig,
    out: str | Path | None = None,
    engine: str = "auto",
    overrides: Sequence[str] = (),
    on_progress: OnProgress | None = None,
) -> Result:
    """Run the search of a file, of a bundled one by name, or a loaded one, and write it into `out`.

    out: folder, by default results/NAME. overrides: `key.path=value`, of a file. Raises UserError and StoreError for
    what the user can mend.
    """
    config = file if isinstance(file, SearchConfig) else loading.load(file, overrides)
    folder = Path("results") / config.campaign.campaign.name if out is None else Path(out)
    template, search = Template(config.campaign), config.search
    wanted = [outcomes.parse(text) for text in search.outcomes]
    estimates = {Boundary: boundary.due, Rare: rare.due}
    due = estimates.get(type(search), indices.due)(template, search)  # pyright: ignore[reportArgumentType]
    evaluator = Evaluator(template, wanted, engine, on_progress, due, margins=isinstance(search, Rare))
    identity = _identity(config, evaluator)
    output.open_folder(folder, identity)
    if isinstance(search, Boundary):
        findings = boundary.find(template, search, evaluator, folder, engine)
    elif isinstance(search, Rare):
        findings = rare.find(template, search, evaluator)
    else:
        findings = indices.find(template, search, evaluator)
    evaluator.progress.tell("done")
    record = identity | _record(config, evaluator)
    output.write(folder, record, findings, evaluator.rows())
    return Result(folder, findings, record)


def _identity(config: SearchConfig, evaluator: Evaluator) -> dict[str, str]:
    """What decides what comes out."""
    return {
        "config_hash": manifest.config_hash(config.resolved()),
        "code_hash": manifest.code_hash(),
        "engine": evaluator.engine.name,
        "device": evaluator.engine.device,
    }


def _record(config: SearchConfig, evaluator: Evaluator) -> dict[str, Any]:
    return {
        "kind": config.search.kind,
        "name": config.campaign.campaign.name,
        "file": str(config.source) if config.source is not None else None,
        "config": config.resolved(),
        "seed": config.campaign.campaign.seed,
        "versions": manifest.package_versions(),
        "runs": evaluator.runs,
        "batches": evaluator.batches,
        "compile_s": evaluator.progress.compile_s,
        "run_s": evaluator.run_s,
        "runs_per_s": evaluator.runs / evaluator.run_s if evaluator.run_s else 0.0,
    }
