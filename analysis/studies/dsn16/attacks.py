"""Contains the common code of both studies of the targeted attacks (DSN 2016): counts of runs by
cell, packets, variants for details that were not published, and tests of statements in the
publication.

A cell is one fault (a value and a duration). Its runs differ in the packet at which the fault
starts. Values, durations and starts are a fixed grid, so a predicted share has no interval. The
length of a packet was not published. The baseline uses the packet lengths of a recorded arm, and
variants use other lengths.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign import plan
from ravenjax.campaign.file.config import CampaignConfig, validate_tables
from ravenjax.campaign.plan import Plan
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import of_raven
from ravenjax.robots.raven2.campaign.program import PACKET_KEY, PACKETS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.stages import packet_clock
from ravenjax.store import manifest
from ravenjax.store.folder import read_all
from studies.study import Line, StudyEstimate

DURATIONS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Durations of a fault in packets, in both scenarios."""


def inside(ended: pd.Series, start: pd.Series, duration: pd.Series) -> pd.Series:
    """Return whether a first jump counts if the published analysis only looks at packets t1 to t1 +
    d + 1.

    `ended`: packet that ends the second long step, as the monitor notes it, 0 for never. The jump's
    own packet is two earlier. `start`, `duration`: in packets.
    """
    return (ended > 0) & (ended - 2).between(start, start + duration + 1)


def rate(cells: pd.DataFrame | pd.Series) -> StudyEstimate:
    """Return the mean of the cells' shares, in %."""
    shares = cells.to_numpy().ravel()
    return StudyEstimate(100.0 * float(shares.mean()), n=len(shares), of="cells of a fixed grid")


def bias(
    predicted: np.ndarray, published: np.ndarray, reading_error: float = 0.0
) -> tuple[int, int, float]:
    """Return how many predictions are above and below the publication, and the two-sided p-value of
    the exact sign test; 1 if there is no difference.

    A difference within the reading error of the publication does not count.
    """
    from scipy.stats import binomtest

    apart = predicted - published
    above, below = int((apart > reading_error).sum()), int((apart < -reading_error).sum())
    return above, below, float(binomtest(above, above + below).pvalue) if above + below else 1.0


LEVERS = ("suture_110mm", "suture_145mm", "suture_180mm")
"""Variants with the stitches of the baseline, and the insertion drawn back at the start."""


def lever(config: CampaignConfig, rows: np.ndarray) -> str:
    """Return the lever of the gold arm's desired tip at these rows of the motion, in words.

    It is the distance from the first axis, which is the z axis of the arm's frame 0.
    """
    raven = of_raven(config)
    motion = hands.operator_motion(raven)
    with jax.enable_x64(True):
        start = Vec(np.float64(q) for q in motion.start_jpos[0])
        tip = [float(x) for x in kinematics.forward_pose("gold", start).position]
    moved = motion.position_um[rows, 0] @ np.array(ITP_AXES["gold"], float).T
    distance = np.hypot(*(tip + moved * raven.operator.scale * 1e-6)[:, :2].T) * 1e3
    return "-".join(dict.fromkeys(f"{end:.0f}" for end in (distance.min(), distance.max()))) + " mm"


CYCLES = "network.cycles_per_packet"


class PacketTicks(NamedTuple):
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
        pairs = zip(self.ticks[index], tick, strict=True)
        return np.array([np.searchsorted(ticks, at, side="right") for ticks, at in pairs], int)

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
        axis = ready.config.parameters.get(CYCLES)
        return regular(runs, length, 1 if axis is None else int(axis.values[0]))
    shares = of_raven(ready.config).campaign.packet_shares
    keys = jnp.asarray(ready.varied[PACKET_KEY])[:, None]
    # `length` packets are at least as many as there can be.
    packets = jnp.arange(length, dtype=jnp.int32)[None, :]
    cycles = packet_clock.packet_length((shares,), np.int32(0), keys, packets)
    after = np.cumsum(np.asarray(cycles), axis=1, dtype=np.int32)
    ticks = np.concatenate([np.zeros((runs, 1), np.int32), after[:, :-1]], axis=1)
    return PacketTicks(ticks[:, : int((ticks < length).sum(axis=1).max())], by_time=True)


def regular(runs: int, length: int, cycles: int = 1) -> PacketTicks:
    """Return the ticks of `runs` runs of `length` ms in which each packet lasts `cycles`."""
    ticks = np.arange(0, length, cycles, dtype=np.int32)
    return PacketTicks(np.broadcast_to(ticks, (runs, len(ticks))), by_time=False)


