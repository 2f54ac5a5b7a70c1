"""Computes when the fault of one run first changed each signal, on its way to the failure.

A *signal* is a seam of the robot's tick, on one arm. For each signal the result contains the tick
in which the signal first differs from the golden run, and the tick in which it leaves its normal
range. After it has left this range, the fault is *visible* in the signal. A signal with several
numbers has the earliest tick of its numbers.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.outcomes import verdict
from ravenjax.report import wording
from ravenjax.vocabulary import seams
from ravenjax.vocabulary.robot import Robot

Columns = Mapping[str, Any]
"""Columns of a table as arrays [runs], or numbers of one run."""
NEVER = np.iinfo(np.int32).max
"""Replaces -1, which means never, where the earliest of several times is computed."""
HARMS = {
    "unintended motion": "unintended_first_ms",
    "loss of motion": "loss_first_ms",
    "false report": "false_report_first_ms",
}
"""Hazard -> column of the result table with the time at which the hazard began."""


class SignalTicks(NamedTuple):
    """Times at which one signal changed in some runs, arrays [runs] in ms; -1: never."""

    name: str  # such as gold/mpos
    layer: str  # in words
    meaning: str
    differs: np.ndarray
    leaves: np.ndarray
    first_differing: np.ndarray  # index into `channels` of the number that differed first
    first_leaving: np.ndarray  # index into `channels` of the number that left its range first
    channels: tuple[str, ...]
    has_range: bool  # True if any of its numbers has a normal range


class ChainLink(NamedTuple):
    """One signal of a chain. Times are in ms since the run began; -1: never."""

    layer: str
    signal: str
    meaning: str
    differs_ms: int
    differs_in: str  # name of the number that differed first, or ""
    leaves_ms: int
    leaves_in: str
    left_ms: int | None  # time from leaving the normal range to harm; None if either is missing


class NearCheck(NamedTuple):
    """How close a check came to its limit before harm."""

    check: str
    unit: str
    margin: float  # least distance to the limit until harm; 0 or less means that it tripped
    golden: float  # the golden run's margin until the same tick
    ms: int  # time of the least margin
    tripped_ms: int  # first trip in the whole run; -1: never
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
    harm_ms: int  # time at which the hazard began; -1 if it has none, or one without a moment
    links: Sequence[ChainLink]  # signals that differ, in the robot's order
    # Checks that tripped, or came nearer to their limit than in the golden run.
    checks: Sequence[NearCheck]

    @property
    def first(self) -> ChainLink | None:
        """Return the first signal that became visible, or None; the robot's order decides ties."""
        visible = [link for link in self.links if link.leaves_ms >= 0]
        return min(visible, key=lambda link: link.leaves_ms, default=None)


def list_signals(ticks: Columns, robot: Robot, arms: Iterable[str]) -> list[SignalTicks]:
    """Return the times of every signal, in the robot's order.

    ticks: columns of the table of explained runs, as arrays [runs] or numbers of one run.
    """
    runs = np.size(ticks["run_id"])
    by_signal: dict[str, list[seams.Crossing]] = {}
    for crossing in seams.list_crossings(robot.seams, arms):
        by_signal.setdefault(crossing.signal, []).append(crossing)
    signals = []
    for name, crossings in by_signal.items():
        differs, leaves = (
            # A column that the table lacks means never.
            np.stack(
                [np.broadcast_to(ticks.get(prefix + one.name, -1), runs) for one in crossings]
            ).astype(np.int32)
            for prefix in (seams.DIFFERS, seams.LEAVES)
        )
        seam = crossings[0].seam
        signals.append(
            SignalTicks(
                name=name,
                layer=robot.layers[seam.layer],
                meaning=seam.meaning,
                differs=earliest_time(differs),
                leaves=earliest_time(leaves),
                first_differing=_replace_never(differs).argmin(axis=0),
                first_leaving=_replace_never(leaves).argmin(axis=0),
                channels=tuple(crossing.channel.name for crossing in crossings),
                has_range=any(f"{seams.LEAVES}{crossing.name}" in ticks for crossing in crossings),
            )
        )
    return signals


