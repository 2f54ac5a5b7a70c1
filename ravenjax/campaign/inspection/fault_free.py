"""Computes additional fault-free motion of a campaign's robot, to measure the rate of false alarms.

Each result folder contains one new motion, generated from a different seed. With the campaign's
seed, even a longer run would begin with the campaign's motion.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ravenjax.campaign import runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.progress import OnProgress
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.store import manifest
from ravenjax.store.access import fault_free, query
from ravenjax.store.access.fault_free import FOLDER, UNVARIED
from ravenjax.store.manifest import Manifest, Nested

SHORTEST_S, LONGEST_S = 60, 600
"""Least and greatest length of a fault-free run, s.

A longer run needs more memory. A run also records only its first false cue.
"""
UNTIL_LIVE_S = 1
"""Time from the start of a run until the pedal goes down, rounded up, s."""
MOTIONS = 10
"""Number of different motions to aim for if few hours are requested."""
DRAWN = 4
"""Runs of each motion if parameters of the robot are drawn from distributions."""
ENOUGH, LITTLE = 10, 0.1
"""After ENOUGH motions with a smaller share of time in pedal-down than LITTLE,
`extend_fault_free` raises UserError, because something stops the robot early in each motion.
"""
MS_PER_HOUR = 3.6e6


def extend_fault_free(
    folder: Path,
    hours: float,
    engine: str = "auto",
    *,
    on_motion: Callable[[float, Path], None] = lambda *_: None,
    on_progress: OnProgress | None = None,
    command: Sequence[str] = (),
) -> float:
    """Compute fault-free runs for a result until they have `hours` in pedal-down; return these.
    Hours of earlier calls count, hours of golden runs do not. on_motion: called with the hours so
    far and the next folder. Raise UserError and StoreError for what the user can correct. Finished
    motions are kept, and the same call continues after them.
    """
    record = manifest.read_manifest(folder)
    _require(record, hours)
    seconds, begun = _length_s(record, hours), _hours(folder, record)
    available, motions = begun, 0
    for name, raw in fault_free_campaigns(record.config, seconds):
        if available >= hours:
            return available
        path = folder / FOLDER / name
        if (path / manifest.FILE).exists():
            earlier = manifest.read_manifest(path)
            if earlier.finished is not None or earlier.code_hash != record.code_hash:
                continue
            raw = earlier.config
        on_motion(available, path)
        config = validate_tables(raw)
        if engine == "auto":
            engine = selection.single_run_engine(record.engine)
        runner.run_campaign(config, path, engine, on_progress=on_progress, command=command)
        before, available = available, _hours(folder, record)
        if not available > before:
            raise UserError(
                f"{path}: the robot was never in pedal-down in {seconds} s of fault-free motion,"
                " so no false cue can be counted"
            )
        motions += 1
        added_s = (available - begun) * 3600
        if motions >= ENOUGH and added_s < LITTLE * motions * seconds:
            raise UserError(
                f"{folder / FOLDER}: {motions} fault-free motions of {seconds} s contain only"
                f" {added_s:.3g} s in pedal-down. The robot stops without a fault, possibly because"
                " of a check or detector of yours. The report shows how often each check and each"
                f" detector stopped it (ravenjax report {folder}). Raise a threshold, and run again"
            )
    return available


def _require(record: Manifest, hours: float):
    # Checks the number of hours, and that the result has the current code and a motion that varies.
    if not (math.isfinite(hours) and hours > 0):
        raise UserError(f"HOURS is {hours:g}, expected a number above 0, such as 7.4")
    if record.code_hash != manifest.code_hash(record.robot):
        raise UserError(
            "the result was computed by another version of the code, whose false cues may"
            " differ; first run the campaign again, into another folder"
        )
    require_new_motions(record.config)


def require_new_motions(config: Nested) -> None:
    """Raise UserError unless another seed gives a motion that the campaign did not contain. config:
    tables of the campaign file.
    """
    if (operator := config.get("operator")) is None:
        robot = config["campaign"]["robot"]
        raise UserError(
            f"robot {robot!r} has the same motion for every seed, so further runs would repeat it"
        )
    if operator.get("file"):
        raise UserError(
            f"the operator is a recording ({operator['file']}), which gives no new motion. Copy the"
            " campaign file without its faults to FILE. For each other recording: ravenjax run FILE"
            f" --set operator.file=RECORDING --out RESULT_FOLDER/{FOLDER}/NEW_NAME"
        )
    if operator.get("motion") in UNVARIED:
        raise UserError(
            f"operator.motion = {operator['motion']!r} is the same motion for every seed, so"
            " further runs would repeat it"
        )


def fault_free_campaigns(tables: Nested, seconds: int) -> Iterator[tuple[str, Nested]]:
    """Yield (name, tables) of fault-free campaigns endlessly, each with a new motion. tables:
    tables of the original campaign.
    """
    # A parameter with a distribution needs several runs, each with another drawn robot.
    has_distribution = any(
        isinstance(value, dict)
        for table in ("parameters", "cross")
        for value in tables.get(table, {}).values()
    )
    # 0 runs: one run for each listed value of a parameter.
    runs = DRAWN if has_distribution else 0
    motion, seed = tables["operator"].get("motion") or "suture", int(tables["operator"]["seed"])
    while True:
        seed = (seed + 1) % 2**31
        name = f"{motion}_{seed}"
        settings = {"name": name, "description": "fault-free motion", "duration_s": float(seconds)}
        base = fault_free_tables(tables, runs, seed=seed, **settings)
        yield name, base | {"operator": tables["operator"] | {"seed": seed}}


def fault_free_tables(tables: Nested, runs: int, **settings: Any) -> Nested:
    """Return the tables of a campaign without its faults. A table or key that is None is absent.
    runs: number of drawn robots; 0: one run for each listed value of a parameter. settings: keys of
    [campaign] to replace.
    """
    group = {"name": "fault_free"} | ({"design": "random", "runs": runs} if runs else {})
    return {
        **tables,
        **({"reaction": None} if "reaction" in tables else {}),
        "stop": None,
        "group": [group],
        "campaign": tables["campaign"] | {"limit": None} | settings,
    } | {
        name: fault_free.without_reaction(tables.get(name, {})) for name in ("parameters", "cross")
    }


def _length_s(record: Manifest, hours: float) -> int:
    config = validate_tables(next(fault_free_campaigns(record.config, SHORTEST_S))[1])
    wanted = hours * 3600 / (MOTIONS * design.count_rows(config))
    return math.ceil(min(max(wanted + UNTIL_LIVE_S, SHORTEST_S), LONGEST_S))


def _hours(folder: Path, record: Manifest) -> float:
    # Returns the hours with the pedal down in the fault-free results of a folder.
    total_ms = 0.0
    for motion in fault_free.find_fault_free(folder, record).motions:
        with query.open_folder(motion.path) as table:
            sql = f"SELECT sum(pedal_down_ms) FROM {query.RESULTS} WHERE failed = ''"
            (pedal_ms,) = table.row(sql)
        total_ms += float(pedal_ms or 0)
    return total_ms / MS_PER_HOUR
