"""Counts the runs of both studies of the targeted attacks (DSN 2016), and tests statements of the
publication.

A cell is one fault (a value and a duration). Its runs differ in the packet at which the fault
starts. The cells are a fixed grid, so a predicted share has no interval. The length of a packet was
not published: the baseline uses those of a recorded arm, and variants use others.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign import plan
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.plan import Plan
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import require_raven
from ravenjax.robots.raven2.campaign.program import PACKET_KEY, PACKETS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.stages import packet_clock
from ravenjax.store import manifest
from ravenjax.store.folder import read_all
from studies.study import Cell, Line, StudyEstimate

DURATIONS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Durations of a fault in packets, in both scenarios."""
CYCLES = "network.cycles_per_packet"
SMALL_COUNTS, LARGE_COUNTS = 800, 10_000
"""DAC counts of the shoulder on the published trajectory (comment in the fork's code), and the most
that the fork's own check allows.
"""
HOLDS = " (1: holds)"
"""Ending of a statement's quantity."""


def rate(cells: pd.DataFrame | pd.Series) -> StudyEstimate:
    """Return the mean of the cells' shares, in %."""
    shares = cells.to_numpy().ravel()
    return StudyEstimate(100.0 * float(shares.mean()), n=len(shares), of="cells of a fixed grid")


def bias(
    predicted: np.ndarray, published: np.ndarray, reading_error: float = 0.0
) -> tuple[int, int, float]:
    """Return how many predictions are above and below, beyond the reading error, and the sign p."""
    from scipy.stats import binomtest

    apart = predicted - published
    above, below = int((apart > reading_error).sum()), int((apart < -reading_error).sum())
    return above, below, float(binomtest(above, above + below).pvalue) if above + below else 1.0


def lever(config: CampaignConfig, rows: np.ndarray) -> str:
    """Return the distance of the gold arm's desired tip from its first axis at these rows."""
    raven = require_raven(config)
    motion = hands.operator_motion(raven)
    with jax.enable_x64(True):
        start = Vec(np.float64(q) for q in motion.start_jpos[0])
        tip = [float(x) for x in kinematics.forward_pose("gold", start).position]
    moved = motion.position_um[rows, 0] @ np.array(ITP_AXES["gold"], float).T
    distance = np.hypot(*(tip + moved * raven.operator.scale * 1e-6)[:, :2].T) * 1e3
    return "-".join(dict.fromkeys(f"{end:.0f}" for end in (distance.min(), distance.max()))) + " mm"


class PacketTicks(NamedTuple):
    """Ticks at which packets, counted from 1, arrive in the runs of a campaign if nothing stops."""

    ticks: np.ndarray  # int32 [runs, packets], ascending
    # A packet holds the hand's place at its tick; otherwise each holds the motion's next row.
    by_time: bool

    def packet(self, index: np.ndarray, tick: np.ndarray) -> np.ndarray:
        """Return the newest packet in run `index` [n] at `tick` [n]; 0 for a negative tick."""
        pairs = zip(self.ticks[index], tick, strict=True)
        return np.array([np.searchsorted(ticks, at, side="right") for ticks, at in pairs], int)

    def motion_row(self, index: np.ndarray, packet: np.ndarray) -> np.ndarray:
        """Return the row of the motion, one per ms, of packet `packet` [n] of run `index` [n]."""
        place = np.asarray(packet, int) - 1
        return self.ticks[index, place] if self.by_time else place


def packet_ticks_of(ready: Plan) -> PacketTicks:
    """Return the packet ticks of a campaign. Raises ValueError for several distributions."""
    runs, length = ready.runs, ready.config.campaign.ticks
    if PACKETS in ready.varied:
        raise ValueError(f"expected one distribution of packets for all runs, got varied {PACKETS}")
    if PACKET_KEY not in ready.varied:
        axis = ready.config.parameters.get(CYCLES)
        return regular(runs, length, 1 if axis is None else int(axis.values[0]))
    shares = require_raven(ready.config).campaign.packet_shares
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
    """The runs of one variant, or of one way to count them."""

    name: str
    config: CampaignConfig
    lever: str  # of the desired tip, over the packets at which faults start
    # A row per faulty run: index, value (DAC counts, or displacement in um), duration and start
    # (packets), jump_packet (packet that ends the first jump's second long step, 0: none). Bool:
    # jump, inside (the published window), stop, ik, missed (jump without a stop).
    frame: pd.DataFrame
    question: str = ""  # open question that it answers otherwise

    def share(self, hit: str) -> pd.DataFrame:
        """Return the share of runs with `hit` by value (rows) and duration (columns)."""
        hits = self.frame[hit].astype(float)
        return hits.groupby([self.frame["value"], self.frame["duration"]]).mean().unstack()

    def percent(self, hit: str) -> np.ndarray:
        """Return the rate over the cells of each duration, in its order."""
        return 100.0 * self.share(hit).to_numpy().mean(axis=0)

    def counting(self, jump: np.ndarray, name: str, question: str = "") -> "VariantRuns":
        """Return the same runs with another rule for a jump."""
        frame = self.frame.assign(jump=jump)
        return dataclasses.replace(self, frame=frame, name=name, question=question)


def read_runs(name: str, folder: Path, question: str = "") -> VariantRuns:
    """Read the runs of a finished folder."""
    config = validate_tables(manifest.read_manifest(folder).config)
    packets = packet_ticks_of(plan.make_plan(config))
    return runs_of(name, config, read_all(folder), packets, question)


