"""The published burst beside ours: 300 ms of a constant on the shoulder's DAC, every 8 s. Prints; asserts nothing.

    python analysis/seed_burst/compare.py [FOLDER [KEY=VALUE ...]]

FOLDER (default results/seed_burst) holds the result of campaigns/seed_burst.toml; where it holds none the campaign is
run into it, with KEY=VALUE as `ravenjax run --set` takes them. Each of its runs is then computed again with all signals
kept, the events are measured, and two Markdown tables and a figure come out (FOLDER/figures.svg and .png, after the
paper's Figures 3 to 5). About 3 minutes on 4 cores.

The published numbers are read off the figures of Li et al., IROS 2016 (+- 0.1 mm, +- 0.02 s). The paper gives neither
the constant nor the gains of the cue, so every constant of the campaign is listed and none is singled out.
"""

from __future__ import annotations

import dataclasses
import math
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import ravenjax as rj
from ravenjax.campaign import compile_cache, plan, replay, runner
from ravenjax.campaign.config import CampaignConfig
from ravenjax.engines.interface import Block
from ravenjax.engines.scan import LANE_MULTIPLE, ScanKernel
from ravenjax.store import manifest
from ravenjax.store.folder import read_all

CAMPAIGN = "seed_burst.toml"
ARM = "gold"
NAMES = ("position", "jpos", "model_jpos", "tip_error_mm", "cue_force")

EVENT_TICKS = 600
"""An event lasts from the onset of the fault until so much later, or until the robot stops."""
FAULT_TICKS = 300
REBOUND_TICKS = 300  # after the farthest point, which is looked for until REACH_TICKS after the onset
REACH_TICKS = FAULT_TICKS + 50
JUMP_UM = 100.0  # step of the measured tip in 1 ms, two running, the twin's not: the published analysis code
MOTION_TICKS = 500  # before it the hand rests

PEAKS_MM, REBOUND_DEG, REBOUND_MS, ONSET_S = (3.0, 7.0), (3.0, 7.0), (100.0, 200.0), (0.15, 0.25)
MEAN_MM = (0.7, 2.5)
PUBLISHED_SCALES = {0.05: (0.9, 0.3), 0.1: (2.1, 0.6), 0.15: (2.85, 0.9), 0.2: (3.6, 1.4)}  # peak and mean, mm
PUBLISHED_EVENTS = ("3.65 / 3.3 / 5.0 / 6.65", "5.6 / 3.4 / 6.7 / -", "- / - / 150 / -", "0.19 to 0.23 each")
PUBLISHED_FORCE = ".0166 / .0133 / .0296 / .0500"


@dataclasses.dataclass(frozen=True)
class Event:
    """What one burst did."""

    peak_mm: float  # largest tip distance, measured by the control software, to the nominal model
    rebound_deg: float  # of the shoulder, from its farthest point back; NaN where the robot stopped before
    rebound_ms: float
    onset_s: float  # of the cue after that of the fault, NaN: none
    force: float  # device units
    jumped: bool  # by the rule of the published analysis code


@dataclasses.dataclass(frozen=True)
class Run:
    """One run of the campaign."""

    row: pd.Series
    series: dict[str, np.ndarray]
    events: tuple[Event, ...]
    stop: int  # tick, the end of the run where it never stopped
    false_cues: int  # cues outside the events, before the stop

    @property
    def stopped(self) -> bool:
        return self.row["response"] == "stopped"

    def fits(self) -> dict[str, bool]:
        """Which acceptance bands the run meets."""
        events = self.events
        return {
            "4 events": len(events) == 4,
            "peaks": all(PEAKS_MM[0] <= e.peak_mm <= PEAKS_MM[1] for e in events),
            "rebound deg": self._rebound(lambda e: REBOUND_DEG[0] <= e.rebound_deg <= REBOUND_DEG[1]),
            "rebound ms": self._rebound(lambda e: REBOUND_MS[0] <= e.rebound_ms <= REBOUND_MS[1]),
            "stop at the last": self.stopped and self.row["response_cause"] == "overdrive" and len(events) == 4,
            "cue onset": all(ONSET_S[0] <= e.onset_s <= ONSET_S[1] for e in events),
        }

    def _rebound(self, holds) -> bool:
        seen = [e for e in self.events if not math.isnan(e.rebound_deg)]
        return bool(seen) and all(holds(e) for e in seen)


