"""The command `check`: shows what a campaign file would run, without computing it."""

from pathlib import Path
from typing import Any

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Count, Engine, Listing, Overrides

MOST_ROWS = 40
"""Number of groups that are printed; further ones are only counted."""


def check(
    file: str,
    *,
    overrides: Overrides = None,
    out: Path | None = None,
    engine: Engine = "auto",
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
    limit
        as for run: only the first runs
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.inspection.estimate import format_estimate
    from ravenjax.campaign.inspection.preview import preview_campaign
    from ravenjax.report import wording

    sizes = [] if limit is None else [f"campaign.limit={limit}"]
    config = loading.load_campaign(file, [*(overrides or ()), *sizes], runs=False)
    view, sample = preview_campaign(config, out or Path("results") / config.campaign.name, engine)
    view["sample"] = [
        {
            "index": int(row["index"]),
            "run_id": row["run_id"],
            "group": str(row["group"]),
            "fault": wording.describe_fault(row, config.robot),
        }
        for row in sample.to_dict("records")
    ]
    if as_json:
        console.emit_json(view)
        return
    groups = view["groups"]
    more = f", the first {MOST_ROWS} of {len(groups)}" if len(groups) > MOST_ROWS else ""
    summary = console.render_template("check.j2", config=config, duration=format_estimate, **view)
    tables = [
        Listing(
            "",
            f"Campaign {config.campaign.name}, as it would run",
            ("what", "is"),
            [tuple(line.split("|", 1)) for line in summary.splitlines()],
        ),
        _listing(f"Groups{more}", groups[:MOST_ROWS], "name", "design", "runs", "sites", "effects"),
        _listing("Faults by site and effect", view["faults"], "site", "layer", "effect", "runs"),
        _listing("Some of the runs", view["sample"], "index", "group", "fault"),
    ]
    console.print_tables([table for table in tables if table.rows], False)
    for notice in view["notices"]:
        console.print_text(f"note: {notice}")


def _listing(title: str, rows: list[dict[str, Any]], *keys: str) -> Listing:
    columns = tuple({"name": "group", "index": "run"}.get(key, key) for key in keys)
    cells = [[row[key] for key in keys] for row in rows]
    texts = [tuple(", ".join(c) if isinstance(c, list) else str(c) for c in row) for row in cells]
    return Listing("", title, columns, texts)
