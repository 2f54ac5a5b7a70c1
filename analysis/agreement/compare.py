"""Compares two ways to compute the same run. Prints Markdown tables and asserts nothing.

    python analysis/agreement/compare.py [exact] [verdicts] [printed] [substeps] [arithmetic]

- exact: engines mjx and xla, tick by tick in float64: every signal of faulty runs
- verdicts: engines mjx and xla in float32: the verdicts of the 2 100 runs of every_layer.toml
- printed: engines xla and simd in float32: the verdicts of 10 500 runs, five times every group of
  every_layer.toml
- substeps: one, two and four plant steps per tick: the verdicts of campaigns/quick.toml
- arithmetic: the control software in float32 and in the original's mixed arithmetic: the DAC
  commands

Without a name all five run, which takes about 15 minutes on 4 cores.
"""

import dataclasses
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path

import jax
import numpy as np
import pandas as pd

import ravenjax as rj
from ravenjax.campaign import compile_cache, plan, runner
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.engines.interface import Block
from ravenjax.engines.xla import LANE_MULTIPLE, ScanKernel
from ravenjax.numbers.setup import CAMPAIGN, ORIGINAL, REFERENCE, Precision
from ravenjax.outcomes.events import Rules
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.stages import plc
from ravenjax.stats.intervals import wilson_interval

EVERY_LAYER = Path(__file__).parent / "every_layer.toml"
QUICK = "quick.toml"

# --- exact ----------------------------------------------------------------------------------------
# --------------------

TICKS, BOUND_TICKS = 400, 100
# Rows of the motion. The pedal is down from the first tick on, and the hand moves from tick 60 on.
SKIPPED_ROWS = 440

EXACT_FAULTS = (
    ("usb_out", "shoulder", "overwrite", 6000),
    ("usb_out", "insertion", "latch_offset", -4000),
    ("current_cmd", "elbow", "offset", 2000),
    ("mpos", "insertion", "offset", 5.0),
    ("encoder", "elbow", "drift", 2.0),
    ("pos_d", "x", "offset", 2000),
    ("jpos_d", "wrist", "offset", 0.1),
    ("cable_scale", "shoulder", "overwrite", 0.1),
    ("external_torque", "elbow", "overwrite", 1.0),
    ("friction_scale", "shoulder", "overwrite", 5.0),
)


def exact_campaign() -> dict:
    """Return a campaign with one run for each of EXACT_FAULTS, each acting from tick 30 on for 40
    ms.
    """
    groups = [
        {
            "name": f"{site} {channel}",
            "fault": [
                {
                    "site": site,
                    "channel": channel,
                    "effect": effect,
                    "value": value,
                    "start_ms": 30,
                    "duration_ms": 40,
                }
            ],
        }
        for site, channel, effect, value in EXACT_FAULTS
    ]
    return {
        "campaign": {"name": "exact", "duration_s": TICKS / 1e3},
        "operator": {"motion": "suture"},
        "group": groups,
    }


def exact() -> Iterator[str]:
    """Yield the largest difference of any signal, in units of max(1, magnitude)."""
    ready = plan.make_plan(rj.load_campaign(exact_campaign()), precision=REFERENCE)
    longer = hands.operator_motion(
        rj.load_campaign(exact_campaign(), [f"campaign.duration_s={2 * TICKS / 1e3}"])
    )
    columns = tuple(
        np.ascontiguousarray(column[SKIPPED_ROWS : SKIPPED_ROWS + TICKS])
        for column in longer.first_rows(1000).table().T
    )
    traces = {}
    for name, dynamics in (("xla", "unrolled"), ("mjx", "mjx")):
        setup = dataclasses.replace(ready.program.setup, link_dynamics=dynamics)
        kernel = ScanKernel(
            dataclasses.replace(ready.program, setup=setup), LANE_MULTIPLE, keep_signals=True
        )
        varied, harmless = ready.lanes([0], LANE_MULTIPLE, harmless=True)
        golden = kernel.run(Block(varied, harmless, None), columns).reference
        traces[name] = [
            kernel.run_signals(Block(*ready.lanes([row], LANE_MULTIPLE), golden), columns)[1]
            for row in range(ready.runs)
        ]
    rows = []
    for row in range(ready.runs):
        gaps = [
            _gap(a, b)
            for a, b in zip(*(jax.tree.leaves(t[row]) for t in traces.values()), strict=True)
        ]
        worst = np.max(np.stack(gaps), axis=0)
        dac = traces["xla"][row].control.arms[0].current_cmd_written
        other = traces["mjx"][row].control.arms[0].current_cmd_written
        unequal = sum(int(np.count_nonzero(a != b)) for a, b in zip(dac, other, strict=True))
        tip = np.stack(traces["xla"][row].tip[0], axis=1)
        way = [np.linalg.norm(tip[:n] - tip[0], axis=1).max() * 1e3 for n in (BOUND_TICKS, TICKS)]
        fault = " ".join(map(str, EXACT_FAULTS[row]))
        first, whole = worst[:BOUND_TICKS].max(), worst.max()
        rows.append(
            (
                fault,
                f"{first:.1e}",
                f"{whole:.1e}",
                str(unequal),
                f"{way[0]:.2f} and {way[1]:.1f} mm",
            )
        )
    title = (
        f"largest difference of any of {len(gaps)} signals, |a - b| / max(1, |a|), SI units and"
        " counts"
    )
    heads = (f"first {BOUND_TICKS} ticks", f"all {TICKS} ticks", "DACs unequal", "tip moves")
    yield from table(("fault from tick 30 on, 40 ms", *heads), rows, title)


