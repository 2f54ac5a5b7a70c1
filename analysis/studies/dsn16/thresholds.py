"""Study: which thresholds does the detector of the targeted attacks (DSN 2016) learn from
fault-free runs, and how certain are they?
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from studies.dsn16 import detector
from studies.dsn16.detector import JOINTS, UNITS, VARIABLES, Learned, Log, Series, log, measure
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    Table,
    read_notes,
    read_table,
    read_variants,
    study,
)

NAME, BASELINE = "dsn16_thresholds", "suture"
NAMES = {"mpos": "motor position", "mvel": "motor velocity", "jpos": "joint position"}
"""Variables whose steps were published."""


def deviation(values: np.ndarray) -> StudyEstimate:
    """Return the standard deviation about 0 of steps [runs, rows], with its range over runs. The
    mean of steps is negligible.
    """
    by_run = np.sqrt(np.mean(np.square(values, dtype=float), axis=1))
    return StudyEstimate(
        float(np.sqrt(np.mean(by_run**2))),
        float(by_run.min()),
        float(by_run.max()),
        len(by_run),
        "runs",
    )


SECOND = "peg_transfer"
PERCENTILES = (99.8, 99.9)


VARIANTS = read_variants(NAME)
"""Two motions of 300 runs, and fewer runs of all others."""


def compare(context: Context) -> Findings:
    """Compare fault-free steps with the published ones, and show thresholds, which were not
    published.
    """
    published = Published("dsn16")
    learned, tips, runs_of = {}, {}, {}
    for variant in VARIANTS:
        if variant.name in context.folders:
            measured = measure(context.folders[variant.name], _measured)
            learned[variant.name] = detector.learn(one.steps for one in measured)
            tips[variant.name] = detector.stacked([one.tip for one in measured])
            runs_of[variant.name] = measured
    both = _joined([learned[name] for name in (BASELINE, SECOND) if name in learned])
    lines = [
        *_spread(learned, tips, published),
        *_largest(learned, published),
        *_integrator(learned, published),
    ]
    lines += _tracking(runs_of, published)
    tables = _thresholds(both), _sensitivity(learned, tips, published)
    return Findings(tuple(lines), tables, read_notes(NAME))


def _joined(motions: Sequence[Learned]) -> Learned:
    return detector.learn(run for motion in motions for run in motion.pooled)


class FaultFree(NamedTuple):
    """Measurements of one run after it has begun to move."""

    steps: np.ndarray  # [rows, 3 variables, 3 joints] |step|
    tip: np.ndarray  # [rows, 3] um, steps of the reported tip
    error: np.ndarray  # [3] rad, root mean square of desired minus measured motor position
    dac: np.ndarray  # [3] counts, standard deviation of the commands
    # Mean and largest distance of the reported tip from the desired one.
    distance_mm: tuple[float, float]


def _measured(row: int, series: Series) -> FaultFree:
    trace, moving = log(series), np.asarray(series["last_seq"]) >= detector.FIRST_PACKET
    error = (series["gold/mpos_d"] - series["gold/mpos"])[moving, :3]
    distance = (
        np.linalg.norm((series["gold/position_d"] - series["gold/position"])[moving], axis=1) * 1e3
    )
    return FaultFree(
        steps=detector.fault_free(trace),
        tip=tip_steps(trace),
        error=np.sqrt(np.mean(np.square(error, dtype=float), axis=0)),
        dac=np.std(series["gold/dac_cnt"][moving, :3].astype(float), axis=0),
        distance_mm=(float(distance.mean()), float(distance.max())),
    )


def tip_steps(found: Log) -> np.ndarray:
    """Return steps of the reported tip [rows, 3] um, of a fault-free run after it has begun to
    move.
    """
    return np.diff(found.tip, axis=0)[found.packet[:-1] >= detector.FIRST_PACKET]


def _spread(
    learned: Mapping[str, Learned], tips: Mapping[str, np.ndarray], published: Published
) -> Iterator[Line]:
    for name in (name for name in (BASELINE, SECOND) if name in learned):
        for v in ("mpos", "mvel"):
            for j, joint in enumerate(JOINTS):
                predicted = deviation(learned[name].pooled[:, :, VARIABLES.index(v), j])
                reference = published.estimate(f"step.{v}.{joint}")
                yield Line(
                    f"standard deviation of a step, {NAMES[v]}, {joint}; {name}",
                    UNITS[v][j],
                    reference,
                    predicted,
                    reason=(
                        f"{predicted.value / reference.value:.2f} of the published one: another"
                        " motion"
                    ),
                )
        tip = tips[name]
        predicted = deviation(tip.reshape(len(tip), -1))
        yield Line(
            f"standard deviation of a step, tip, per axis; {name}",
            "um",
            published.estimate("step.tip"),
            predicted,
        )


def _largest(learned: Mapping[str, Learned], published: Published) -> Iterator[Line]:
    for key in ("mpos.shoulder", "mvel.shoulder", "mvel.elbow", "mvel.insertion"):
        v, joint = key.split(".")
        j = JOINTS.index(joint)
        maxima = learned[BASELINE].maxima[:, VARIABLES.index(v), j]
        yield Line(
            f"largest step, {NAMES[v]}, {joint}; {BASELINE}",
            UNITS[v][j],
            published.estimate(f"largest.{key}"),
            StudyEstimate(
                float(maxima.max()), float(maxima.min()), float(maxima.max()), len(maxima), "runs"
            ),
            reason=(
                "generated hands move smoothly; the published trajectories have steps of their own"
            ),
        )


def _integrator(learned: Mapping[str, Learned], published: Published) -> Iterator[Line]:
    """Return velocity steps of the insertion by plant steps per millisecond, compared with a
    rebuild's by integrator.
    """
    for name, key in ((BASELINE, "euler"), ("substeps_4", "rk4"), ("substeps_10", "converged")):
        if name in learned:
            yield Line(
                f"standard deviation of a step, motor velocity, insertion; {name} beside {key}",
                "rad/s",
                published.estimate(f"integrator.{key}"),
                deviation(learned[name].pooled[:, :, VARIABLES.index("mvel"), 2]),
                reason=(
                    "an implicit step, not explicit Euler: these steps are the motion's, whatever"
                    " the plant's step"
                ),
            )


def _tracking(runs_of: Mapping[str, Sequence[FaultFree]], published: Published) -> Iterator[Line]:
    """Return how well motors and tip follow, compared with a rebuild that followed the recording of
    one published trajectory.
    """
    reason = "another motion"
    for name in (name for name in (BASELINE, SECOND) if name in runs_of):
        for j, joint in enumerate(JOINTS):
            key, error, dac = published.estimate(f"rms.{joint}"), *_over(runs_of[name], j)
            yield Line(
                f"motor error, root mean square, {joint}; {name}", "rad", key, error, reason=reason
            )
            reference = published.estimate(f"dac.{joint}")
            yield Line(
                f"DAC command, standard deviation, {joint}; {name}",
                "counts",
                reference,
                dac,
                reason=reason,
            )
        for k, key in enumerate(("mean", "largest")):
            values = [one.distance_mm[k] for one in runs_of[name]]
            reference = published.estimate(f"tip_error.{key}")
            yield Line(
                f"tip from desired tip, {key}; {name}",
                "mm",
                reference,
                _range(values),
                reason=reason,
            )


def _over(runs: Sequence[FaultFree], joint: int) -> tuple[StudyEstimate, StudyEstimate]:
    return _range([float(one.error[joint]) for one in runs]), _range(
        [float(one.dac[joint]) for one in runs]
    )


def _range(values: Sequence[float]) -> StudyEstimate:
    return StudyEstimate(float(np.mean(values)), min(values), max(values), len(values), "runs")


def _thresholds(learned: Learned) -> Table:
    rows = []
    for v, variable in enumerate(VARIABLES):
        for j, joint in enumerate(JOINTS):
            values = learned.pooled[:, :, v, j]
            for percent in PERCENTILES:
                pooled = detector.pooled_interval(values, percent)
                text = detector.maxima_interval(learned.maxima[:, v, j], percent)
                middle = detector.maxima_interval(learned.maxima[:, v, j], 50.0)
                rows.append(
                    (
                        f"{NAMES[variable]}, {joint}, {UNITS[variable][j]}",
                        percent,
                        *(_shown(e) for e in (pooled, text, middle)),
                        f"{text.value / pooled.value:.3f}",
                    )
                )
    return read_table(
        NAME, "thresholds", rows, runs=len(learned.pooled), first=detector.FIRST_PACKET
    )


def _shown(estimate: StudyEstimate) -> str:
    ends = ["-" if math.isnan(end) else f"{end:.4g}" for end in (estimate.low, estimate.high)]
    return f"{estimate.value:.4g} [{ends[0]}, {ends[1]}]"


def _sensitivity(
    learned: Mapping[str, Learned], tips: Mapping[str, np.ndarray], published: Published
) -> Table:
    questions = {variant.name: variant.question for variant in VARIANTS}
    reference = [published.value(f"step.{v}.{joint}") for v in ("mpos", "mvel") for joint in JOINTS]
    rows: list[tuple[str | int | float, ...]] = [
        ("published", "", "", *reference, published.value("step.tip"), *("not published",) * 6)
    ]
    for name, one in learned.items():
        spread = [deviation(one.pooled[:, :, v, j]).value for v in (0, 1) for j in range(3)]
        tip = deviation(tips[name].reshape(len(tips[name]), -1)).value
        level = one.percentile(99.9)[:2].ravel()
        numbers = (float(f"{x:.3g}") for x in (*spread, tip, *level))
        rows.append((name, questions[name], len(one.pooled), *numbers))
    return read_table(NAME, "sensitivity", rows)


STUDY = study(NAME, variants=VARIANTS, compare=compare)
