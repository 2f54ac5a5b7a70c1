"""Computes when the fault of one run first changed each signal, on its way to the failure.

A *signal* is a seam of the robot's tick, on one arm. For each signal the result contains the tick
in which the signal first differs from the golden run, and the tick in which it leaves its normal
range. From that second tick on, the fault is *visible* in the signal. A signal with several numbers
has the earliest tick of its numbers.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes import verdict
from ravenjax.report import wording
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.seams import Crossing, list_crossings

DIFFERS, LEAVES, NEAR, GOLDEN_NEAR, NEAR_MS = (
    "differs:",
    "leaves:",
    "near:",
    "golden_near:",
    "near_ms:",
)
"""Prefixes of the columns of explained runs, as `campaign.inspection.explain` names them."""
NEVER = np.iinfo(np.int32).max
"""Takes the place of -1 where the earliest of several times is sought."""
HARMS = {
    "unintended motion": "unintended_first_ms",
    "loss of motion": "loss_first_ms",
    "false report": "false_report_first_ms",
}
"""Column of the result table that holds the time at which each hazard began."""


class SignalTicks(NamedTuple):
    """Times at which one signal changed in some runs, arrays [runs] in ms; -1: never."""

    name: str  # such as gold/mpos
    layer: str  # in words
    meaning: str
    differs: np.ndarray
    leaves: np.ndarray
    # index into `channels` of the number that differed first
    differing: np.ndarray
    leaving: np.ndarray
    channels: tuple[str, ...]
    # True if any of its numbers has a normal range
    ranged: bool


class ChainLink(NamedTuple):
    """One signal of a chain. Times are in ms since the run began; -1: never."""

    layer: str
    signal: str
    meaning: str
    differs_ms: int
    # name of the number that differed first, or ""
    differs_in: str
    leaves_ms: int
    leaves_in: str
    # Time from leaving its range to harm; None if it never was visible, or if there is no harm.
    left_ms: int | None


class NearCheck(NamedTuple):
    """How close a check came to its limit before harm."""

    check: str
    unit: str
    # Least distance to the limit until harm; 0 or less means that it tripped.
    margin: float
    # the golden run's margin until the same tick
    golden: float
    ms: int  # time of the least margin
    # first trip in the whole run; -1: never
    tripped_ms: int
    does: str


class Chain(NamedTuple):
    """One run, with the chain of signals from its fault to its hazard."""

    run_id: str
    index: int
    group: str
    fault: str
    verdict: str
    hazard: str
    fault_ms: int  # first effect; -1: no effect
    cue_ms: int
    told_ms: int
    # Time at which the run's hazard began; -1 if it has none, or one without a moment.
    harm_ms: int
    links: Sequence[ChainLink]  # signals that differ, in the robot's order
    # Checks that tripped, or came nearer to their limit than in the golden run.
    checks: Sequence[NearCheck]

    @property
    def first(self) -> ChainLink | None:
        """Return the first signal that became visible, or None; the robot's order decides ties."""
        visible = [link for link in self.links if link.leaves_ms >= 0]
        return min(visible, key=lambda link: link.leaves_ms, default=None)


def list_signals(ticks: Mapping[str, Any], robot: Robot, arms: Iterable[str]) -> list[SignalTicks]:
    """Return every signal in the robot's order. `ticks`: columns, arrays [runs] or numbers."""
    runs = np.size(ticks["run_id"])
    named: dict[str, list[Crossing]] = {}
    for place in list_crossings(robot.seams, arms):
        named.setdefault(place.signal, []).append(place)
    out = []
    for name, places in named.items():
        differs = _stacked(ticks, [f"{DIFFERS}{place.name}" for place in places], runs)
        leaves = _stacked(ticks, [f"{LEAVES}{place.name}" for place in places], runs)
        seam = places[0].seam
        out.append(
            SignalTicks(
                name,
                robot.layers[seam.layer],
                seam.meaning,
                earliest_time(differs),
                earliest_time(leaves),
                _late(differs).argmin(axis=0),
                _late(leaves).argmin(axis=0),
                tuple(place.channel.name for place in places),
                any(place.channel.site for place in places),
            )
        )
    return out