def _gap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the difference in each tick, [ticks]."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore"):
        return np.where(same, 0.0, np.abs(a - b) / np.maximum(1.0, np.abs(a)))


# --- verdicts -------------------------------------------------------------------------------------
# --------------------


def verdicts() -> Iterator[str]:
    """Compare engines xla and mjx."""
    yield from _verdicts(rj.load_campaign(EVERY_LAYER), "xla", "mjx")


def printed() -> Iterator[str]:
    """Compare engines xla and simd, on five times as many runs."""
    groups = rj.load_campaign(EVERY_LAYER).group
    more = [
        f"group.{i}.runs={5 * (group.runs or 0)}" for i, group in enumerate(groups) if group.runs
    ]
    yield from _verdicts(rj.load_campaign(EVERY_LAYER, more), "xla", "simd")


def _verdicts(config: CampaignConfig, *engines: str) -> Iterator[str]:
    """Yield the verdicts of two engines, and every run in which they differ with its margins."""
    frames = {}
    for name in engines:
        begin = time.perf_counter()
        frames[name] = runner.run_campaign(config, None, name).frame()
        yield (
            f"{name}: {len(frames[name])} runs of {config.campaign.ticks} ms in"
            f" {time.perf_counter() - begin:.0f} s"
        )
    yield ""
    a, b = frames.values()
    same = (a["verdict"].astype(str) == b["verdict"].astype(str)).to_numpy()
    rate = wilson_interval(int(same.sum()), len(same))
    yield f"Same verdict: {rate.k} of {rate.n}, {_share(rate)}."
    counts = [frame["verdict"].value_counts() for frame in (a, b)]
    rows = [
        (str(verdict), str(n), str(counts[1].get(verdict, 0)))
        for verdict, n in counts[0].items()
        if n
    ]
    yield ""
    yield from table(("verdict", *frames), rows, "runs by verdict")
    yield ""
    rows = []
    for column in ("peak_model_deviation_mm", "peak_golden_deviation_mm", "largest_step_mm"):
        gap = np.abs(a[column].to_numpy(float) - b[column].to_numpy(float))
        worst = _fault(a.iloc[int(gap.argmax())])
        rows.append(
            (
                column,
                f"{np.mean(gap == 0):.0%}",
                f"{np.quantile(gap, 0.99):.1e}",
                f"{gap.max():.1e}",
                worst,
            )
        )
    yield from table(
        ("column", "equal to the last bit", "99 % below", "largest", "in"), rows, "differences, mm"
    )
    yield ""
    rows = [_difference(a.iloc[i], b.iloc[i], config.rules) for i in np.flatnonzero(~same)]
    heads = ("run", "fault", *engines, "how near the deciding limit")
    yield from table(heads, rows, "runs with different verdicts")


def _fault(row: pd.Series) -> str:
    value = "" if pd.isna(row["fault0_value"]) else f" {row['fault0_value']:g}"
    where = f"{row['fault0_site']} {row['fault0_channel']} {row['fault0_effect']}{value}"
    return f"{where}, {row['fault0_start_ms']} ms for {row['fault0_duration_ms']}"


HAZARDS = ("unintended", "loss", "false_report")
"""Prefixes of the columns of each hazard that is judged by a distance."""


