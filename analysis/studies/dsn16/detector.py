"""Implements the published detector of DSN 2016: its thresholds, its alarms, and which joints make
the jumps that it should detect.

Thresholds are learned from fault-free steps. A step is the change from one logged row to the next,
of motor position, motor velocity and joint position of the first three joints. An alarm is raised
if, in one row, each of the three exceeds its threshold for some joint, for motor velocity in that
row and the next.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from ravenjax import threads
from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.file.config import validate_tables
from ravenjax.engines.cpu.engine import SimdKernel
from ravenjax.engines.interface import Block
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign.config import of_raven
from ravenjax.robots.raven2.campaign.trace import trace_series
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.stats.bootstrap.units import bootstrap
from ravenjax.store import manifest
from studies.dsn16.attacks import VariantCase, VariantRuns, holds, other_jump_rules, read_runs
from studies.study import Line, Published, StudyEstimate, Variant

T = TypeVar("T")
Series = Mapping[str, np.ndarray]
"""Maps a name to [ticks] or [ticks, k], with names as in `store.logs.time_series`."""


def measure(
    path: Path, measured: Callable[[int, Series], T], rows: Sequence[int] | None = None
) -> list[T]:
    """Return what `measured` computes for each of these rows (None: all) of the result folder
    `path`, from its index and its series.

    Each run is measured immediately and dropped, because its signals take about 2 MB per second of
    the run. Raises StoreError as `manifest.read_manifest` does.
    """
    compile_cache.enable_cache()
    ready = plan.make_plan(validate_tables(manifest.read_manifest(path).config))
    kernel = SimdKernel(ready.program, 1, compile_cache.object_cache(), signals=True)

    def one(row: int) -> T:
        _, signals = kernel.run_signals(Block(*ready.lanes([row], 1), None), ready.columns)
        return measured(row, trace_series(ready.program.setup, signals))

    return threads.map_in_threads(one, range(ready.runs) if rows is None else rows)


class Log(NamedTuple):
    """One run, with one row per packet."""

    packet: np.ndarray  # [rows] packet numbers
    mpos: np.ndarray  # [rows, 3] rad, as the control software reads them
    mvel: np.ndarray  # [rows, 3] rad/s
    jpos: np.ndarray  # [rows, 3] rad, rad, m
    tip: np.ndarray  # [rows, 3] um, whole numbers
    joints: np.ndarray  # [rows, 7] rad and m, all joints


def log(series: Series) -> Log:
    """Return the log from the gold arm's time series."""
    number = np.asarray(series["last_seq"])
    fresh = np.flatnonzero(np.diff(number, prepend=0))
    return Log(
        packet=number[fresh],
        mpos=series["gold/mpos"][fresh, :3],
        mvel=series["gold/mvel"][fresh, :3],
        jpos=series["gold/jpos"][fresh, :3],
        tip=np.rint(series["gold/position"][fresh] * 1e6),
        joints=series["gold/jpos"][fresh],
    )


VARIABLES = ("mpos", "mvel", "jpos")
JOINTS = ("shoulder", "elbow", "insertion")
UNITS = {"mpos": ("rad",) * 3, "mvel": ("rad/s",) * 3, "jpos": ("rad", "rad", "m")}

FIRST_PACKET = 500
"""First packet that is used. Before it the hands rest and the arm settles."""

TAIL = 20.0
"""Number of steps kept for the bootstrap, as a multiple of those above the percentile. No resample
of runs needs more.
"""
RESAMPLES = 1000
SEED = 2016


def steps(log: Log) -> np.ndarray:
    """Return |step| [rows - 1, 3 variables, 3 joints]. Row i is the change from row i of the log to
    the next.
    """
    return np.stack([np.abs(np.diff(getattr(log, name), axis=0)) for name in VARIABLES], axis=1)


class Learned(NamedTuple):
    """Steps of fault-free runs."""

    pooled: np.ndarray  # [runs, rows, 3, 3] |step|

    @property
    def maxima(self) -> np.ndarray:
        """Return the largest step of each run, [runs, 3, 3]."""
        return self.pooled.max(axis=1)

    def percentile(self, percent: float) -> np.ndarray:
        """Return the percentile of all steps of all runs, [3, 3]: the threshold of the published
        code.
        """
        return np.percentile(self.pooled, percent, axis=(0, 1))


