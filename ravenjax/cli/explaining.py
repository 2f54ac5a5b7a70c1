"""The command `explain`: shows the chain from fault to error to failure, for single runs or a
campaign.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Ranking, ResultFolder, RunIds, SameEngine

if TYPE_CHECKING:
    from ravenjax.campaign.inspection.explain import Explained, Explainer
    from ravenjax.report.run.chain import Chain
    from ravenjax.store.manifest import Manifest


def explain(
    folder: ResultFolder,
    *run_ids: RunIds,
    worst: int | None = None,
    by: Ranking = "unintended",
    group: str | None = None,
    out: Path | None = None,
    engine: SameEngine = "auto",
    as_json: AsJson = False,
) -> None:
    """Explain how a fault became a failure: which signal differed first, and where a check could
    detect it.

    Without run ids, --worst and --group, all runs with a fault are explained and summarised, if
    any fault evades the checks.

    Parameters
    ----------
    worst
        explain the N worst runs instead of named ones
    group
        explain every run with a fault of this group, together
    out
        folder of what is written; default FOLDER/explained
    """
    from ravenjax.campaign.inspection.explain import Explainer
    from ravenjax.errors import UserError
    from ravenjax.report.run import ranking
    from ravenjax.store import files, manifest
    from ravenjax.store.access import explained

    if sum((bool(run_ids), worst is not None, group is not None)) > 1:
        raise UserError(
            "which runs? Give run ids or indices, or --worst N, or --group NAME, one of them"
        )
    record = manifest.read_manifest(folder)
    ranked = console.worst_runs(folder, worst, by)
    if worst is not None and not ranked:
        return console.emit_json([]) if as_json else None
    together = None if run_ids or ranked else ranking.faulty_rows(folder, group)
    if together == []:
        words = "No fault evades the checks: there is no silent harm to explain."
        return (
            console.emit_json({"evading": 0, "sentences": [words]})
            if as_json
            else console.print_text(words)
        )
    place = out or folder / explained.FOLDER
    files.require_writable(place)
    explainer = Explainer.of_folder(folder, engine)
    rows = (
        list(dict.fromkeys(explainer.index(run) for run in run_ids))
        or [run.row for run in ranked]
        or together
    )
    explanation = _compute(explainer, rows, quiet=as_json)
    explained.add_explained(place, explanation.ticks, record)
    if others := ranking.count_changed(folder, explanation.results):
        code = "this" if record.code_hash == manifest.code_hash(record.robot) else "another"
        console.print_note(
            f"{folder}: {others} of {len(explanation.ticks)} runs came out otherwise than they are"
            f" stored, by engine {record.engine} and {code} version of the code"
        )
    if together is None:
        _one_by_one(place, record, explanation, as_json)
    else:
        _together(folder, place, record, as_json)
    return None


def _compute(explainer: Explainer, rows: Any, quiet: bool) -> Explained:
    from ravenjax.cli import terminal

    if quiet or len(rows) < 100:
        return explainer.explain(rows)
    with terminal.Watch(console.err) as watch:
        return explainer.explain(rows, watch)


def _one_by_one(place: Path, record: Manifest, explanation: Explained, as_json: bool) -> None:
    from ravenjax.report import downloads
    from ravenjax.report.run import chain, chain_words
    from ravenjax.store.files import write_text

    records = []
    for row, ticks in zip(
        explanation.results.to_dict("records"), explanation.ticks.to_dict("records"), strict=True
    ):
        one = chain.trace_chain(row, ticks, record.robot, record.shape.arms, record.rules.cue)  # type: ignore[arg-type]
        table, plot = (place / f"{one.run_id}.{kind}" for kind in ("csv", "svg"))
        write_text(table, downloads.format_csv(one.links) or "layer,signal\n")
        paths = [table, plot] if chain_words.draw_timeline(one, plot) else [table]
        records.append(one._asdict() | {"visible": one.first, "files": paths})
        if not as_json:
            _print(one, paths)
    if as_json:
        console.emit_json(records)


def _print(one: Chain, paths: list[Path]) -> None:
    from ravenjax.report import wording
    from ravenjax.report.run import chain_words

    console.print_text(
        "\n  ".join([chain_words.chain_title(one), *chain_words.chain_sentences(one)])
    )
    for template in ("links.txt.j2", "near_checks.txt.j2"):
        columns, *rows = wording.fill_table(template, chain=one)
        if rows:
            console.print_table("", columns, rows)
    console.print_text("\n".join([*(f"  wrote    {path}" for path in paths), ""]))


def _together(folder: Path, place: Path, record: Manifest, as_json: bool) -> None:
    import contextlib

    from ravenjax.report import downloads, wording
    from ravenjax.report.data.runs import Runs
    from ravenjax.report.sections import chains
    from ravenjax.store.access import explained
    from ravenjax.store.files import write_text

    ticks = explained.read_explained(place, record)
    assert ticks is not None
    with contextlib.closing(Runs.open(folder, record)) as runs:
        one = chains.summarize_chains(runs, ticks)
    paths = [place / explained.FILE]
    if text := downloads.format_csv(one.carriers):
        paths.append(place / "signals.csv")
        write_text(paths[-1], text)
    if chains.draw_charts(one, place / "signals.svg"):
        paths.append(place / "signals.svg")
    if as_json:
        sentences = chains.chain_sentences(one)
        return console.emit_json(one._asdict() | {"sentences": sentences, "files": paths})
    console.print_text("\n".join(chains.chain_sentences(one)))
    if one.carriers:
        columns, *rows = wording.fill_table("carriers.txt.j2", all=one)
        console.print_table("", columns, rows)
    return console.print_text("\n".join(f"  wrote    {path}" for path in paths))