# --- measuring --------------------------------------------------------------------------------------------------------


def replays(config: CampaignConfig) -> Iterator[tuple[pd.Series, dict[str, np.ndarray]]]:
    """Each run's row of the fault table and its series; the kernel is compiled once."""
    ready = plan.make(config)
    kernel = ScanKernel(ready.program, LANE_MULTIPLE, keep_signals=True)

    def one(row: int) -> dict[str, np.ndarray]:
        block = Block(*ready.lanes([row], LANE_MULTIPLE), None)  # only the outcomes, unused here, take a twin
        found = replay.series(ready.program.setup, kernel.run_signals(block, ready.columns)[1])
        return {name: found[f"{ARM}/{name}"] for name in NAMES} | {"fault": found["fault0_active"]}

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for row, series in enumerate(pool.map(one, range(ready.runs))):
            yield ready.table.iloc[row], series


def measure(row: pd.Series, series: dict[str, np.ndarray], twin: np.ndarray) -> Run:
    """`row` of the result table; `twin`: measured tip [ticks, 3] m of the fault-free run of the same scale."""
    end = len(series["fault"])
    stop = int(row["response_ms"]) if row["response"] == "stopped" else end
    onsets = [t for t in rises(series["fault"]) if t < stop]
    jumps = jump_ticks(series["position"], twin)
    cue = rises(series["cue_force"][:, 0] > 0.0)
    inside = [any(t <= c < t + EVENT_TICKS for t in onsets) for c in cue]
    false = sum(c < stop and not within for c, within in zip(cue, inside, strict=True))
    return Run(row, series, tuple(event(series, t, min(t + EVENT_TICKS, stop), jumps) for t in onsets), stop, false)


def event(series: dict[str, np.ndarray], onset: int, end: int, jumps: np.ndarray) -> Event:
    """The burst from tick `onset` on, watched until tick `end`."""
    force = series["cue_force"][onset:end, 0]
    felt = np.flatnonzero(force > 0.0)
    shoulder = np.degrees(series["jpos"][onset:end, 0].astype(float))
    rebound_deg = rebound_ms = math.nan
    if end - onset == EVENT_TICKS:
        far = int(np.argmax(np.abs(shoulder[:REACH_TICKS] - shoulder[0])))
        back = (shoulder[far : far + REBOUND_TICKS] - shoulder[far]) * -np.sign(shoulder[far] - shoulder[0])
        rebound_deg, rebound_ms = float(back.max()) + 0.0, float(np.argmax(back))  # no -0.0
    return Event(
        peak_mm=float(series["tip_error_mm"][onset:end].max()),
        rebound_deg=rebound_deg,
        rebound_ms=rebound_ms,
        onset_s=felt[0] * 1e-3 if len(felt) else math.nan,
        force=float(force.max()),
        jumped=bool(((jumps >= onset) & (jumps < end)).any()),
    )