def trace_chain(
    row: Mapping[str, Any], ticks: Mapping[str, Any], robot: Robot, arms: Iterable[str], cue: int
) -> Chain:
    """Return the chain of one run, from its row of the result table and of the explained runs.
    `cue`: number of the haptic set of the verdict.
    """
    hazard, name = str(row["hazard"]), f"cue{cue}_first_ms"
    harm = int(row[HARMS[hazard]]) if hazard in HARMS else -1
    return Chain(
        run_id=str(row["run_id"]),
        index=int(row["index"]),
        group=str(row["group"]),
        fault=wording.describe_fault(dict(row), robot),
        verdict=str(row["verdict"] or row["failed"]),
        hazard=hazard,
        fault_ms=int(row["first_active_ms"]),
        cue_ms=int(verdict.beyond_golden(row[name], row[f"golden_{name}"])),
        told_ms=int(row["told_ms"]),
        harm_ms=harm,
        links=[
            _link(signal, harm)
            for signal in list_signals(ticks, robot, arms)
            if signal.differs[0] >= 0
        ],
        checks=_checks(row, ticks, robot),
    )


def chain_table(
    results: pd.DataFrame, ticks: pd.DataFrame, robot: Robot, arms: Iterable[str]
) -> pd.DataFrame:
    """Return the chains of many runs as a table, with a row for each run and signal that differs.

    Rows are sorted by run, then in the robot's order. arm is "" if the signal belongs to no arm.
    differs_in and leaves_in name the number that was first. A time is -1 for never; left_ms, from
    leaves_ms to harm_ms, is NaN if either is missing.
    """
    harm = np.full(len(results), -1)
    for hazard, column in HARMS.items():
        harm = np.where(results["hazard"].astype(str) == hazard, results[column], harm)
    parts, run = [], np.arange(len(results))
    columns = {str(name): ticks[name].to_numpy() for name in ticks}
    for place, one in enumerate(list_signals(columns, robot, arms)):
        names, differing = np.array([*one.channels, ""], object), one.differs >= 0
        arm, _, seam = one.name.rpartition("/")
        shows = one.leaves >= 0
        own = {
            "run_id": columns["run_id"],
            "index": columns["index"],
            "layer": one.layer,
            "arm": arm,
            "seam": seam,
            "differs_ms": one.differs,
            "differs_in": names[one.differing],
            "leaves_ms": one.leaves,
            "leaves_in": names[np.where(shows, one.leaving, -1)],
            "harm_ms": harm,
            "left_ms": np.where(shows & (harm >= 0), harm - one.leaves, np.nan),
        }
        parts.append(pd.DataFrame(own | {"run": run, "place": place}).loc[differing])
    whole = pd.concat(parts, ignore_index=True).sort_values(
        ["run", "place"], kind="stable", ignore_index=True
    )
    return whole.drop(columns=["run", "place"])


def _link(one: SignalTicks, harm: int) -> ChainLink:
    # One signal of the chain: when it first differed, and when it left its normal range.
    leaves = int(one.leaves[0])
    return ChainLink(
        one.layer,
        one.name,
        one.meaning,
        int(one.differs[0]),
        one.channels[int(one.differing[0])],
        leaves,
        one.channels[int(one.leaving[0])] if leaves >= 0 else "",
        harm - leaves if harm >= 0 and leaves >= 0 else None,
    )


def _checks(row: Mapping[str, Any], ticks: Mapping[str, Any], robot: Robot) -> list[NearCheck]:
    # Checks that the fault brought nearer to their limit than the golden run, or tripped.
    out = []
    for name in (column.removeprefix(NEAR) for column in ticks if str(column).startswith(NEAR)):
        margin, golden = float(ticks[f"{NEAR}{name}"]), float(ticks[f"{GOLDEN_NEAR}{name}"])
        tripped, check = int(row[f"check_{name}_first_ms"]), robot.check(name)
        if (math.isfinite(margin) and margin < golden) or tripped >= 0:
            ms = int(ticks[f"{NEAR_MS}{name}"])
            out.append(NearCheck(name, check.unit, margin, golden, ms, tripped, check.does))
    return out


def _stacked(ticks: Mapping[str, Any], names: Sequence[str], runs: int) -> np.ndarray:
    """Return columns as int32 [columns, runs]; missing columns mean never."""
    columns = [np.broadcast_to(ticks.get(name, -1), runs) for name in names]
    return np.stack(columns).astype(np.int32)


def _late(ticks: np.ndarray) -> np.ndarray:
    return np.where(ticks < 0, NEVER, ticks)


def earliest_time(ticks: np.ndarray) -> np.ndarray:
    """Return the first of several times, [.., runs] -> [runs]; -1 is never."""
    first = _late(ticks).min(axis=0)
    return np.where(first == NEVER, -1, first)
