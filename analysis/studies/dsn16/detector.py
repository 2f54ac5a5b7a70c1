"""Implements the published detector of DSN 2016: its thresholds, its alarms, and the joints that
cause the jumps.

Thresholds are learned from fault-free steps. A step is the change from one logged row to the next,
of motor position, motor velocity and joint position of the first three joints. An alarm is raised
if, in one row, each of the three exceeds its threshold for some joint, for motor velocity in that
row and the next.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.robots.raven2.campaign.config import require_raven
from studies.dsn16.attacks import VariantRuns, holds, in_window, read_runs, tips
from studies.series import Recorder, Row, Series
from studies.study import Cell, Line, Published, Variant

LOGGED = ("last_seq", "mpos", "mvel", "jpos", "position")
"""Signals of a log: the number of the newest packet, motors and joints, and the reported tip."""
VARIABLES = ("mpos", "mvel", "jpos")
JOINTS = ("shoulder", "elbow", "insertion")
FIRST_PACKET = 500
"""First packet that is used. Before it the hands rest and the arm settles."""
TRAINING = ("training_suture", "training_peg_transfer")
"""Variants of fault-free runs from which the detector learns: two motions of 300 runs each, like
the 600 runs of the publication.
"""
LEAP_UM = 1000.0
CHOSEN, COMPARED = "99.9 % of all steps", "99.8 % of all steps"
"""The threshold for the paper's statements, and the threshold for its rates."""
MOTIONS = ("motion of joints 1-3", "motion of the tool joints", "either motion", "both motions")
"""What the two long steps of a jump need."""


def log(series: Series) -> Series:
    """Return the rows of a run's LOGGED in which a new packet came."""
    fresh = np.flatnonzero(np.diff(series["last_seq"], prepend=0))
    return {name: series[name][fresh] for name in LOGGED}


def steps(log: Series) -> np.ndarray:
    """Return |step| [rows - 1, 3 variables, 3 joints] from each row of the log to the next."""
    return np.stack([np.abs(np.diff(log[name][:, :3], axis=0)) for name in VARIABLES], axis=1)


def fault_free(log: Series) -> np.ndarray:
    """Return steps [rows, 3, 3] of a fault-free run after it has begun to move."""
    return steps(log)[log["last_seq"][:-1] >= FIRST_PACKET]


def reported_tip(log: Series) -> np.ndarray:
    """Return the reported tip in whole um, [rows, 3]."""
    return np.rint(log["position"] * 1e6)


def stacked(series: Sequence[np.ndarray]) -> np.ndarray:
    """Stack series [rows, ..] of runs to [runs, rows, ..], each cut to the shortest."""
    rows = min(map(len, series))
    return np.stack([one[:rows] for one in series])


def run_alarms(log: Series, thresholds: np.ndarray, start: int, duration: int) -> np.ndarray:
    """Return which alarms of one run come in the published window of a fault in packets `start` to
    `start + duration - 1`, bool [4]: motor position, motor velocity, joint position, all in one
    row. `thresholds`: [3, 3].
    """
    # Each [rows - 1], true if any joint exceeds its threshold.
    position, velocity, joint = np.any(steps(log) > thresholds, axis=2).T
    velocity = velocity & np.append(velocity[1:], False)
    over = np.stack([position, velocity, joint, position & velocity & joint], axis=1)
    return over[_window(log, start, duration)].any(axis=0)


def _window(log: Series, start: int, duration: int) -> np.ndarray:
    """Return the steps of packets t1 to t1 + d + 1, bool [rows - 1]."""
    packet = log["last_seq"][:-1]
    return (packet >= start) & (packet <= start + duration + 1)


class Watched(NamedTuple):
    """The detector's results for the runs of one variant, in the order of its frame."""

    alarms: Mapping[str, np.ndarray]  # maps a threshold in words to `run_alarms` [runs, 4]
    # [runs] largest step of motor velocity inside the window, divided by its CHOSEN threshold.
    largest_mvel: np.ndarray
    # bool [runs]: the reported tip moved more than 1 mm within two packets: the text's jump.
    leaps: np.ndarray
    jump_packet: np.ndarray  # int [runs], packet at the time of the first jump; 0: no jump
    # [runs, 3, 7] rad and m, reported in the packets of the first jump's steps; NaN: no jump.
    joints: np.ndarray


def learn_thresholds(folders: Mapping[str, Path]) -> dict[str, np.ndarray]:
    """Return CHOSEN and COMPARED, [3, 3] each: percentiles of all steps of all training runs."""
    recorder, learned = Recorder(LOGGED), []
    for name in TRAINING:
        learned += recorder.measure(folders[name], lambda _, series: fault_free(log(series)))
    pooled, names = stacked(learned), (CHOSEN, COMPARED)
    return {name: np.percentile(pooled, float(name.split()[0]), axis=(0, 1)) for name in names}