def fault_free(log: Log) -> np.ndarray:
    """Return steps [rows, 3, 3] of a fault-free run after it has begun to move."""
    return steps(log)[log.packet[:-1] >= FIRST_PACKET]


def learn(runs: Iterable[np.ndarray]) -> Learned:
    """Pool the results of `fault_free` for several runs. Raises ValueError for no runs."""
    return Learned(stacked(list(runs)))


def stacked(series: Sequence[np.ndarray]) -> np.ndarray:
    """Stack series [rows, ..] of runs to [runs, rows, ..], each cut to the shortest, because runs
    differ in their number of packets.
    """
    if not series:
        raise ValueError("thresholds are learned from at least one run, got none")
    rows = min(map(len, series))
    return np.stack([one[:rows] for one in series])


def pooled_interval(values: np.ndarray, percent: float, confidence: float = 0.95) -> StudyEstimate:
    """Return a percentile of `values` [runs, rows] with a block bootstrap: runs are drawn, and
    their rows stay together.
    """
    runs, rows = values.shape
    flat, owner = values.ravel(), np.repeat(np.arange(runs), rows)
    beyond = (1.0 - percent / 100.0) * flat.size
    tail = np.argsort(flat)[::-1][: max(1, math.ceil(TAIL * beyond))]
    largest, owner = flat[tail], owner[tail]

    def quantile(indices: np.ndarray) -> np.ndarray:
        times = np.stack(
            [np.bincount(index, minlength=runs) for index in indices]
        )  # how often each run was drawn
        passed = np.cumsum(times[:, owner], axis=1)  # steps at least as large, in each resample
        return largest[np.minimum((passed <= beyond).sum(axis=1), len(largest) - 1)]

    band = bootstrap(runs, quantile, confidence, resamples=RESAMPLES, seed=SEED, batch=50)
    return StudyEstimate(
        float(np.percentile(flat, percent)), float(band.low), float(band.high), runs, "runs"
    )


def maxima_interval(maxima: np.ndarray, percent: float, confidence: float = 0.95) -> StudyEstimate:
    """Return a percentile of the runs' maxima [runs] with its order-statistic interval. An end that
    no run can give is NaN.
    """
    from scipy.stats import quantile_test

    interval = quantile_test(maxima, p=percent / 100.0).confidence_interval(confidence)
    low, high = (
        float(end) if math.isfinite(end) else math.nan for end in (interval.low, interval.high)
    )
    return StudyEstimate(float(np.percentile(maxima, percent)), low, high, len(maxima), "runs")


def run_alarms(log: Log, thresholds: np.ndarray, start: int, duration: int) -> np.ndarray:
    """Return which alarms of one run come in the published window of a fault in packets `start` to
    `start + duration - 1`, bool [4]: motor position, motor velocity, joint position, all in one
    row. `thresholds`: [3, 3].
    """
    # Each [rows - 1], true if any joint exceeds its threshold.
    position, velocity, joint = np.any(steps(log) > thresholds, axis=2).T
    velocity = velocity & np.append(velocity[1:], False)
    over = np.stack([position, velocity, joint, position & velocity & joint], axis=1)
    return over[window(log, start, duration)].any(axis=0)


def window(log: Log, start: int, duration: int) -> np.ndarray:
    """Return the steps of packets t1 to t1 + d + 1, bool [rows - 1]."""
    packet = log.packet[:-1]
    return (packet >= start) & (packet <= start + duration + 1)


TRAINING = (
    Variant(
        "training_suture",
        "dsn16_thresholds.toml",
        (),
        "fault-free runs for the detector, first motion",
    ),
    Variant(
        "training_peg_transfer",
        "dsn16_thresholds.toml",
        ("operator.motion=peg_transfer",),
        "fault-free runs for the detector, second motion",
    ),
)
"""Two motions of 300 runs each, like the 600 runs of the publication."""