def _difference(a: pd.Series, b: pd.Series, rules: Rules) -> tuple[str, ...]:
    reasons = []
    if (a["response"], a["response_cause"]) != (b["response"], b["response_cause"]):
        for name in (
            n for n in a.index if n.startswith("check_") and n.endswith("_count") and a[n] != b[n]
        ):
            check = name.removeprefix("check_").removesuffix("_count")
            margins = [row[f"check_{check}_margin"] for row in (a, b)]
            reasons.append(
                f"{check}: {a[name]} / {b[name]} ticks, margin {margins[0]:.4g} / {margins[1]:.4g}"
            )
    cue = f"cue{rules.cue}"
    if (a[f"{cue}_first_ms"] >= 0) != (b[f"{cue}_first_ms"] >= 0):
        peaks = [row["peak_model_deviation_mm"] for row in (a, b)]
        near = f"tip {peaks[0]:.4f} / {peaks[1]:.4f} mm, limit {rules.threshold_mm:g}"
        reasons.append(f"cue: {a[f'{cue}_ms']} / {b[f'{cue}_ms']} ms; {near}")
    for hazard in HAZARDS:
        if (a[f"{hazard}_first_ms"] >= 0) != (b[f"{hazard}_first_ms"] >= 0):
            far = [row[f"{hazard}_mm"] for row in (a, b)]
            reasons.append(f"{hazard}: {far[0]:.4f} / {far[1]:.4f} mm, limit {rules.limit_mm:g}")
    if a["halted_ms"] != b["halted_ms"]:
        reasons.append(f"not live: {a['halted_ms']} / {b['halted_ms']} ms")
    return str(a["index"]), _fault(a), str(a["verdict"]), str(b["verdict"]), "; ".join(reasons)


# --- substeps -------------------------------------------------------------------------------------
# --------------------

SUBSTEPS = (1, 2, 4)


def substeps() -> Iterator[str]:
    """Yield verdict shares of quick.toml's faulty runs with 1, 2 and 4 plant steps per tick.

    Packets last one cycle, because another file draws other lengths.
    """
    frames = []
    for n in SUBSTEPS:
        frame = runner.run_campaign(
            rj.load_campaign(QUICK, [f"campaign.substeps={n}", "campaign.packets=every_cycle"]),
            None,
            "xla",
        ).frame()
        frames.append(frame[frame["fault0_site"] != ""].reset_index(drop=True))
    labels = [frame["verdict"].astype(str) for frame in frames]
    total = len(labels[0])
    rows = []
    for verdict in sorted(set().union(*labels), key=lambda v: -(labels[0] == v).sum()):
        shares = [_share(wilson_interval(int((label == verdict).sum()), total)) for label in labels]
        into = [f"+{((b == verdict) & (labels[0] != verdict)).sum()}" for b in labels[1:]]
        out = [f"-{((b != verdict) & (labels[0] == verdict)).sum()}" for b in labels[1:]]
        changes = [f"{i} {o}" for i, o in zip(into, out, strict=True)]
        rows.append((verdict, *shares, *changes))
    heads = tuple(f"{n} step{'s' * (n > 1)} per tick" for n in SUBSTEPS)
    yield from table(
        ("verdict", *heads, "runs changed 1 to 2", "1 to 4"),
        rows,
        f"{total} faulty runs of 3 s, 95 % Wilson",
    )
    yield ""
    for n, label in zip(SUBSTEPS[1:], labels[1:], strict=True):
        same = wilson_interval(int((label == labels[0]).sum()), total)
        yield (
            f"Same verdict with {n} steps as with 1, run by run: {same.k} of {total},"
            f" {_share(same)}."
        )
    for column in ("peak_model_deviation_mm", "largest_step_mm"):
        middle = ", ".join(f"{frame[column].median():.4f}" for frame in frames)
        upper = ", ".join(f"{frame[column].quantile(0.9):.4f}" for frame in frames)
        yield f"{column} with {SUBSTEPS} steps: medians {middle}; 90 % quantiles {upper}."


# --- arithmetic -----------------------------------------------------------------------------------
# --------------------

MOTION_S = 20.0
WINDOWS_S = (3.0, MOTION_S)
START_TICKS = 300  # until the pedal is down and the arm has settled


def arithmetic() -> Iterator[str]:
    """Yield the share of ticks whose DACs equal those of the original's arithmetic, and the largest
    difference.
    """
    opened, closed = [], []
    for motion in ("suture", "reach", "clutched"):
        base = {"name": "arithmetic", "duration_s": MOTION_S, "seed": 0}
        content = {"campaign": base, "operator": {"motion": motion}, "group": [{"name": "free"}]}
        config = rj.load_campaign(content)
        runs = {name: _run(config, precision) for name, precision in PRECISIONS.items()}
        whole = {
            name: np.stack(list(run.control.arms[0].current_cmd_written), axis=1)
            for name, run in runs.items()
        }
        exact, single = _driven(config, runs["float32"])
        apart = np.linalg.norm(
            np.stack(runs["float32"].tip[0]) - np.stack(runs["mixed"].tip[0]), axis=0
        )
        for seconds in WINDOWS_S:
            window = slice(START_TICKS, round(seconds * 1e3))
            where = (motion, f"{seconds:g} s")
            opened.append(
                (*where, "one operation at a time", *_dac_difference(exact[window], single[window]))
            )
            opened.append(
                (
                    *where,
                    "compiled, as in campaigns",
                    *_dac_difference(exact[window], whole["float32"][window]),
                )
            )
            row = _dac_difference(whole["mixed"][window], whole["float32"][window])
            closed.append((*where, *row, f"{apart[window].max() * 1e6:.1f}"))
    heads = (
        "all 7 DACs equal",
        "joints 1-3 equal",
        "largest difference, joints 1-3",
        "largest, joints 4-7, and its 99 %",
    )
    yield from table(
        ("motion", "first", "float32 against the original's arithmetic", *heads),
        opened,
        "open loop: the same encoders, packets and pins, recorded from a fault-free run, gold arm;"
        " shares of ticks, differences in DAC counts",
    )
    yield ""
    yield from table(
        ("motion", "first", *heads, "tips apart at most, um"),
        closed,
        "closed loop: all in float32 against control software mixed (float32 stored, float64"
        " between) and plant float64, both compiled",
    )