def watch(folder: Path, runs: VariantRuns, thresholds: Mapping[str, np.ndarray]) -> Watched:
    """Run the detector on every faulty run of a folder."""
    faults = runs.frame.set_index("index")[["start", "duration", "jump_ms"]]

    def watch_run(row: Row, series: Series) -> tuple[Any, ...]:
        found, (start, duration, jump_ms) = log(series), faults.loc[row["index"]].tolist()
        moved = steps(found)[_window(found, start, duration), 1] / thresholds[CHOSEN][1]
        alarms = [run_alarms(found, level, start, duration) for level in thresholds.values()]
        tip, joints = reported_tip(found), found["jpos"].astype(float)
        leaps = [
            (np.linalg.norm(tip[rows:] - tip[:-rows], axis=1) > LEAP_UM).any() for rows in (1, 2)
        ]
        packet = int(series["last_seq"][jump_ms]) if jump_ms >= 0 else 0
        last = int(np.searchsorted(found["last_seq"], packet))
        joints = joints[last - 2 : last + 1] if packet else np.full_like(joints[:3], np.nan)
        return alarms, float(moved.max(initial=0.0)), any(leaps), packet, joints

    measured = Recorder(LOGGED).measure(folder, watch_run, faults.index.tolist())
    alarms, *others = map(np.array, zip(*measured, strict=True))
    return Watched(dict(zip(thresholds, np.moveaxis(alarms, 1, 0), strict=True)), *others)


def attribute(joints: np.ndarray, limit_mm: float) -> np.ndarray:
    """Return which of MOTIONS each jump needs, bool [runs, 4]. A motion suffices if it alone makes
    both steps of the gold arm longer than the limit. `joints`: [runs, 3, 7] as in `Watched`.
    """
    before, after = joints[:, :-1], joints[:, 1:]  # [runs, 2 steps, 7]
    observed = np.arange(joints.shape[-1]) < len(JOINTS)

    def jumps(moving: np.ndarray) -> np.ndarray:
        lengths = np.linalg.norm(tips(np.where(moving, after, before)) - tips(before), axis=-1)
        return (lengths * 1e3 > limit_mm).all(axis=1)

    first, tool = jumps(observed), jumps(~observed)
    kinds = np.stack([first & ~tool, tool & ~first, first & tool, ~first & ~tool], axis=1)
    return kinds & np.isfinite(joints[:, :1, 0])


def visible_line(watched: Watched) -> Line:
    """Return a line on whether the published detector detects most of the predicted jumps."""
    alarms = watched.alarms[CHOSEN][watched.jump_packet > 0]
    told, none = int(alarms[:, 3].sum()), int((~alarms[:, :3].any(axis=1)).sum())
    return holds("visible", 2 * told > len(alarms), runs=len(alarms), told=told, none=none)


def jump_note(runs: VariantRuns, watched: Watched) -> str:
    """Write which joints cause the jumps."""
    jumped = int((watched.jump_packet > 0).sum())
    kinds = attribute(watched.joints, require_raven(runs.config).outcomes.jump_step_mm).sum(axis=0)
    needs = ", ".join(f"{count} need {kind}" for kind, count in zip(MOTIONS, kinds, strict=True))
    return f"Variant {runs.name}: {jumped} of {len(runs.frame)} runs have a jump. Of these {needs}."


class Scenario(NamedTuple):
    """The runs of a scenario's variants."""

    runs: Mapping[str, VariantRuns]  # the baseline first
    base: VariantRuns
    levels: Mapping[str, np.ndarray]  # the detector's thresholds
    watched: Watched  # the baseline

    @property
    def counted(self) -> list[VariantRuns]:
        """Return the baseline, the baseline with other rules for a jump, and the variants."""
        base, *others = self.runs.values()
        inside = in_window(base.frame, self.watched.jump_packet)
        window = "a jump counts only in packets t1 to t1 + d + 1 (t1: first of d faulty packets)"
        text = "a jump as in the paper's text: the tip moves more than 1 mm within two packets"
        return [
            base,
            base.counting(inside, "inside_window", window),
            base.counting(self.watched.leaps, "jump_text", text),
            *others,
        ]


def read_scenario(variants: Sequence[Variant], folders: Mapping[str, Path]) -> Scenario:
    """Read those variants that were run."""
    runs = {
        one.name: read_runs(one.name, folders[one.name], one.question)
        for one in variants
        if one.name in folders and one.name not in TRAINING
    }
    base, levels = next(iter(runs.values())), learn_thresholds(folders)
    return Scenario(runs, base, levels, watch(folders[base.name], base, levels))


def rate_rows(scenario: Scenario, published: Published, key: str) -> Iterator[tuple[Cell, ...]]:
    """Yield rates of both detectors, %: published, predicted before the comparison, computed."""
    jumped, stopped = (scenario.base.frame[hit].to_numpy() for hit in ("jump", "stop"))
    values = {"prevalence": jumped.mean()}
    fused = scenario.watched.alarms[COMPARED][:, 3]
    for name, told in {"raven": stopped, "model": fused}.items():
        values[f"{name}.tpr"] = told[jumped].mean()
        values[f"{name}.fpr"] = told[~jumped].mean()
        values[f"{name}.acc"] = (told == jumped).mean()
    for name, value in values.items():
        row = published.numbers.get(f"{key}.{name}")
        if row is not None:
            yield row["what"], row["value"], row["predicted"], round(100 * float(value), 1)
