"""Counts the runs of the targeted attacks (DSN 2016), and tests the statements of the paper.

A cell is one value with one duration of the fault. Its runs differ in the packet at which the fault
starts. The cells are a fixed grid, so a predicted share has no interval. The length of a packet was
not published: the baseline uses packet lengths of a recorded arm, and variants use others.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.loading import validate_tables
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import require_raven
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.store import manifest
from ravenjax.store.folder import read_all
from studies.study import Cell, Line, StudyEstimate, read_toml

DURATIONS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Durations of a fault in packets, in both scenarios."""
SMALL_COUNTS, LARGE_COUNTS = 800, 10_000
"""DAC counts of the shoulder on the published trajectory (comment in the fork's code), and the most
that the fork's own check allows.
"""
STATEMENTS = read_toml("published/dsn16.toml")["statements"]


def rate(cells: pd.DataFrame | pd.Series) -> StudyEstimate:
    """Return the mean of the cells' shares, in %."""
    shares, of = cells.to_numpy().ravel(), "cells (value, duration) of a fixed grid"
    return StudyEstimate(100.0 * float(shares.mean()), n=len(shares), of=of)


def bias(
    predicted: np.ndarray, published: np.ndarray, reading_error: float = 0.0
) -> tuple[int, int, float]:
    """Return how many predictions are above and below by more than the reading error, and p."""
    from scipy.stats import binomtest

    apart = predicted - published
    above, below = int((apart > reading_error).sum()), int((apart < -reading_error).sum())
    return above, below, float(binomtest(above, above + below).pvalue) if above + below else 1.0


def lever(config: CampaignConfig, rows: np.ndarray) -> str:
    """Return the distance of the gold arm's desired tip from its first axis at these rows."""
    raven = require_raven(config)
    motion = hands.operator_motion(raven)
    moved = motion.position_um[rows, 0] @ np.array(ITP_AXES["gold"], float).T
    tip = tips(np.array(motion.start_jpos[0], float)) + moved * raven.operator.scale * 1e-6
    distance = np.hypot(*tip[:, :2].T) * 1e3
    return "-".join(dict.fromkeys(f"{end:.0f}" for end in (distance.min(), distance.max()))) + " mm"


def tips(joints: np.ndarray) -> np.ndarray:
    """Return the tips [.., 3] (m) of the gold arm with joints [.., 7] (rad, m)."""
    with jax.enable_x64(True):
        position = kinematics.forward_pose("gold", Vec(np.moveaxis(joints, -1, 0))).position
    return np.stack([np.asarray(x) for x in position], axis=-1)


@dataclasses.dataclass(frozen=True, eq=False)
class VariantRuns:
    """The runs of one variant, or of one way to count them."""

    name: str
    config: CampaignConfig
    lever: str  # of the desired tip, over the packets at which faults start
    # A row per faulty run: columns of the result table, and value (DAC counts, or displacement in
    # um), duration and start (packets), jump_ms (end of the first jump's second long step, -1:
    # none). Bool: jump, stop, ik, missed (jump without a stop).
    frame: pd.DataFrame
    question: str = ""  # what differs from the baseline

    def share(self, hit: str) -> pd.DataFrame:
        """Return the share of runs with `hit` by value (rows) and duration (columns)."""
        hits = self.frame[hit].astype(float)
        return hits.groupby([self.frame["value"], self.frame["duration"]]).mean().unstack()

    def cells(self, hit: str) -> np.ndarray:
        """Return the shares by the size of the value, as some variants have the other sign."""
        shares = self.share(hit)
        return shares.to_numpy()[np.argsort(np.abs(shares.index))]

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
    return runs_of(name, config, read_all(folder), question)


def runs_of(
    name: str, config: CampaignConfig, table: pd.DataFrame, question: str = ""
) -> VariantRuns:
    """Return the valid faulty rows of a result table. A displacement's value is the group's."""
    valid = table.loc[table["failed"] == ""].sort_values("index")
    faulty = valid["fault0_site"] != ""
    free = valid.loc[~faulty, "check_ik_reject_count"].max() if not faulty.all() else 0
    runs = valid.loc[faulty].reset_index(drop=True)
    displacement = runs["group"].astype(str).str.extract(r"^d(\d+)$")[0].astype(float)
    jump, stop = runs["jump_code"].astype(bool), runs["response"] == "stopped"
    names = {"fault0_start_ms": "start", "fault0_duration_ms": "duration"}
    frame = runs.rename(columns=names | {"jump_code_first_ms": "jump_ms"}).assign(
        value=displacement.fillna(runs["fault0_value"]),
        jump=jump,
        stop=stop,
        ik=runs["check_ik_reject_count"] > free,
        missed=jump & ~stop,
    )
    # A packet of drawn length holds the hand's place at its tick, another the motion's next row.
    drawn = len(require_raven(config).campaign.packet_shares) > 1
    rows = runs["first_active_ms"] if drawn else runs["fault0_start_ms"] - 1
    at_start = lever(config, rows.loc[rows >= 0].unique())
    return VariantRuns(name, config, at_start, frame, question)