def trace_chain(row: Columns, ticks: Columns, robot: Robot, arms: Iterable[str], cue: int) -> Chain:
    """Return one run's chain, from its rows of results and explained runs. cue: number of a set."""
    hazard, cue_column = str(row["hazard"]), f"cue{cue}_first_ms"
    harm = int(row[HARMS[hazard]]) if hazard in HARMS else -1
    signals = list_signals(ticks, robot, arms)
    return Chain(
        run_id=str(row["run_id"]),
        index=int(row["index"]),
        group=str(row["group"]),
        fault=wording.describe_fault(dict(row), robot),
        verdict=str(row["verdict"] or row["failed"]),
        hazard=hazard,
        fault_ms=int(row["first_active_ms"]),
        cue_ms=int(verdict.beyond_golden(row[cue_column], row[f"golden_{cue_column}"])),
        told_ms=int(row["told_ms"]),
        harm_ms=harm,
        links=[_make_link(signal, harm) for signal in signals if signal.differs[0] >= 0],
        checks=_list_near_checks(row, ticks, robot),
    )


def chain_table(
    results: pd.DataFrame, ticks: pd.DataFrame, robot: Robot, arms: Iterable[str]
) -> pd.DataFrame:
    """Return the chains of many runs as a table, with a row for each run and signal that differs.

    Rows are sorted by run, then in the robot's order. arm is "" if the signal belongs to no arm.
    differs_in and leaves_in name the channel of the signal that was first. A time is -1 for never.
    left_ms, the remaining time from leaves_ms to harm_ms, is NaN if either is missing.
    """
    harm = np.full(len(results), -1)
    for hazard, column in HARMS.items():
        harm = np.where(results["hazard"].astype(str) == hazard, results[column], harm)
    tables, run_order = [], np.arange(len(results))
    columns = {str(name): ticks[name].to_numpy() for name in ticks}
    for order, signal in enumerate(list_signals(columns, robot, arms)):
        # The last name, at index -1, is that of no channel.
        names = np.array([*signal.channels, ""], object)
        arm, _, seam = signal.name.rpartition("/")
        is_visible = signal.leaves >= 0
        signal_columns = {
            "run_id": columns["run_id"],
            "index": columns["index"],
            "layer": signal.layer,
            "arm": arm,
            "seam": seam,
            "differs_ms": signal.differs,
            "differs_in": names[signal.first_differing],
            "leaves_ms": signal.leaves,
            "leaves_in": names[np.where(is_visible, signal.first_leaving, -1)],
            "harm_ms": harm,
            "left_ms": np.where(is_visible & (harm >= 0), harm - signal.leaves, np.nan),
        }
        rows = pd.DataFrame(signal_columns | {"run": run_order, "signal_order": order})
        tables.append(rows.loc[signal.differs >= 0])
    order = ["run", "signal_order"]
    table = pd.concat(tables).sort_values(order, kind="stable", ignore_index=True)
    return table.drop(columns=order)


def _make_link(signal: SignalTicks, harm: int) -> ChainLink:
    # Returns one signal of a single run's chain. harm: time of the run's harm in ms; -1: none.
    leaves = int(signal.leaves[0])
    return ChainLink(
        layer=signal.layer,
        signal=signal.name,
        meaning=signal.meaning,
        differs_ms=int(signal.differs[0]),
        differs_in=signal.channels[int(signal.first_differing[0])],
        leaves_ms=leaves,
        leaves_in=signal.channels[int(signal.first_leaving[0])] if leaves >= 0 else "",
        left_ms=harm - leaves if harm >= 0 and leaves >= 0 else None,
    )


def _list_near_checks(row: Columns, ticks: Columns, robot: Robot) -> list[NearCheck]:
    # Returns the checks that tripped, or came nearer to their limit than in the golden run.
    near = []
    columns = [column for column in ticks if str(column).startswith(seams.NEAR)]
    for column in columns:
        name = column.removeprefix(seams.NEAR)
        margin, golden = float(ticks[column]), float(ticks[f"{seams.GOLDEN_NEAR}{name}"])
        tripped, check = int(row[f"check_{name}_first_ms"]), robot.check(name)
        if (math.isfinite(margin) and margin < golden) or tripped >= 0:
            ms = int(ticks[f"{seams.NEAR_MS}{name}"])
            near.append(NearCheck(name, check.unit, margin, golden, ms, tripped, check.does))
    return near


def _replace_never(ticks: np.ndarray) -> np.ndarray:
    # Replaces -1, which means never, by a late time, so that the earliest time is the minimum.
    return np.where(ticks < 0, NEVER, ticks)


def earliest_time(ticks: np.ndarray) -> np.ndarray:
    """Return the first of several times in ms, [.., runs] -> [runs]; -1 means never."""
    first = _replace_never(ticks).min(axis=0)
    return np.where(first == NEVER, -1, first)
