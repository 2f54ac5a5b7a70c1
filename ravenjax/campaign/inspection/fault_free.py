"""Computes additional fault-free motion of a campaign's robot, to measure the rate of false alarms.

Each folder holds one new motion. It has a different seed, because with the campaign's seed even a
longer run would begin with the campaign's motion.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.campaign import runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import validate_tables
from ravenjax.campaign.progress import OnProgress
from ravenjax.errors import UserError
from ravenjax.store import manifest
from ravenjax.store.access import fault_free, query
from ravenjax.store.access.fault_free import FOLDER, UNVARIED
from ravenjax.store.manifest import Manifest

SHORTEST_S, LONGEST_S = 60, 600
"""Least and greatest length of a run, s.

A longer run needs more memory, and a cue that has occurred once hides what would come after it.
"""
UNTIL_LIVE_S = 1
"""Time until the pedal goes down, rounded up, s."""
MOTIONS = 10
"""Number of different motions to aim for if few hours are wanted."""
DRAWN = 4
"""Runs of each motion if parameters of the robot are drawn."""
ENOUGH, LITTLE = 10, 0.1
"""After ENOUGH motions with less than this share of time in pedal-down, `extend` raises UserError.

Something then stops the robot soon in each motion.
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
    """Compute fault-free motion beside the result in `folder` until there are `hours` of it in
    pedal-down; return the hours.

    Hours of earlier calls count; those of golden runs do not. on_motion: called with the hours so
    far and the next folder. Raises UserError and StoreError for what the user can correct. Finished
    motions stay, and the same call continues.
    """
    record = manifest.read_manifest(folder)
    _require(record, hours)
    seconds, begun = _length_s(record, hours), _hours(folder, record)
    there, motions = begun, 0
    for name, raw in fault_free_campaigns(record.config, seconds):
        if there >= hours:
            return there
        path = folder / FOLDER / name
        if (path / manifest.FILE).exists():
            earlier = manifest.read_manifest(path)
            if earlier.finished is not None or earlier.code_hash != record.code_hash:
                continue
            raw = earlier.config
        on_motion(there, path)
        config = validate_tables(raw)
        if engine == "auto":
            # One motion is one lane, which a processor core runs faster than a GPU does.
            engine = "simd" if record.engine == "cuda" else record.engine
        runner.run_campaign(config, path, engine, on_progress=on_progress, command=command)
        before, there = there, _hours(folder, record)
        if not there > before:
            raise UserError(
                f"{path}: {seconds} s of fault-free motion added nothing: the robot was never in"
                " pedal-down, so no false cue can be counted"
            )
        motions += 1
        added_s = (there - begun) * 3600
        if motions >= ENOUGH and added_s < LITTLE * motions * seconds:
            raise UserError(
                f"{folder / FOLDER}: {motions} fault-free motions of {seconds} s had"
                f" {added_s:.3g} s of pedal-down: something stops the robot without a fault, as a"
                " check or detector of your own may. The report shows how often (ravenjax report"
                f" {folder}). Raise its threshold, and run the campaign again"
            )
    return there


def _require(record: Manifest, hours: float) -> None:
    if not (math.isfinite(hours) and hours > 0):
        raise UserError(f"HOURS is {hours:g}, expected a number above 0, such as 7.4")
    if record.code_hash != manifest.code_hash(record.robot):
        raise UserError(
            "the result was computed by another version of the code, whose false cues may"
            " differ; first run the campaign again, into another folder"
        )
    require_others(record.config)


def require_others(config: Mapping[str, Any]) -> None:
    """Raise UserError unless there are motions that the campaign of these tables did not have."""
    if (operator := config.get("operator")) is None:
        robot = config["campaign"]["robot"]
        raise UserError(f"robot {robot!r} has one motion for every seed: no more to compute")
    if operator.get("file"):
        raise UserError(
            f"the operator is a recording ({operator['file']}), which has no other motion to"
            " generate. Put other recordings beside the result: ravenjax run FILE --set"
            f" operator.file=OTHER --out RESULT/{FOLDER}/NAME, with FILE the campaign without its"
            " faults"
        )
    if operator.get("motion") in UNVARIED:
        raise UserError(
            f"operator.motion = {operator['motion']!r} is the same motion for every seed: no more"
            " to compute"
        )


def fault_free_campaigns(
    tables: Mapping[str, Any], seconds: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (name, tables) of fault-free campaigns without end, each with a new motion. tables:
    tables of the original campaign.
    """
    # If a parameter has a distribution, the robots are drawn.
    runs = DRAWN * any(
        isinstance(value, dict)
        for table in ("parameters", "cross")
        for value in tables.get(table, {}).values()
    )
    motion, seed = tables["operator"].get("motion") or "suture", int(tables["operator"]["seed"])
    while True:
        seed = (seed + 1) % 2**31
        base = fault_free_tables(
            tables,
            runs,
            name=f"{motion}_{seed}",
            description="fault-free motion",
            seed=seed,
            duration_s=float(seconds),
        )
        name = base["campaign"]["name"]
        yield name, base | {"operator": tables["operator"] | {"seed": seed}}


def fault_free_tables(tables: Mapping[str, Any], runs: int, **settings: Any) -> dict[str, Any]:
    """Return the tables of a campaign without its faults, with these settings.

    `runs`: robots that are drawn; 0: each value of a parameter gets a run.
    """
    group = {"name": "fault_free"} | ({"design": "random", "runs": runs} if runs else {})
    return {
        **tables,
        **dict.fromkeys(tables.keys() & {"reaction"}),
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
    total_ms = 0.0
    for motion in fault_free.find_fault_free(folder, record).motions:
        with query.open_folder(motion.path) as table:
            (pedal_ms,) = table.row(
                f"SELECT sum(pedal_down_ms) FROM {query.RESULTS} WHERE failed = ''"
            )
        total_ms += float(pedal_ms or 0)
    return total_ms / MS_PER_HOUR
