"""Runs a search file or continues an interrupted search, and writes its report.

The report consists of search.json, search.md, search.html and a figure.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.search import boundary, indices, rare
from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading
from ravenjax.analyses.search.file import outcome as outcomes
from ravenjax.analyses.search.file.config import Rare, SearchConfig
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.journal import Journal
from ravenjax.analyses.search.wording import (
    describe_case,
    describe_inputs,
    group_series,
    short_axis_name,
)
from ravenjax.campaign.progress import OnProgress, ProgressFile
from ravenjax.document import html
from ravenjax.errors import UserError, list_lines
from ravenjax.report import wording
from ravenjax.report.drawing import save_panels
from ravenjax.store import files, manifest
from ravenjax.store.access import lock

NUMBERS, TEXT, PAGE = "search.json", "search.md", "search.html"
KINDS: dict[str, tuple[Any, str]] = {
    "boundary": (boundary, "boundary.md.j2"),
    "sobol": (indices, "indices.md.j2"),
    "morris": (indices, "indices.md.j2"),
    "rare": (rare, "rare.md.j2"),
}
"""For each kind: module with `expected_runs`, `find` and `draw`, and template of the report."""


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """A finished search."""

    out: Path  # folder of the search
    record: dict[str, Any]  # content of search.json; `result` holds the numbers that were found
    sentences: list[str]  # the result in short sentences


def run_search(
    file: str | Path | SearchConfig,
    out: str | Path | None,
    engine: str = "auto",
    overrides: Sequence[str] = (),
    on_progress: OnProgress | None = None,
) -> SearchResult:
    """Run a search and write its results into the folder `out`, or continue the search there.
    `file`: a search file, the name of a bundled search, or a loaded search. `out`: folder, by
    default results/NAME. `overrides`: changes of a file, as `key.path=value`. Raise UserError and
    StoreError for errors that the user can correct.
    """
    config = file if isinstance(file, SearchConfig) else loading.load_search(file, overrides)
    folder = Path("results") / config.campaign.campaign.name if out is None else Path(out)
    wanted = [outcomes.parse_outcome(text) for text in config.search.outcomes]
    evaluator = Evaluator(
        Template(config.campaign), wanted, engine, margins=isinstance(config.search, Rare)
    )
    files.require_writable(folder)
    with lock.hold_lock(folder):
        return _search_folder(folder, config, evaluator, on_progress)


def _search_folder(
    folder: Path, config: SearchConfig, evaluator: Evaluator, on_progress: OnProgress | None
) -> SearchResult:
    """Run the search in a folder, from the runs of its journal on, and write its results."""
    search = config.search
    # Everything that must be equal for a search to continue with the stored runs.
    identity = files.json_values(
        {
            "config": config.resolved(),
            "config_hash": manifest.config_hash(config.resolved()),
            "code": manifest.code_hash(config.campaign.robot)[:16],
            "engine": evaluator.engine.name,
            "device": evaluator.engine.device,
            "versions": manifest.package_versions(),
        }
    )
    earlier = _open_folder(folder, identity)
    journal = Journal(folder, manifest.config_hash(identity), earlier.get("rows_sha256"))
    kind, _ = KINDS[search.kind]
    expected = kind.expected_runs(evaluator.template, search)
    evaluator.use_journal(journal, expected, ProgressFile(folder, on_progress))
    try:
        result = kind.find(evaluator.template, search, evaluator, folder)
    except BaseException:
        evaluator.progress.tell("stopped")
        raise
    campaign = config.campaign.campaign
    record = identity | {
        "kind": search.kind,
        "name": campaign.name,
        "file": config.source and str(config.source),
        "seed": campaign.seed,
        "runs": evaluator.runs,
        "batches": evaluator.batches,
        # Runs that this start has computed.
        "computed": evaluator.progress.status.computed,
        "rows_sha256": journal.conclude(evaluator.rows()),
        "result": result,
    }
    sentences = _write_search(folder, record)
    journal.forget()
    evaluator.progress.tell("done")
    return SearchResult(folder, record, sentences)


def _open_folder(out: Path, identity: dict[str, Any]) -> dict[str, Any]:
    """Begin or continue a search in the folder `out`. Return its search.json; {} if there is none.
    `identity`: everything on which the result depends. Raise UserError if the folder contains
    another search, and StoreError if it cannot be written to.
    """
    path = out / NUMBERS
    if not path.exists():
        _write_json(path, identity)
        return {}
    try:
        earlier = files.parse_json(path.read_text(encoding="utf-8"))
        differences = manifest.find_differences(
            {name: earlier[name] for name in identity}, identity
        )
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(
            f"{path}: is not a record of a search; delete it, or name another folder with --out"
        ) from None
    if differences:
        raise UserError(
            f"{out}: contains another search, which differs from the search you are starting:\n"
            f"{list_lines(differences)}\n"
            "Nothing was changed. Name another folder with --out, or delete this folder"
        )
    return earlier


def _write_search(out: Path, record: dict[str, Any]) -> list[str]:
    # Writes figure, text, page and search.json. Returns the findings: items of the text's lists.
    kind, template = KINDS[record["kind"]]
    figure = f"{record['kind']}.svg"
    save_panels(out / figure, kind.draw(record["result"]))
    templates = wording.text_templates(__package__)
    templates.filters |= FILTERS
    templates.globals |= {"series": group_series}
    page = templates.get_template(template)
    text = page.render(record=record, numbers=record["result"], figure=figure)
    files.write_text(out / TEXT, text)
    drawing = (out / figure).read_text(encoding="utf-8")
    files.write_text(out / PAGE, html.from_markdown(text, {figure: drawing}))
    _write_json(out / NUMBERS, record)
    return [line[2:] for line in text.splitlines() if line.startswith("- ")]


def _write_json(path: Path, record: dict[str, Any]):
    files.write_text(path, json.dumps(files.json_values(record), indent=1) + "\n")


FILTERS = {
    "cell": lambda value: str(value).replace("|", r"\|"),
    "general": "{:g}".format,
    "header": lambda names: html.markdown_table(names, ()),
    "largest": lambda values, most: np.argsort(-values)[:most],
    "laws": describe_inputs,
    "short": short_axis_name,
    "values": lambda cells, name: sorted({record["cell"][name] for record in cells}),
    "smallest": lambda cells: min(cells, key=lambda record: abs(record["harmful"])),
    "words": describe_case,
}
