"""The command `check`: what a campaign file would run, with nothing computed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Count, Overrides

if TYPE_CHECKING:
    from ravenjax.campaign.file.config import CampaignConfig

MOST_ROWS = 40
"""Groups that are printed; of more, the rest is counted."""


def check(
    file: str,
    *,
    overrides: Overrides = None,
    out: Path | None = None,
    engine: str = "auto",
    limit: Count = None,
    as_json: AsJson = False,
) -> None:
    """Show what a campaign file would run: runs, groups, faults, operator, cues, time and memory.

    Simulates nothing. Refuses what `ravenjax run` would refuse, with exit code 2.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one (see `ravenjax campaigns`).
    out
        result folder that is meant; default results/NAME
    engine
        auto, cuda, simd, xla or mjx
    limit
        as for run: only the first runs
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.inspection.preview import preview
    from ravenjax.report import wording

    sizes = [] if limit is None else [f"campaign.limit={limit}"]
    config = loading.load(file, [*(overrides or ()), *sizes])
    view, sample = preview(config, out or Path("results") / config.campaign.name, engine)
    view["sample"] = [
        {
            "index": int(row["index"]),
            "run_id": row["run_id"],
            "group": str(row["group"]),
            "fault": wording.fault(row, config.robot),
        }
        for row in sample.to_dict("records")
    ]
    if as_json:
        console.emit_json(view)
        return
    groups = view["groups"]
    more = f", the first {MOST_ROWS} of {len(groups)}" if len(groups) > MOST_ROWS else ""
    _print_table(
        f"Campaign {config.campaign.name}, as it would run", ("what", "is"), _summary(config, view)
    )
    _print_rows(f"Groups{more}", ("name", "design", "runs", "sites", "effects"), groups[:MOST_ROWS])
    if view["faults"]:
        columns = ("site", "layer", "effect", "runs")
        _print_rows("Faults by site and effect", columns, view["faults"])
    if view["sample"]:
        _print_rows("Some of the runs", ("index", "group", "fault"), view["sample"])
    for notice in view["notices"]:
        console.say(f"note: {notice}")


def _print_table(title: str, columns: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    from ravenjax.cli import terminal

    console.out.print(terminal.table(title, columns, list(rows)))


def _print_rows(title: str, keys: tuple[str, ...], rows: list[dict[str, Any]]) -> None:
    """Rows as JSON has them, below an empty line."""
    console.out.print()
    cells = (tuple(row[key] for key in keys) for row in rows)
    _print_table(
        title,
        tuple({"name": "group", "index": "run"}.get(key, key) for key in keys),
        (tuple(", ".join(c) if isinstance(c, list) else str(c) for c in row) for row in cells),
    )


def _summary(config: CampaignConfig, view: dict[str, Any]) -> list[tuple[str, ...]]:
    """(what, how it is) of a preview, by the lines of check.j2."""
    import jinja2

    from ravenjax.campaign.inspection.estimate import duration

    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("ravenjax.cli"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = templates.get_template("check.j2").render(config=config, duration=duration, **view)
    return [tuple(line.split("|", 1)) for line in text.splitlines()]
