"""What decides how far a fault throws the tip: Morris' screening and Sobol indices over the
uncertain robot.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.analyses.search import runner
from ravenjax.analyses.search.file import loading
from studies.uncertainty.parameters import PARAMETERS, Uncertain

OUTCOME = "peak_golden_deviation_mm"
FAULT = {
    "site": "usb_out",
    "channel": ["shoulder", "elbow", "insertion"],
    "effect": "latch_offset",
    "value": 4000,
    "start_ms": 1000,
    "duration_ms": 32,
}
"""An addition to the motor command behind every check, held for 32 ms, on each positioning joint: a
fault that moves the instrument by its size and not by how long it lasts."""
SEARCHES: dict[str, dict[str, Any]] = {
    "morris": {"kind": "morris", "trajectories": 60, "levels": 8},
    "sobol": {"kind": "sobol", "n": 128},
}


class Index(NamedTuple):
    """Indices of one parameter for one fault: value, and ends of the 95 % interval."""

    case: str  # joint that the fault strikes
    parameter: Uncertain
    mean_mm: float  # of the outcome over robots
    deviation_mm: float
    effect: tuple[float, float, float]  # Morris: mean |effect|, mm over the range
    spread: float  # Morris: its deviation, mm
    total: tuple[float, float, float]  # Sobol: total index
    first: tuple[float, float, float]  # Sobol: first order
    runs: int  # of both


def find(out: Path, engine: str) -> list[Index]:
    """Run both searches into folders inside `out`; indices of every joint and parameter. Raises
    UserError.
    """
    records: dict[str, dict[str, Any]] = {}
    for name, search in SEARCHES.items():
        result = runner.run(loading.from_dict(_template(search)), out / name, engine)
        records[name] = {
            "results": result.findings.numbers["results"],
            "points": result.findings.numbers["points"],
            "inputs": [one["name"] for one in result.findings.numbers["inputs"]],
        }
    return indices(records)


def indices(records: Mapping[str, Mapping[str, Any]]) -> list[Index]:
    """Of the records of both searches, by joint in their order and by total index, greatest
    first.
    """
    by_path = {one.path: one for one in PARAMETERS}
    morris, sobol = records["morris"], records["sobol"]
    result = []
    for screen, shares in zip(morris["results"], sobol["results"], strict=True):
        if screen["indices"] is None or shares["indices"] is None:
            continue
        case = str(screen["case"]["fault0_channel"])
        mine = [
            Index(
                case,
                by_path[path],
                float(shares["mean"]),
                float(shares["deviation"]),
                _at(screen["indices"]["mu_star"], morris["inputs"].index(path)),
                float(screen["indices"]["sigma"]["value"][morris["inputs"].index(path)]),
                _at(shares["indices"]["ST"], place),
                _at(shares["indices"]["S1"], place),
                morris["points"] + sobol["points"],
            )
            for place, path in enumerate(sobol["inputs"])
        ]
        result += sorted(mine, key=lambda one: -one.total[0])
    return result


def _template(search: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "campaign": {
            "name": "uncertain_robot_search",
            "seed": 2016,
            "duration_s": 2.0,
            "noise": True,
        },
        "operator": {"motion": "suture", "scale": 0.1, "seed": 1},
        "parameters": drawn(PARAMETERS),
        "search": {**search, "outcomes": [OUTCOME]},
        "group": [{"name": "unchecked", "fault": [FAULT]}],
    }


def drawn(parameters: Sequence[Uncertain]) -> dict[str, Any]:
    """Path -> distribution, as a campaign's table `parameters` has it."""
    return {one.path: tomllib.loads(f"law = {one.law}")["law"] for one in parameters}


def _at(index: Mapping[str, Sequence[float]], place: int) -> tuple[float, float, float]:
    value, low, high = (float(index[key][place]) for key in ("value", "low", "high"))
    return value, low, high
