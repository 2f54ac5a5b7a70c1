"""Section "Worst runs": the worst runs by kind of outcome, and the commands that replay them."""

from pathlib import Path
from typing import Any

from ravenjax import resources
from ravenjax.report import wording
from ravenjax.report.data.runs import DISTINCT_FAULTS, Runs
from ravenjax.report.run.ranking import rank_runs
from ravenjax.report.sections.tables import replay_command
from ravenjax.vocabulary.robot import Robot

SHOWN_RUNS = 5
"""Number of runs of each kind."""
KINDS = resources.read_tables(__file__, "worst.toml")
"""Outcomes by name, in the order of the page."""


def worst_rows(runs: Runs, folder: Path) -> list[dict[str, Any]]:
    """Return one item per kind of outcome in KINDS: its fields, the number of faults with this
    outcome (n), and its worst runs, one per fault (rows).

    folder: result folder, for the command that replays a run.
    """
    kinds, manifest = [], runs.manifest
    for name, kind in KINDS.items():
        lacks_cue = "{cue}" in kind["distance_sql"] and not manifest.cues
        if lacks_cue or (name == "depth" and not manifest.robot.tissue):
            continue
        distance_sql = kind["distance_sql"].format(cue=manifest.verdict_cue)
        # SQL for the table and the condition of a query.
        matching = runs.matching(f"{DISTINCT_FAULTS} AND ({kind['where']})")
        cases = f"{matching} WHERE NOT isnan(({distance_sql})::DOUBLE)"
        (n,) = runs.table.row(f"SELECT count(*) FROM {cases}")
        worst = rank_runs(runs.table, cases, distance_sql, SHOWN_RUNS)
        pairs = zip(runs.whole_rows([ranked.row for ranked in worst]), worst, strict=True)
        rows = [_row(manifest.robot, row, ranked.value, folder) for row, ranked in pairs]
        kinds.append({"name": name, "unit": "mm", "decimals": 1, **kind, "n": n, "rows": rows})
    return kinds


def _row(robot: Robot, row: dict[str, Any], distance: float, folder: Path):
    # Returns one run of the table: fault, response, times after the first effect, command.
    active = row["first_active_ms"]
    return {
        "run_id": row["run_id"],
        "group": row["group"],
        "fault": wording.describe_fault(row, robot),
        "far": distance,
        "response": row["response"],
        "cause": row["response_cause"],
        "response_ms": row["response_ms"] - active if row["response_ms"] >= 0 else None,
        "cue_ms": row["warned_ms"] - active if row["warned_ms"] >= max(active, 0) else None,
        **({"depth_mm": row["tissue_depth_mm"]} if robot.tissue else {}),
        "verdict": row["verdict"],
        "command": replay_command(folder, row["run_id"]),
    }


def _content(runs: Runs, folder: Path):
    worst = worst_rows(runs, folder)
    every_row = []
    for kind in worst:
        head = {"kind": kind["title"], "measured": kind["measured"]}
        every_row += [head | row for row in kind["rows"]]
    return {"worst": worst, "worst_csv": every_row}


SECTIONS = {"worst": _content}