LEAP_UM = 1000.0

CHOSEN, COMPARED = "99.9 % of all steps", "99.8 % of all steps"
"""The threshold that statements of the text are counted with, and the one of the published rates:
the publication names both.
"""


class Watched(NamedTuple):
    """The detector's results for the runs of one variant, in the order of its frame."""

    alarms: Mapping[str, np.ndarray]  # maps a threshold in words to `run_alarms` [runs, 4]
    # [runs] largest step of motor velocity inside the window, divided by its CHOSEN threshold.
    largest_mvel: np.ndarray
    # bool [runs]: the reported tip moved more than 1 mm within two packets, the text's definition
    # of a jump.
    leaps: np.ndarray
    # [runs, 3, 7] rad and m, reported in the packets of the first jump's steps; NaN: no jump.
    joints: np.ndarray


def learn_from_folders(folders: Mapping[str, Path]) -> Learned:
    """Learn from the training campaigns that exist."""
    steps: list[np.ndarray] = []
    for variant in TRAINING:
        if variant.name in folders:
            steps += measure(folders[variant.name], lambda _, series: fault_free(log(series)))
    return learn(steps)


def thresholds(learned: Learned) -> dict[str, np.ndarray]:
    """Return CHOSEN and COMPARED, [3, 3] each."""
    return {name: learned.percentile(float(name.split()[0])) for name in (CHOSEN, COMPARED)}


def watch(folder: Path, runs: VariantRuns, thresholds: Mapping[str, np.ndarray]) -> Watched:
    """Run the detector on every faulty run of a folder."""
    columns = (runs.start.tolist(), runs.duration.tolist(), runs.jump_packet.tolist())
    faults = dict(zip(runs.index.tolist(), zip(*columns, strict=True), strict=True))

    def one(row: int, series: Series) -> tuple[list[np.ndarray], float, bool, np.ndarray]:
        trace, (first, lasts, ended) = log(series), faults[row]
        moved = steps(trace)[window(trace, first, lasts), 1] / thresholds[CHOSEN][1]
        alarms = [run_alarms(trace, level, first, lasts) for level in thresholds.values()]
        return alarms, float(moved.max(initial=0.0)), leaps(trace), jump_steps(trace, ended)

    alarms, *others = zip(*measure(folder, one, runs.index.tolist()), strict=True)
    by_threshold = dict(zip(thresholds, np.stack(alarms, axis=1), strict=True))
    return Watched(by_threshold, *map(np.array, others))


def jump_steps(found: Log, ended: int) -> np.ndarray:
    """Return joints [3, 7] in the packets of a jump's two steps, of which the second ends in packet
    `ended`; NaN if `ended` is 0.
    """
    if not ended:
        return np.full((3, found.joints.shape[1]), np.nan)
    row = int(np.searchsorted(found.packet, ended))
    return found.joints[row - 2 : row + 1].astype(float)


def leaps(found: Log) -> bool:
    """Return whether the reported tip moves more than 1 mm within one packet or two: a jump by the
    publication's text.
    """
    return any(
        bool((np.linalg.norm(found.tip[rows:] - found.tip[:-rows], axis=1) > LEAP_UM).any())
        for rows in (1, 2)
    )


POSITIONING = 3
"""Number of joints that the detector observes, from the first on."""

KINDS = "joints 1-3 alone", "the tool joints alone", "either", "both together only"
"""Which joints make the two long steps of a jump."""


def attribute(joints: np.ndarray, limit_mm: float) -> np.ndarray:
    """Return which of KINDS each jump is, bool [runs, 4]: what still exceeds the limit if only some
    joints move. Runs without a jump are none.

    `joints`: [runs, 3, 7] (rad, m) of the gold arm, reported in the three packets of a jump.
    `limit_mm`: limit of a step.
    """
    before, after = joints[:, :-1], joints[:, 1:]  # [runs, 2 steps, 7]

    def jumps(part: slice) -> np.ndarray:
        lengths = np.linalg.norm(_tip(_moved(before, after, part)) - _tip(before), axis=-1)
        return (lengths * 1e3 > limit_mm).all(axis=1)

    jumped = np.isfinite(joints[:, 0, 0])
    first, tool = jumps(slice(0, POSITIONING)), jumps(slice(POSITIONING, None))
    kinds = np.stack([first & ~tool, tool & ~first, first & tool, ~first & ~tool], axis=1)
    return kinds & jumped[:, None]