@dataclasses.dataclass(frozen=True, eq=False)
class VariantRuns:
    """One variant."""

    name: str
    config: CampaignConfig
    lever: str  # of the desired tip, over the packets at which faults start
    # A row per faulty run, in the campaign's order: index, value (DAC counts, or displacement in
    # um), duration and start (packets), jump_packet (packet that ends the first jump's second long
    # step, 0: none). Bool: jump, inside (the published window), stop, ik, missed (jump without a
    # stop).
    frame: pd.DataFrame

    def share(self, hit: str) -> pd.DataFrame:
        """Return the share of runs with `hit` in each cell: a row per value of the fault, a column
        per duration, both ascending.
        """
        hits = self.frame[hit].astype(float)
        return hits.groupby([self.frame["value"], self.frame["duration"]]).mean().unstack()

    def percent(self, hit: str) -> np.ndarray:
        """Return the rate over the cells of each duration, in its order."""
        return 100.0 * self.share(hit).to_numpy().mean(axis=0)

    def counting(self, **hits: np.ndarray) -> "VariantRuns":
        """Return the same runs with further columns to count."""
        return dataclasses.replace(self, frame=self.frame.assign(**hits))


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
    valid = table.loc[table["failed"] == ""].sort_values("index")
    faulty = valid["fault0_site"] != ""
    free = valid.loc[~faulty, "check_ik_reject_count"].max() if not faulty.all() else 0
    runs = valid.loc[faulty].reset_index(drop=True)
    index, start, duration = (runs[n] for n in ("index", "fault0_start_ms", "fault0_duration_ms"))
    displacement = runs["group"].astype(str).str.extract(r"^d(\d+)$")[0].astype(float)
    ended = pd.Series(packets.packet(index.to_numpy(), runs["jump_code_first_ms"]))
    jump, stop = runs["jump_code"].astype(bool), runs["response"] == "stopped"
    return VariantRuns(
        name,
        config,
        lever(config, np.unique(packets.motion_row(index, start))),
        pd.DataFrame(
            {
                "index": index,
                "value": displacement.fillna(runs["fault0_value"]),
                "duration": duration,
                "start": start,
                "jump_packet": ended,
                "jump": jump,
                "inside": inside(ended, start, duration),
                "stop": stop,
                "ik": runs["check_ik_reject_count"] > free,
                "missed": jump & ~stop,
            }
        ),
    )


def stored(value: float) -> int:
    """Return what is left of an added DAC value after storage in 16 bits, without the small nominal
    command.
    """
    return (int(value) + 32768) % 65536 - 32768


DECLARED = "as_declared"
"""The variant whose baseline was declared before packets were measured."""

INSIDE = "jumps only inside t1 .. t1 + d + 1"
"""The published window of a fault that begins in packet t1 and lasts d packets."""


class VariantCase(NamedTuple):
    """One way to answer the open questions."""

    runs: VariantRuns
    question: str = ""
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
    text = "text's rule: the tip moves over 1 mm within two packets"
    return [
        VariantCase(base, INSIDE, "inside", "inside_window"),
        VariantCase(base.counting(leap=leaps), text, "leap", "jump_text"),
    ]


def shifts(case: VariantCase, baseline: VariantRuns, hit: str) -> tuple[float, int]:
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


def sensitivity_rows(
    cases: Sequence[VariantCase],
    hit: str = "jump",
    published: np.ndarray | None = None,
    bands: Sequence[tuple[float, float]] = (),
    reading_error: float = 0.0,
) -> Iterator[tuple[str | int | float, ...]]:
    """Yield percent by duration for each case, with its distance from the first one and, if given,
    from the publication.
    """
    if published is not None:
        blanks = ("",) * (5 + bool(bands))
        yield "published", "", "", *(round(float(p), 1) for p in published), *blanks
    for case in cases:
        percent = case.runs.percent(case.hit)
        apart, changed = shifts(case, cases[0].runs, hit)
        points = "" if math.isnan(apart) else f"{apart:+.1f}" if round(apart, 1) else "0"
        row: list[str | int | float] = [case.name, case.question, case.runs.lever]
        row += [*(round(float(p), 1) for p in percent), changed, points]
        if published is not None:
            above, below, p = bias(percent, published, reading_error)
            mean = float(np.mean(percent - published))
            row += [f"{mean:+.1f}", f"{above} / {below}", round(p, 3)]
        if bands:
            fits = sum(low <= p <= high for p, (low, high) in zip(percent, bands, strict=True))
            row.append(f"{fits} of {len(bands)}")
        yield tuple(row)


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
    of = "stated" if published is None else f"stated; in the published counts: {int(published)}"
    found, stated = StudyEstimate(float(predicted)), StudyEstimate(1.0, of=of)
    return Line(f"{quantity}{HOLDS}", "", stated, found, (1.0, 1.0), reason=reason)


def scenario_b(
    runs: VariantRuns, moved: np.ndarray, jumps: np.ndarray, stops: np.ndarray
) -> tuple[Line, ...]:
    """Return the four statements on scenario B.

    `moved`: [runs] largest step of motor velocity in the window, divided by its fault-free 99.9 %
    threshold. `jumps`, `stops`: published percent by duration.
    """
    size, duration, jumped = (
        runs.frame["value"].map(stored).abs(),
        *(runs.frame[name] for name in ("duration", "jump")),
    )
    small = (jumped | runs.frame["stop"])[(size <= SMALL_COUNTS) & (duration <= 64)]
    short = (size <= LARGE_COUNTS) & duration.isin((2, 4))
    disturbed = float((moved[short] > 1.0).mean())
    return (
        holds(
            "small DAC errors have no effect unless held longer than 64 ms",
            None,
            not small.any(),
            f"{int(small.sum())} of {len(small)} runs of up to {SMALL_COUNTS} counts and 64 packets"
            " jump or stop",
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
    open_at = ", ".join(str(d) for d, share in zip(DURATIONS, missed, strict=True) if share > 0)
    lower, opened, beside = None, None, ""
    if jumps is not None and stops is not None:
        lower, opened = bool((stops <= jumps).all()), bool((jumps[window] > 0).all())
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
            f" predicted for {open_at or 'no'} packets, by duration {_listed(missed)} %",
        ),
    )


def verdict(scenario: str, lines: Sequence[Line]) -> str:
    """Say how a scenario's results compare with the text's statements."""
    fail = [line.quantity.removesuffix(HOLDS) for line in lines if not line.passed]
    held = f"{len(lines) - len(fail)} of {len(lines)} statements hold."
    if not fail:
        return f"{scenario} is as the text states it: {held}"
    return (
        f"{scenario} is not reproduced: {held} The prediction contradicts that"
        f" {'; that '.join(fail)}."
    )


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.0f}" for x in numbers)