def jump_ticks(position: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Ticks at which the second of two long steps ends."""
    long, usual = (np.linalg.norm(np.diff(tip, axis=0), axis=1) * 1e6 > JUMP_UM for tip in (position, twin))
    over = long & ~usual
    return np.flatnonzero(over[1:] & over[:-1]) + 2


def rises(active: np.ndarray) -> list[int]:
    """Ticks at which `active` becomes true."""
    return np.flatnonzero(active & ~np.concatenate([[False], active[:-1]])).tolist()


# --- tables -----------------------------------------------------------------------------------------------------------


def event_table(runs: list[Run]) -> Iterator[str]:
    """One line per constant."""
    heads = (
        "DAC constant",
        "bursts until stop",
        "stop, ms after the burst's onset",
        "tip error peaks, mm",
        "rebound, deg",
        "rebound, ms",
        "cue after fault, s",
        "peak forces",
        "jumps (code's rule)",
        "false cues",
        "in band",
    )
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    yield (
        f"| published (not stated) | 4 | at the last | {PUBLISHED_EVENTS[0]} | {PUBLISHED_EVENTS[1]} | "
        f"{PUBLISHED_EVENTS[2]} | {PUBLISHED_EVENTS[3]} | {PUBLISHED_FORCE} | 4 (by eye) | 1 | |"
    )
    yield "| band (A4, A5) | 4 | last | 3 to 7 | 3 to 7 | about 150 | 0.15 to 0.25 | - | 4 | at least 1 | |"
    for run in runs:
        fits = run.fits()
        met = ", ".join(name for name, ok in fits.items() if ok) or "none"
        cells = (
            f"{run.row['fault0_value']:+.0f}",
            str(len(run.events)),
            f"{run.stop - onset_of_last(run)} ({run.row['response_cause']})" if run.stopped else "no stop",
            joined(e.peak_mm for e in run.events),
            joined(e.rebound_deg for e in run.events),
            joined((e.rebound_ms for e in run.events), ".0f"),
            joined((e.onset_s for e in run.events), ".3f"),
            joined((e.force for e in run.events), ".4f"),
            str(sum(e.jumped for e in run.events)),
            str(run.false_cues),
            f"{sum(fits.values())} of {len(fits)}: {met}",
        )
        yield f"| {' | '.join(cells)} |"


def onset_of_last(run: Run) -> int:
    """Tick of the last burst's onset before the stop."""
    return [t for t in rises(run.series["fault"]) if t < run.stop][-1]


def joined(values, form: str = ".2f") -> str:
    """Numbers one after another, "-" for what is not there."""
    return " / ".join("-" if math.isnan(v) else format(v, form) for v in values)


def scale_table(runs: dict[float, Run]) -> Iterator[str]:
    """Fault-free runs: tip error by scale, and how it grows with the scale."""
    heads = ("scale", "peak, published", "peak, ours", "mean, published", "mean, ours", "cues, published", "cues, ours")
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    ours = {}
    for scale, (peak, mean) in PUBLISHED_SCALES.items():
        error = runs[scale].series["tip_error_mm"][MOTION_TICKS:]
        ours[scale] = (float(error.max()), float(error.mean()))
        cues = str(int(runs[scale].row["cue0_count"]))
        crossed = "exceeds 3 mm" if peak > PEAKS_MM[0] else "0"
        cells = (f"{x:.2f} mm" for x in (peak, ours[scale][0], mean, ours[scale][1]))
        yield f"| {scale:g} | {' | '.join(cells)} | {crossed} | {cues} |"
    yield ""
    for name, values in (("published", PUBLISHED_SCALES), ("ours", ours)):
        means = float(np.mean([mean for _, mean in values.values()]))
        powers = ", ".join(f"{what} {line(values, i)}" for i, what in enumerate(("peak", "mean")))
        inside = "inside" if MEAN_MM[0] <= means <= MEAN_MM[1] else "outside"
        yield f"- {name}: {powers}; mean of all segments {means:.2f} mm, {inside} {MEAN_MM[0]} to {MEAN_MM[1]} mm (A6)."


def line(values: dict[float, tuple[float, float]], i: int) -> str:
    """How well a straight line fits, where it meets scale 0, and the exponent of the power law."""
    x, y = np.array(list(values)), np.array([v[i] for v in values.values()])
    slope, at_zero = np.polyfit(x, y, 1)
    rest = y - slope * x - at_zero
    explained = 1.0 - (rest @ rest) / np.sum((y - y.mean()) ** 2)
    exponent = np.polyfit(np.log(x), np.log(y), 1)[0]
    return f"{at_zero:.2f} mm + {slope:.1f} mm scale (explains {explained:.1%}; power law scale^{exponent:.2f})"


# --- figure -----------------------------------------------------------------------------------------------------------


def figure(path: Path, scales: dict[float, Run], shown: list[Run]) -> None:
    """After the paper: tip error without fault (3), shoulder and tip error with bursts (4), cue (5)."""
    fig, axes = plt.subplots(4, 1, figsize=(9, 11), constrained_layout=True)
    for scale, run in scales.items():
        error = run.series["tip_error_mm"]
        axes[0].plot(np.arange(len(error)) / 1e3, error, lw=0.7, label=f"scale {scale:g}")
    axes[0].set(title="no fault", ylabel="tip error, mm")
    for run in shown:
        label, end = f"DAC {run.row['fault0_value']:+.0f}", min(run.stop + 1, len(run.series["fault"]))
        time = np.arange(end) / 1e3
        axes[1].plot(time, np.degrees(run.series["jpos"][:end, 0]), lw=0.8, label=label)
        axes[2].plot(time, run.series["tip_error_mm"][:end], lw=0.8, label=label)
        axes[3].plot(time, run.series["cue_force"][:end, 0], lw=0.8, label=label)
    model = np.degrees(shown[0].series["model_jpos"][:, 0])
    axes[1].plot(np.arange(len(model)) / 1e3, model, "k", lw=0.5, label="nominal model")
    axes[1].set(title="bursts of 300 ms every 8 s, scale 0.1, drawn until the robot stops", ylabel="shoulder, deg")
    axes[2].set(ylabel="tip error, mm")
    axes[3].set(ylabel="cue, device units", xlabel="time, s")
    for axis in (axes[0], axes[2]):
        axis.axhline(PEAKS_MM[0], color="0.5", lw=0.8, ls="--")
    for axis in axes:
        axis.legend(fontsize=8, loc="upper left")
        axis.grid(alpha=0.3)
    for suffix in (".svg", ".png"):
        fig.savefig(path.with_suffix(suffix), dpi=120)


def shown_in_figure(runs: list[Run]) -> list[Run]:
    """The constant of either sign that meets most bands, the smaller where two do."""
    return [
        max((r for r in runs if r.row["fault0_value"] * sign > 0), key=lambda r: (sum(r.fits().values()), -r.stop))
        for sign in (1, -1)
    ]


def main(folder: Path, overrides: list[str]) -> None:
    """Run what is missing, print the tables, draw the figure."""
    compile_cache.enable()
    if not (folder / manifest.FILE).is_file():
        runner.run_campaign(rj.load_campaign(CAMPAIGN, overrides), folder, "xla")
    results = read_all(folder).set_index("index")
    config = CampaignConfig.model_validate(manifest.read(folder).config)
    found = list(replays(config))
    free = {
        float(planned["param:operator.scale"]): (results.loc[planned["index"]], series)
        for planned, series in found
        if planned["fault0_site"] == ""
    }
    scales = {scale: measure(row, series, series["position"]) for scale, (row, series) in free.items()}
    twin = free[config.operator.scale][1]["position"]
    bursts = [measure(results.loc[p["index"]], series, twin) for p, series in found if p["fault0_site"] != ""]
    print("\n".join(event_table(bursts)), end="\n\n")
    print("\n".join(scale_table(scales)), end="\n\n")
    apart = sum(r.row["cue0_first_ms"] not in (-1, *rises(r.series["cue_force"][:, 0] > 0)[:1]) for r in bursts)
    print(f"Runs whose replay does not meet the campaign's first cue to the millisecond: {apart} of {len(bursts)}.")
    figure(folder / "figures", scales, shown_in_figure(bursts))
    print(f"drawn: {folder / 'figures.svg'}, {folder / 'figures.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results") / "seed_burst", sys.argv[2:])