def _moved(before: np.ndarray, after: np.ndarray, part: slice) -> np.ndarray:
    result = before.copy()
    result[..., part] = after[..., part]
    return result


def _tip(joints: np.ndarray) -> np.ndarray:
    """Return tips [.., 3] m of joints [.., 7]."""
    with jax.enable_x64(True):
        position = kinematics.forward_pose("gold", Vec(np.moveaxis(joints, -1, 0))).position
    return np.stack([np.asarray(x) for x in position], axis=-1)


def visible_line(runs: VariantRuns, watched: Watched) -> Line:
    """Return a line on whether the published detector can see most of the predicted jumps. Jumps
    that it cannot see are not in its published score.
    """
    jumped, alarms = runs.jump_packet > 0, watched.alarms[CHOSEN]
    count, fused = int(jumped.sum()), int((jumped & alarms[:, 3]).sum())
    none = int((jumped & ~alarms[:, :3].any(axis=1)).sum())
    return holds(
        "the predicted jumps are ones that the published detector can see",
        None,
        2 * fused > count,
        f"counted as: it tells more than half of the {count} runs that jump; it tells {fused}, and"
        f" in {none} none of its variables passes its threshold",
    )


def jump_note(runs: VariantRuns, watched: Watched) -> str:
    """Say which joints make the jumps."""
    jumped = int((runs.jump_packet > 0).sum())
    if not jumped:
        return f"{runs.name}: no run jumps."
    kinds = attribute(watched.joints, of_raven(runs.config).outcomes.jump_step_mm).sum(axis=0)
    listed = ", by ".join(f"{kind} {count}" for kind, count in zip(KINDS, kinds, strict=True))
    return f"{runs.name}: {jumped} of {len(runs.index)} runs jump, by {listed}."


class Scenario(NamedTuple):
    """The runs of a scenario's variants."""

    runs: Mapping[str, VariantRuns]  # the baseline first
    cases: Sequence[VariantCase]  # the others
    levels: Mapping[str, np.ndarray]  # the detector's thresholds
    watched: Watched  # the baseline
    rules: Sequence[VariantCase]  # the baseline with other rules for a jump

    @property
    def base(self) -> VariantRuns:
        """Return the baseline."""
        return next(iter(self.runs.values()))


def read_scenario(variants: Sequence[Variant], folders: Mapping[str, Path]) -> Scenario:
    """Read those variants that were run."""
    trained = [one.name for one in TRAINING]
    mine = [one for one in variants if one.name in folders and one.name not in trained]
    runs = {one.name: read_runs(one.name, folders[one.name]) for one in mine}
    levels, first = thresholds(learn_from_folders(folders)), mine[0].name
    watched = watch(folders[first], runs[first], levels)
    cases = [VariantCase(runs[one.name], one.question) for one in mine[1:]]
    rules = other_jump_rules(runs[first], watched.leaps)
    return Scenario(runs, cases, levels, watched, rules)


def rate_rows(
    scenario: Scenario, published: Published, key: str
) -> Iterator[tuple[str | float, ...]]:
    """Yield the published rates of both detectors, %, and the predicted ones: as frozen before
    anybody compared, and as computed now.
    """
    jumped, fused = scenario.base.hits["jump"], scenario.watched.alarms[COMPARED][:, 3]
    values = {"prevalence": jumped.mean()}
    for name, told in {"raven": scenario.base.hits["stop"], "model": fused}.items():
        values[f"{name}.tpr"] = told[jumped].mean()
        values[f"{name}.fpr"] = told[~jumped].mean()
        values[f"{name}.acc"] = (told == jumped).mean()
    for name, value in values.items():
        row = published.numbers.get(f"{key}.{name}")
        if row is not None:
            yield row["what"], row["value"], row["predicted"], round(100 * float(value), 1)