PRECISIONS: dict[str, Precision] = {"float32": CAMPAIGN, "mixed": ORIGINAL}


def _run(config: CampaignConfig, precision: Precision):
    """Return every signal of the fault-free run."""
    ready = plan.make_plan(config, precision)
    kernel = ScanKernel(ready.program, LANE_MULTIPLE, keep_signals=True)
    return kernel.run_signals(Block(*ready.lanes([0], LANE_MULTIPLE), None), ready.columns)[1]


def _driven(config: CampaignConfig, signals) -> tuple[np.ndarray, np.ndarray]:
    """Return DACs [ticks, 7] of the control software driven alone, in the original's arithmetic and
    in float32.
    """
    ready = plan.make_plan(config)
    setup, arm = ready.program.setup, config.campaign.arms
    pair = [
        ControlSoftware("raven2", arm, setup.tools, runlevel=run_levels.PEDAL_UP, precision=p)
        for p in (ORIGINAL, CAMPAIGN)
    ]
    enc_val = np.stack([np.asarray(x) for x in signals.control.arms[0].enc_val], axis=1)
    level = np.concatenate([[run_levels.PEDAL_UP], np.asarray(signals.plc.runlevel)])
    packets = jax.tree.map(np.asarray, signals.packet)
    dacs = []
    for k in range(ready.program.ticks):
        packet = jax.tree.map(lambda leaf, k=k: leaf[k].item(), packets)
        pins = int(level[k]) << plc.PIN_RUNLEVEL
        dacs.append([program.step([enc_val[k].tolist()], packet, pins).dac[0] for program in pair])
    exact, single = np.asarray(dacs).transpose(1, 0, 2)
    return exact, single


def _dac_difference(a: np.ndarray, b: np.ndarray) -> tuple[str, str, str, str]:
    """Return the difference of two DAC series [ticks, 7]."""
    gap = np.abs(a - b)
    tool = gap[:, 3:].max(axis=1)
    return (
        f"{np.mean(gap.max(axis=1) == 0):.1%}",
        f"{np.mean(gap[:, :3].max(axis=1) == 0):.1%}",
        str(int(gap[:, :3].max())),
        f"{int(tool.max())}, {np.quantile(tool, 0.99):.0f}",
    )


# --- printing -------------------------------------------------------------------------------------
# --------------------


def _share(rate) -> str:
    return f"{rate.value:.1%} ({rate.low:.1%} to {rate.high:.1%})"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> Iterator[str]:
    """Write a Markdown table."""
    yield f"{title}:\n"
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    for row in rows or [("none", *[""] * (len(heads) - 1))]:
        yield f"| {' | '.join(row)} |"


def machine() -> str:
    """Return processor, cores and versions."""
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.is_file() else ""
    model = next(
        (
            line.partition(":")[2].strip()
            for line in text.splitlines()
            if line.startswith("model name")
        ),
        "",
    )
    versions = ", ".join(
        f"{name} {metadata.version(name)}" for name in ("jax", "mujoco", "mujoco-mjx", "numpy")
    )
    cores = len(os.sched_getaffinity(0))
    return (
        f"{model or platform.processor()}, {cores} cores, Python {platform.python_version()},"
        f" {versions}"
    )


PARTS: dict[str, Callable[[], Iterator[str]]] = {
    "exact": exact,
    "verdicts": verdicts,
    "printed": printed,
    "substeps": substeps,
    "arithmetic": arithmetic,
}


def main(names: Sequence[str]) -> None:
    """Print the requested parts."""
    if unknown := [name for name in names if name not in PARTS]:
        sys.exit(f"unknown part {unknown[0]!r}, expected some of {', '.join(PARTS)}")
    compile_cache.enable_cache()
    print(f"{machine()}\n")
    for name in names or PARTS:
        print(f"## {name}\n")
        for line in PARTS[name]():
            print(line, flush=True)
        print()


if __name__ == "__main__":
    main(sys.argv[1:])
