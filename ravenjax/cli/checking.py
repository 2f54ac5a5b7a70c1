"""The command `check`: what a campaign file would run, with nothing computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import Overrides

if TYPE_CHECKING:
    from ravenjax.campaign.inspection.preview import Preview

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
    """Say what a campaign file would run: runs, groups, faults, operator, cues, time and memory.
    Computes nothing.

    Refuses what `ravenjax run` would refuse, with exit code 2.

    Parameters
    ----------
    file
        Campaign file, or the name of a bundled one (see `ravenjax campaigns`).
    out
        result folder that is meant; default results/NAME
    engine
        auto, cuda, simd, wasm, xla or mjx
    limit
        as for run: only the first runs
    as_json
        print the same as JSON, for programs
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.inspection import preview
    from ravenjax.report import wording

    sizes = [] if limit is None else [f"campaign.limit={limit}"]
    config = loading.load(file, [*(overrides or ()), *sizes])
    view = preview.preview(config, out or Path("results") / config.campaign.name, engine)
    words = [wording.fault(row, config.robot) for row in view.sample.to_dict("records")]
    if as_json:
        import json

        print(json.dumps(preview.as_json(view, words), indent=1))
        return
    _print(view, words)


def _print(view: Preview, words: list[str]) -> None:
    from ravenjax.cli import terminal

    name = view.config.campaign.name
    console.out.print(
        terminal.table(f"Campaign {name}, as it would run", ("what", "is"), list(_summary(view)))
    )
    console.out.print()
    rows = [
        (row.name, row.design, f"{row.runs}", ", ".join(row.sites), ", ".join(row.effects))
        for row in view.groups
    ]
    more = f", the first {MOST_ROWS} of {len(rows)}" if len(rows) > MOST_ROWS else ""
    columns = ("group", "design", "runs", "sites", "effects")
    console.out.print(terminal.table(f"Groups{more}", columns, rows[:MOST_ROWS]))
    if view.faults:
        console.out.print()
        rows = [(row.site, row.layer, row.effect, f"{row.runs}") for row in view.faults]
        console.out.print(
            terminal.table("Faults by site and effect", ("site", "layer", "effect", "runs"), rows)
        )
    if words:
        console.out.print()
        sample = view.sample.to_dict("records")
        rows = [
            (f"{row['index']}", str(row["group"]), text)
            for row, text in zip(sample, words, strict=True)
        ]
        console.out.print(terminal.table("Some of the runs", ("run", "group", "fault"), rows))
    for notice in view.notices:
        console.out.print(f"note: {notice}", markup=False, highlight=False, soft_wrap=True)


def _summary(view: Preview) -> Iterator[tuple[str, str]]:
    from ravenjax.campaign.inspection.estimate import duration

    config = view.config
    campaign = config.campaign
    if campaign.description:
        yield "asks", campaign.description
    if config.source is not None:
        yield "file", str(config.source)
    part = "" if view.due == view.runs else f"; {view.due} of them with limit = {campaign.limit}"
    yield (
        "runs",
        f"{view.runs} in {len(view.groups)} group{'s' if len(view.groups) > 1 else ''}{part}",
    )
    if view.fault_free is not None:
        yield "fault-free", f"{view.fault_free} of them without a fault"
    if view.golden_runs is not None:
        yield (
            "golden runs",
            (
                f"{view.golden_runs}: fault-free ones that the runs are compared with, computed"
                " beside them"
            ),
        )
    if view.copies:
        yield "copies", f"{view.copies} with every input of an earlier run: these come out the same"
    yield "length", f"{campaign.duration_s:g} s each, {campaign.ticks} ticks of 1 ms"
    yield from config.lines()
    for phase in view.phases:
        yield (
            f"phase {phase.name}",
            (
                f"{phase.ms:,} ms of each run, in {phase.stretches:,}"
                f" stretch{'es' * (phase.stretches > 1)}"
            ),
        )
    yield "cue", _cues(config)
    yield "detectors", _detectors(config)
    for one in view.checks:
        yield f"check {one.name}", _check(one)
    if config.stop is not None:
        least = f"{100 * config.stop.half_width:g} points"
        yield (
            "stops",
            f"once {', '.join(config.stop.rates)} are known within +-{least}, so fewer runs may do",
        )
    yield "engine", f"{view.engine} on {view.device}" + (f" ({view.why})" if view.why else "")
    cost = view.cost
    run = (
        f"{duration(cost.run_s)} to run, after {duration(cost.start_s)} to start"
        if cost.run_s
        else "no run is left"
    )
    yield "time", f"{run}; the report comes on top"
    yield (
        "memory",
        (
            f"{cost.memory_mib:.0f} MiB"
            if cost.memory_mib < 2000
            else f"{cost.memory_mib / 1024:.1f} GiB"
        ),
    )
    yield "by", view.basis
    yield "results", f"{view.folder}: {view.state}"


def _cues(config: Any) -> str:
    cues = config.haptics.cues()
    distances = ", ".join(dict.fromkeys(f"{cue.threshold_m * 1e3:g}" for cue in cues))
    decides = (
        f"; set {config.outcomes.cue}, at {cues[config.outcomes.cue].threshold_m * 1e3:g} mm,"
        " decides the verdict"
    )
    return f"pulls beyond {distances} mm" + (
        f", {len(cues)} sets of gains{decides}" if len(cues) > 1 else ""
    )


def _check(one: Any) -> str:
    in_a_row = f", {one.consecutive} ms in a row" if one.consecutive > 1 else ""
    parameters = "".join(f"; {path} = {value}" for path, value in one.parameters.items())
    return f"at {one.at}, above {one.threshold}{in_a_row}: {one.does}{parameters}"


def _detectors(config: Any) -> str:
    thresholds = sum(len(of) for _, _, of in config.detectors)
    names = ", ".join(one.name for one in config.detector)
    return (
        f"{names}: {len(config.detectors)} with {thresholds} thresholds in all"
        if config.detector
        else "none"
    )