def runs_of(
    name: str, config: CampaignConfig, table: pd.DataFrame, packets: PacketTicks, question: str = ""
) -> VariantRuns:
    """Return the valid faulty rows of a result table. A displacement's value is the group's."""
    valid = table.loc[table["failed"] == ""].sort_values("index")
    faulty = valid["fault0_site"] != ""
    free = valid.loc[~faulty, "check_ik_reject_count"].max() if not faulty.all() else 0
    runs = valid.loc[faulty].reset_index(drop=True)
    index, start, duration = (runs[n] for n in ("index", "fault0_start_ms", "fault0_duration_ms"))
    displacement = runs["group"].astype(str).str.extract(r"^d(\d+)$")[0].astype(float)
    ended = pd.Series(packets.packet(index.to_numpy(), runs["jump_code_first_ms"]))
    jump, stop = runs["jump_code"].astype(bool), runs["response"] == "stopped"
    columns = {
        "index": index,
        "value": displacement.fillna(runs["fault0_value"]),
        "duration": duration,
        "start": start,
        "jump_packet": ended,
        "jump": jump,
        # The packet of the jump is two before the one that ends its second step.
        "inside": (ended > 0) & (ended - 2).between(start, start + duration + 1),
        "stop": stop,
        "ik": runs["check_ik_reject_count"] > free,
        "missed": jump & ~stop,
    }
    at_start = lever(config, np.unique(packets.motion_row(index, start)))
    return VariantRuns(name, config, at_start, pd.DataFrame(columns), question)


def stored(value: float) -> int:
    """Return what 16 bits keep of an added DAC value, without the small nominal command."""
    return (int(value) + 32768) % 65536 - 32768


def other_jump_rules(base: VariantRuns, leaps: np.ndarray) -> list[VariantRuns]:
    """Return the baseline's runs with other rules for a jump. `leaps`: bool [runs], by the text."""
    window = "jumps only inside t1 .. t1 + d + 1"
    text = "text's rule: the tip moves over 1 mm within two packets"
    inside = base.frame["inside"].to_numpy()
    return [base.counting(inside, "inside_window", window), base.counting(leaps, "jump_text", text)]


def _shifts(one: VariantRuns, baseline: VariantRuns, hit: str) -> tuple[float, int]:
    """Return the mean difference to the baseline over all cells, in points, and the number of cells
    that change sides; NaN and 0 if the two have different numbers of cells.
    """
    cells, base = one.share(hit), baseline.share(hit)
    if cells.shape != base.shape:
        return math.nan, 0
    # Values in the order of their magnitude, as some variants have the other sign.
    first, second = (part.to_numpy()[np.argsort(np.abs(part.index))] for part in (cells, base))
    return 100.0 * float((first - second).mean()), int(((first >= 0.5) != (second >= 0.5)).sum())


def sensitivity_rows(
    variants: Sequence[VariantRuns],
    hit: str = "jump",
    published: np.ndarray | None = None,
    bands: Sequence[tuple[float, float]] = (),
    reading_error: float = 0.0,
) -> Iterator[tuple[Cell, ...]]:
    """Yield percent by duration of each variant beside the first one and the publication."""
    if published is not None:
        yield "published", "", "", *(round(float(p), 1) for p in published), *("",) * 6
    for one in variants:
        percent = one.percent(hit)
        apart, changed = _shifts(one, variants[0], hit)
        points = "" if math.isnan(apart) else f"{apart:+.1f}" if round(apart, 1) else "0"
        row: list[Cell] = [one.name, one.question, one.lever]
        row += [*(round(float(p), 1) for p in percent), changed, points]
        if published is not None:
            above, below, p = bias(percent, published, reading_error)
            fits = sum(low <= p <= high for p, (low, high) in zip(percent, bands, strict=True))
            mean = f"{float(np.mean(percent - published)):+.1f}"
            row += [mean, f"{above} / {below}", round(p, 3), f"{fits} of {len(bands)}"]
        yield tuple(row)


def holds(quantity: str, published: bool | None, predicted: bool, reason: str) -> Line:
    """Return a statement as a line. `published`: whether the published counts support it."""
    of = "stated" if published is None else f"stated; in the published counts: {int(published)}"
    found, stated = StudyEstimate(float(predicted)), StudyEstimate(1.0, of=of)
    return Line(f"{quantity}{HOLDS}", "", stated, found, (1.0, 1.0), reason=reason)


def scenario_b(
    runs: VariantRuns, moved: np.ndarray, jumps: np.ndarray, stops: np.ndarray
) -> tuple[Line, ...]:
    """Return the four statements on scenario B. `moved`: [runs] largest step of motor velocity in
    the window by its fault-free threshold. `jumps`, `stops`: published percent by duration.
    """
    size, frame = runs.frame["value"].map(stored).abs(), runs.frame
    small = (frame["jump"] | frame["stop"])[(size <= SMALL_COUNTS) & (frame["duration"] <= 64)]
    short = (size <= LARGE_COUNTS) & frame["duration"].isin((2, 4))
    disturbed, jumped = float((moved[short] > 1.0).mean()), frame["jump"][short]
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
            disturbed > 0.5 and not jumped.any(),
            f"of runs of up to {LARGE_COUNTS} counts and 2 or 4 packets {100 * disturbed:.0f} %"
            " move the motor velocity beyond its fault-free 99.9 percentile,"
            f" {100 * jumped.mean():.0f} % jump",
        ),
        *of_attack(runs, jumps, stops),
    )


def of_attack(
    runs: VariantRuns, jumps: np.ndarray | None = None, stops: np.ndarray | None = None
) -> tuple[Line, ...]:
    """Return two statements on either scenario. `jumps`, `stops`: published percent."""
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


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.0f}" for x in numbers)