def in_window(frame: pd.DataFrame, jump_packet: np.ndarray) -> np.ndarray:
    """Return which runs jump inside the published window, bool [runs]. `jump_packet`: packet that
    ends the second long step of the first jump; 0: none. The packet of the jump is two before.
    """
    since = jump_packet - 2 - frame["start"].to_numpy()
    return (jump_packet > 0) & (since >= 0) & (since <= frame["duration"].to_numpy() + 1)


def stored(value: float) -> int:
    """Return what 16 bits keep of an added DAC value, without the small nominal command."""
    return (int(value) + 32768) % 65536 - 32768


def sensitivity_rows(
    variants: Sequence[VariantRuns],
    hit: str = "jump",
    published: np.ndarray | None = None,
    bands: Sequence[tuple[float, float]] = (),
    reading_error: float = 0.0,
) -> Iterator[tuple[Cell, ...]]:
    """Yield a row per variant: percent by duration, cells with another majority outcome than in the
    first variant, the mean difference from it, and the comparison with the publication.
    """
    if published is not None:
        yield "published", "", "", *(round(float(p), 1) for p in published), *("",) * 6
    base = variants[0].cells(hit)
    for one in variants:
        percent, cells, changed, points = one.percent(hit), one.cells(hit), 0, ""
        if cells.shape == base.shape:
            changed = int(((cells >= 0.5) != (base >= 0.5)).sum())
            apart = 100.0 * float((cells - base).mean())
            points = f"{apart:+.1f}" if round(apart, 1) else "0"
        compared: tuple[Cell, ...] = ()
        if published is not None:
            above, below, p = bias(percent, published, reading_error)
            fits = sum(low <= p <= high for p, (low, high) in zip(percent, bands, strict=True))
            mean = f"{float(np.mean(percent - published)):+.1f}"
            compared = mean, f"{above} / {below}", round(p, 3), f"{fits} of {len(bands)}"
        shares = (round(float(share), 1) for share in percent)
        yield one.name, one.question, one.lever, *shares, changed, points, *compared


def holds(key: str, predicted: bool, published: bool | None = None, **numbers: object) -> Line:
    """Return a statement of the publication as a line. `published`: whether the published counts
    confirm it. `numbers`: those in its reason.
    """
    by_counts = {None: "", False: "; its counts contradict it", True: "; its counts confirm it"}
    of = f"stated in the paper{by_counts[published]}"
    found, stated = StudyEstimate(float(predicted)), StudyEstimate(1.0, of=of)
    text, reason = (STATEMENTS[key][name] for name in ("text", "reason"))
    quantity = f"statement: {text} (1: confirmed, 0: contradicted)"
    return Line(quantity, "", stated, found, (1.0, 1.0), reason=reason.format(**numbers))


def scenario_b(
    runs: VariantRuns, moved: np.ndarray, jumps: np.ndarray, stops: np.ndarray
) -> Iterator[Line]:
    """Yield the four statements on scenario B. `moved`: [runs] largest step of motor velocity in
    the window, divided by its threshold. `jumps`, `stops`: published percent by duration.
    """
    size, frame = runs.frame["value"].map(stored).abs(), runs.frame
    small = (frame["jump"] | frame["stop"])[(size <= SMALL_COUNTS) & (frame["duration"] <= 64)]
    yield holds(
        "small", not small.any(), hit=int(small.sum()), runs=len(small), counts=SMALL_COUNTS
    )
    short = (size <= LARGE_COUNTS) & frame["duration"].isin((2, 4))
    disturbed, jumped = 100 * float((moved[short] > 1.0).mean()), 100 * frame["jump"][short].mean()
    held = disturbed > 50 and not jumped
    yield holds("bursts", held, counts=LARGE_COUNTS, disturbed=disturbed, jumped=jumped)
    yield from of_attack(runs, jumps, stops)


def of_attack(
    runs: VariantRuns, jumps: np.ndarray | None = None, stops: np.ndarray | None = None
) -> Iterator[Line]:
    """Yield two statements on either scenario. `jumps`, `stops`: published percent."""
    jumped, stopped, missed = (runs.percent(hit) for hit in ("jump", "stop", "missed"))
    window = np.isin(DURATIONS, (2, 4, 8, 16))
    lower, opened, beside = None, None, ""
    if jumps is not None and stops is not None:
        lower, opened = bool((stops <= jumps).all()), bool((jumps[window] > 0).all())
        beside = f"; published {_listed(stops - jumps)}"
    apart = f"{_listed(stopped - jumped)}{beside}"
    yield holds("detects", bool((stopped <= jumped).all()), lower, apart=apart)
    packets = ", ".join(map(str, np.array(DURATIONS)[missed > 0])) or "no"
    held = bool((missed[window] > 0).all())
    yield holds("window", held, opened, packets=packets, missed=_listed(missed))


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.0f}" for x in numbers)
