"""Holds what both scenarios of the targeted attacks share: runs counted by cell, packets, levers,
variants of open questions, and statements of the publication's text.

A cell is one fault (a value and a duration). Its runs differ in the packet at which the fault
starts. Values, durations and onsets are a fixed grid, so a predicted share has no interval. The
length of a packet was not published. Packets here last as on a recorded arm, and results for other
lengths are shown beside them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign import plan
from ravenjax.campaign.file.config import CampaignConfig, validate_tables
from ravenjax.campaign.plan import Plan
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import of_raven
from ravenjax.robots.raven2.campaign.program import PACKET_KEY, PACKETS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.stages import packet_clock
from ravenjax.store import manifest
from ravenjax.store.folder import read_all
from studies.study import Line, StudyEstimate, Table

DURATIONS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Durations of a fault in packets, in both scenarios."""


def inside(ended: np.ndarray, start: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Return whether a first jump counts if the published analysis only looks at packets t1 to t1 +
    d + 1.

    `ended`: packet that ends the second long step, as the monitor notes it, 0 for never. The jump's
    own packet is two earlier. `start`, `duration`: in packets.
    """
    packet = np.asarray(ended) - 2
    return (
        (np.asarray(ended) > 0) & (packet >= start) & (packet <= np.asarray(start) + duration + 1)
    )


def means(value: np.ndarray, duration: np.ndarray, hit: np.ndarray) -> pd.DataFrame:
    """Return the share of runs with `hit` (bool [n]) in each cell: a row per value of the fault, a
    column per duration, both ascending.
    """
    return pd.Series(np.asarray(hit, float)).groupby([value, duration]).mean().unstack()


def rate(cells: np.ndarray) -> StudyEstimate:
    """Return the mean of the cells' shares [n], in %."""
    return StudyEstimate(100.0 * float(cells.mean()), n=len(cells), of="cells of a fixed grid")


class Bias(NamedTuple):
    """Signs of the differences, prediction minus publication."""

    above: int
    below: int
    # Two-sided p-value of the split under fair signs; 1 if there is no difference.
    p: float

    @property
    def words(self) -> str:
        """Return the split in words."""
        return f"{self.above} above, {self.below} below"


def bias(predicted: np.ndarray, published: np.ndarray, reading_error: float = 0.0) -> Bias:
    """Apply the exact sign test. A difference within the reading error of the publication does not
    count.
    """
    from scipy.stats import binomtest

    apart = np.asarray(predicted, float) - np.asarray(published, float)
    above, below = int((apart > reading_error).sum()), int((apart < -reading_error).sum())
    p = float(binomtest(above, above + below).pvalue) if above + below else 1.0
    return Bias(above, below, p)


LEVERS = ("suture_110mm", "suture_145mm", "suture_180mm")
"""Variants with the stitches of the baseline, and the insertion drawn back at the start."""


def lever(config: CampaignConfig, rows: np.ndarray) -> str:
    """Return the lever of the gold arm's desired tip at these rows of the motion, in words.

    It is the distance from the first axis, which is the z axis of the arm's frame 0.
    """
    tips = desired_tip(config)[np.asarray(rows, int)]
    distance = np.hypot(tips[:, 0], tips[:, 1]) * 1e3
    low, high = f"{distance.min():.0f}", f"{distance.max():.0f}"
    return f"{low} mm" if low == high else f"{low}-{high} mm"


def desired_tip(config: CampaignConfig) -> np.ndarray:
    """Return the position that the operator wants for the gold tip, [ms, 3] m in frame 0."""
    from ravenjax.numbers.lazy import jax

    raven = of_raven(config)
    motion = hands.operator_motion(raven)
    with jax.enable_x64(True):
        start = kinematics.forward_pose(
            "gold", Vec(np.float64(q) for q in motion.start_jpos[0])
        ).position
    axes = np.array(ITP_AXES["gold"], float)
    return (
        np.array([float(x) for x in start])
        + motion.position_um[:, 0] @ axes.T * raven.operator.scale * 1e-6
    )


CYCLES = "network.cycles_per_packet"


@dataclasses.dataclass(frozen=True, eq=False)
class PacketTicks:
    """Ticks at which packets arrive in the runs of a campaign, in its order, as if nothing ever
    stopped them. Packets count from 1.
    """

    ticks: np.ndarray  # int32 [runs, packets], ascending
    # True if a packet holds the hand's place at its tick. Otherwise each packet holds the next row
    # of the motion.
    by_time: bool

    def packet(self, index: np.ndarray, tick: np.ndarray) -> np.ndarray:
        """Return the number of the newest packet in run `index` [n] at `tick` [n] (ms); 0 if the
        tick is negative.
        """
        return np.array(
            [
                np.searchsorted(self.ticks[row], t, side="right")
                for row, t in zip(index, tick, strict=True)
            ],
            int,
        )

    def motion_row(self, index: np.ndarray, packet: np.ndarray) -> np.ndarray:
        """Return the row of the motion, one row per ms, from which packet `packet` [n] of run
        `index` [n] is made.
        """
        place = np.asarray(packet, int) - 1
        return self.ticks[index, place] if self.by_time else place


def packet_ticks_of(ready: Plan) -> PacketTicks:
    """Return the packet ticks of a planned campaign. Raises ValueError if its runs have several
    distributions.
    """
    runs, length = ready.runs, ready.config.campaign.ticks
    if PACKETS in ready.varied:
        raise ValueError(f"expected one distribution of packets for all runs, got varied {PACKETS}")
    if PACKET_KEY not in ready.varied:
        return regular(runs, length, _cycles(ready))
    return drawn(of_raven(ready.config).campaign.packet_shares, ready.varied[PACKET_KEY], length)


def regular(runs: int, length: int, cycles: int = 1) -> PacketTicks:
    """Return the ticks of `runs` runs of `length` ms in which each packet lasts `cycles`."""
    ticks = np.arange(0, length, cycles, dtype=np.int32)
    return PacketTicks(np.broadcast_to(ticks, (runs, len(ticks))), by_time=False)


def drawn(shares: tuple[float, ...], keys: np.ndarray, length: int) -> PacketTicks:
    """Return the ticks of runs with these packet keys (uint32 [runs]) and lengths that have
    `shares`, for `length` ms.
    """
    packets = jnp.arange(length, dtype=jnp.int32)  # upper bound for the number of packets
    cycles = packet_clock.packet_length(
        (shares,), np.int32(0), jnp.asarray(keys)[:, None], packets[None, :]
    )
    after = np.cumsum(np.asarray(cycles), axis=1, dtype=np.int32)
    ticks = np.concatenate([np.zeros((len(keys), 1), np.int32), after[:, :-1]], axis=1)
    return PacketTicks(ticks[:, : int((ticks < length).sum(axis=1).max())], by_time=True)


def _cycles(ready: Plan) -> int:
    axis = ready.config.parameters.get(CYCLES)
    return 1 if axis is None else int(axis.values[0])


@dataclasses.dataclass(frozen=True, eq=False)
class VariantRuns:
    """One variant. Arrays have one entry per faulty run."""

    name: str
    config: CampaignConfig
    lever: str  # of the desired tip, over the packets at which faults start
    index: np.ndarray  # row of the campaign
    value: np.ndarray  # DAC counts, or displacement in um
    duration: np.ndarray  # packets
    start: np.ndarray  # packet
    jump_packet: np.ndarray  # packet that ends the first jump's second long step, 0: none
    # Bool: jump, inside (the published window), stop, ik, missed (jump without a stop).
    hits: Mapping[str, np.ndarray]

    def counting(self, **hits: np.ndarray) -> VariantRuns:
        """Return the same runs with further columns to count."""
        return dataclasses.replace(self, hits={**self.hits, **hits})

    def share(self, hit: str) -> pd.DataFrame:
        """Return the share of runs with `hit` in each cell."""
        return means(self.value, self.duration, self.hits[hit])

    def percent(self, hit: str) -> np.ndarray:
        """Return the rate over the cells of each duration, in its order."""
        return 100.0 * self.share(hit).to_numpy().mean(axis=0)


def read_runs(name: str, folder: Path) -> VariantRuns:
    """Read the runs of a finished folder."""
    config = validate_tables(manifest.read_manifest(folder).config)
    return runs_of(name, config, read_all(folder), packet_ticks_of(plan.make_plan(config)))


def runs_of(
    name: str, config: CampaignConfig, table: pd.DataFrame, packets: PacketTicks
) -> VariantRuns:
    """Return the valid faulty rows of a result table. A displacement's value is the group's,
    because its slots hold shares of it.
    """
    columns = {str(column): table[column].to_numpy() for column in table.columns}
    has_fault, valid = columns["fault0_site"] != "", columns["failed"] == ""
    faulty = np.flatnonzero(has_fault & valid)
    rows = faulty[np.argsort(columns["index"][faulty])]
    rejected = columns["check_ik_reject_count"]
    free = rejected[~has_fault & valid].max(initial=0)
    start, duration = columns["fault0_start_ms"][rows], columns["fault0_duration_ms"][rows]
    index, jump = columns["index"][rows], columns["jump_code"][rows].astype(bool)
    ended = packets.packet(index, columns["jump_code_first_ms"][rows])
    stop = columns["response"][rows] == "stopped"
    value = [
        _displacement(g, v)
        for g, v in zip(columns["group"][rows], columns["fault0_value"][rows], strict=True)
    ]
    return VariantRuns(
        name=name,
        config=config,
        lever=lever(config, np.unique(packets.motion_row(index, start))),
        index=index,
        value=np.array(value),
        duration=duration,
        start=start,
        jump_packet=ended,
        hits={
            "jump": jump,
            "inside": inside(ended, start, duration),
            "stop": np.asarray(stop, bool),
            "ik": rejected[rows] > free,
            "missed": jump & ~np.asarray(stop, bool),
        },
    )


def _displacement(group: str, value: float) -> float:
    return float(group[1:]) if group[:1] == "d" and group[1:].isdecimal() else float(value)


def stored(value: float, words: str = "wrap") -> int:
    """Return what is left of an added DAC value after storage, without the small nominal
    command.
    """
    whole = int(value)
    if words == "wrap":
        return (whole + 32768) % 65536 - 32768
    return max(-32768, min(32767, whole)) if words == "saturate" else whole


DECLARED = "as_declared"
"""The variant whose baseline was declared before packets were measured."""


SENSITIVITY_NOTE = (
    "Points are means over all cells of the fixed grid, each variant's cell against the same cell"
    " of the baseline. A cell changes where at least half of its runs come out the other way."
)

INSIDE = "jumps only inside t1 .. t1 + d + 1"
"""The published window of a fault that begins in packet t1 and lasts d packets."""


class VariantCase(NamedTuple):
    """One way to answer the open questions."""

    runs: VariantRuns
    question: str
    hit: str = "jump"  # column of the runs that is counted
    label: str = ""  # label, if it differs from the variant's name

    @property
    def name(self) -> str:
        """Return the name used in tables."""
        return self.label or self.runs.name


def other_jump_rules(base: VariantRuns, leaps: np.ndarray) -> list[VariantCase]:
    """Return the baseline's own runs with other rules for a jump. `leaps`: bool [runs], by the
    text's rule.
    """
    return [
        VariantCase(base, INSIDE, "inside", "inside_window"),
        VariantCase(
            base.counting(leap=leaps),
            "text's rule: the tip moves over 1 mm within two packets",
            "leap",
            "jump_text",
        ),
    ]


def shifts(case: VariantCase, baseline: VariantRuns, hit: str = "jump") -> tuple[float, int]:
    """Return the mean difference to the baseline over all cells, in points, and the number of cells
    that change sides.

    Return NaN and 0 if the two have different numbers of cells.
    """
    cells, base = case.runs.share(case.hit), baseline.share(hit)
    if cells.shape != base.shape:
        return math.nan, 0
    # Values in the order of their magnitude, as some variants have the other sign.
    first, second = (one.to_numpy()[np.argsort(np.abs(one.index))] for one in (cells, base))
    return 100.0 * float((first - second).mean()), int(((first >= 0.5) != (second >= 0.5)).sum())


def sensitivity_table(
    title: str,
    cases: Sequence[VariantCase],
    baseline: VariantRuns,
    published: np.ndarray | None = None,
    bands: Sequence[tuple[float, float]] | None = None,
    reading_error: float = 0.0,
    hit: str = "jump",
    note: str = "",
) -> Table:
    """Return a table of percent by duration for each case, with its distance from the baseline and,
    if given, from the publication.
    """
    heads = [
        "variant",
        "open question answered otherwise",
        "lever",
        *(f"{d} packets" for d in DURATIONS),
    ]
    heads += ["cells changed", "points from baseline"]
    if published is not None:
        heads += ["points from publication", "above / below", "sign test p"]
    if bands is not None:
        heads += ["in band"]
    rows = []
    if published is not None:
        rows.append(
            (
                "published",
                "",
                "",
                *(round(float(p), 1) for p in published),
                *("",) * (len(heads) - 11),
            )
        )
    for case in cases:
        percent = case.runs.percent(case.hit)
        apart, changed = shifts(case, baseline, hit)
        row: list[str | int | float] = [case.name, case.question, case.runs.lever]
        row += [round(float(p), 1) for p in percent]
        row += [changed, _points(apart)]
        if published is not None:
            sign = bias(percent, published, reading_error)
            row += [
                f"{float(np.mean(percent - published)):+.1f}",
                f"{sign.above} / {sign.below}",
                round(sign.p, 3),
            ]
        if bands is not None:
            inside = sum(b[0] <= p <= b[1] for p, b in zip(percent, bands, strict=True))
            row += [f"{inside} of {len(bands)}"]
        rows.append(tuple(row))
    return Table(title, tuple(heads), tuple(rows), note)


def _points(apart: float) -> str:
    if math.isnan(apart):
        return ""
    points = round(apart, 1)
    return f"{points:+.1f}" if points else "0"


SMALL_COUNTS = 800
"""DAC counts within which the nominal shoulder command stays on the published trajectory (comment
in the fork's code).
"""
LARGE_COUNTS = 10000
"""DAC counts that the fork's own check allows for the shoulder."""


HOLDS = " (1: holds)"
"""Ending of a statement's quantity."""


def holds(quantity: str, published: bool | None, predicted: bool, reason: str) -> Line:
    """Return a statement as a line: 1 if it holds, 0 if not. `published`: whether the published
    counts support it; None without counts.
    """
    stated = StudyEstimate(
        1.0,
        of="stated" if published is None else f"stated; in the published counts: {int(published)}",
    )
    return Line(
        f"{quantity}{HOLDS}", "", stated, StudyEstimate(float(predicted)), (1.0, 1.0), "", reason
    )


def scenario_b(
    runs: VariantRuns, moved: np.ndarray, jumps: np.ndarray, stops: np.ndarray
) -> tuple[Line, ...]:
    """Return the four statements on scenario B.

    `moved`: [runs] largest step of motor velocity in the window, divided by its fault-free 99.9 %
    threshold. `jumps`, `stops`: published percent by duration.
    """
    size, duration = np.abs([stored(value) for value in runs.value]), runs.duration
    jumped = runs.hits["jump"]
    affected = jumped | runs.hits["stop"]
    small = (size <= SMALL_COUNTS) & (duration <= 64)
    short = (size <= LARGE_COUNTS) & ((duration == 2) | (duration == 4))
    disturbed = float((moved[short] > 1.0).mean())
    return (
        holds(
            "small DAC errors have no effect unless held longer than 64 ms",
            None,
            not affected[small].any(),
            f"{int(affected[small].sum())} of {int(small.sum())} runs of up to {SMALL_COUNTS}"
            " counts and 64 packets jump or stop",
        ),
        holds(
            "2-4 ms bursts disturb motor velocity but not positions, unless large",
            None,
            disturbed > 0.5 and not jumped[short].any(),
            f"of runs of up to {LARGE_COUNTS} counts and 2 or 4 packets {100 * disturbed:.0f} %"
            " move the motor velocity beyond its fault-free 99.9 percentile,"
            f" {100 * jumped[short].mean():.0f} % jump",
        ),
        *of_attack(runs, jumps, stops),
    )


def of_attack(
    runs: VariantRuns, jumps: np.ndarray | None = None, stops: np.ndarray | None = None
) -> tuple[Line, ...]:
    """Return the two statements on either scenario. `jumps`, `stops`: published percent by
    duration, None if withheld.
    """
    jumped, stopped, missed = (runs.percent(hit) for hit in ("jump", "stop", "missed"))
    window = np.isin(DURATIONS, (2, 4, 8, 16))
    open_at = [d for d, share in zip(DURATIONS, missed, strict=True) if share > 0]
    lower = opened = None
    beside = ""
    if jumps is not None and stops is not None:
        lower = bool((stops <= jumps).all())
        opened = bool((jumps[window] > 0).all())
        beside = f"; published {_listed(stops - jumps)}"
    return (
        holds(
            "P(RAVEN detects) is lower than P(impact) at every duration",
            lower,
            bool((stopped <= jumped).all()),
            f"E-stop minus jump by duration, points: predicted {_listed(stopped - jumped)}{beside}",
        ),
        holds(
            "the attacker's undetected window is 2-16 ms",
            opened,
            bool((missed[window] > 0).all()),
            "counted as: at each of 2, 4, 8 and 16 packets some runs jump without an E-stop;"
            f" predicted for {', '.join(map(str, open_at)) or 'no'} packets, by duration"
            f" {_listed(missed)} %",
        ),
    )


def verdict(scenario: str, lines: Sequence[Line]) -> str:
    """Say how a scenario's results compare with the text's statements. Lines without a verdict do
    not count.
    """
    judged = [line for line in lines if line.passed is not None]
    fail = [line.quantity.removesuffix(HOLDS) for line in judged if not line.passed]
    if not fail:
        return (
            f"{scenario} is as the text states it: {len(judged)} of {len(judged)} statements hold."
        )
    return (
        f"{scenario} is not reproduced: {len(judged) - len(fail)} of {len(judged)} statements hold."
        f" The prediction contradicts that {'; that '.join(fail)}."
    )


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.0f}" for x in numbers)
