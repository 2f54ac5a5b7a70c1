"""The command `check`: what a campaign file would run, with nothing computed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import Overrides

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
    limit: Annotated[int | None, Parameter(validator=console.SOME)] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
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
    as_json
        print the same as JSON, for programs
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


def _summary(config: CampaignConfig, view: dict[str, Any]) -> Iterator[tuple[str, str]]:
    from ravenjax.campaign.inspection.estimate import duration

    campaign, runs, due = config.campaign, view["runs"], view["runs_asked_for"]
    if campaign.description:
        yield "asks", campaign.description
    if config.source is not None:
        yield "file", str(config.source)
    part = "" if due == runs else f"; {due} of them with limit = {campaign.limit}"
    groups = len(view["groups"])
    yield "runs", f"{runs} in {groups} group{'s' if groups > 1 else ''}{part}"
    if view["fault_free_runs"] is not None:
        yield "fault-free", f"{view['fault_free_runs']} of them without a fault"
    if view["golden_runs"] is not None:
        yield (
            "golden runs",
            f"{view['golden_runs']}: fault-free ones that the runs are compared with, computed"
            " beside them",
        )
    if copies := view["copies"]:
        yield "copies", f"{copies} with every input of an earlier run: these come out the same"
    yield "length", f"{campaign.duration_s:g} s each, {campaign.ticks} ticks of 1 ms"
    yield from config.lines()
    for phase in view["phases"]:
        stretches = phase["stretches"]
        yield (
            f"phase {phase['name']}",
            f"{phase['ms']:,} ms of each run, in {stretches:,} stretch{'es' * (stretches > 1)}",
        )
    cues, verdict_cue = config.haptics.cues(), config.outcomes.cue
    distances = ", ".join(dict.fromkeys(f"{cue.threshold_m * 1e3:g}" for cue in cues))
    decides = (
        f", {len(cues)} sets of gains; set {verdict_cue}, at"
        f" {cues[verdict_cue].threshold_m * 1e3:g} mm, decides the verdict"
        if len(cues) > 1
        else ""
    )
    yield "cue", f"pulls beyond {distances} mm{decides}"
    thresholds = sum(len(detector["thresholds"]) for detector in view["detectors"])
    names = ", ".join(detector.name for detector in config.detector)
    yield (
        "detectors",
        f"{names}: {len(view['detectors'])} with {thresholds} thresholds in all"
        if names
        else "none",
    )
    for check in view["checks"]:
        in_a_row = f", {check['consecutive']} ms in a row" if check["consecutive"] > 1 else ""
        parameters = "".join(f"; {path} = {value}" for path, value in check["parameters"].items())
        yield (
            f"check {check['name']}",
            f"at {check['at']}, above {check['threshold']}{in_a_row}: {check['does']}{parameters}",
        )
    if config.stop is not None:
        least = f"{100 * config.stop.half_width:g} points"
        yield (
            "stops",
            f"once {', '.join(config.stop.rates)} are known within +-{least}, so fewer runs may do",
        )
    engine, cost = view["engine"], view["expected"]
    why = f" ({engine['why']})" if engine["why"] else ""
    yield "engine", f"{engine['name']} on {engine['device']}{why}"
    run_s, start_s, mib = cost["run_s"], cost["start_s"], cost["memory_mib"]
    run = (
        f"{duration(run_s)} to run, after {duration(start_s)} to start"
        if run_s
        else "no run is left"
    )
    yield "time", f"{run}; the report comes on top"
    yield "memory", f"{mib:.0f} MiB" if mib < 2000 else f"{mib / 1024:.1f} GiB"
    yield "by", cost["basis"]
    yield "results", f"{view['folder']['path']}: {view['folder']['holds']}"
