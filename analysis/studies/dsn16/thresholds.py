"""Study of the thresholds that the detector of the targeted attacks (DSN 2016) learns from
fault-free runs, and of their uncertainty.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.stats.units import bootstrap
from studies import study
from studies.dsn16 import detector
from studies.dsn16.detector import JOINTS, VARIABLES, stacked
from studies.series import Recorder, Row, Series
from studies.study import Line, Published, StudyEstimate, read_table

NAME, MOTIONS = "dsn16_thresholds", ("suture", "peg_transfer")
"""The two motions of 300 runs each; other variants have fewer runs."""
NAMES = {"mpos": "motor position", "mvel": "motor velocity", "jpos": "joint position"}
"""Variables whose steps were published."""
UNITS = {"mpos": ("rad",) * 3, "mvel": ("rad/s",) * 3, "jpos": ("rad", "rad", "m")}
PERCENTILES = (99.8, 99.9)
TAIL = 20.0
"""Number of steps kept for the bootstrap, as a multiple of those above the percentile."""
RESAMPLES = 1000
SEED = 2016
INTEGRATORS = {"suture": "euler", "substeps_4": "rk4", "substeps_10": "converged"}
"""Maps a variant to the integrator of a second implementation with which it is compared."""
VARIANTS = study.read_variants(NAME)


class FaultFree(NamedTuple):
    """Steps of one run after it has begun to move; of a variant's runs: runs first."""

    steps: np.ndarray  # [rows, 3 variables, 3 joints] |step|
    tip: np.ndarray  # [rows, 3] um, steps of the reported tip


def measure_run(_: Row, series: Series) -> FaultFree:
    """Measure a fault-free run from its series."""
    rows = detector.log(series)
    tip = np.diff(detector.reported_tip(rows), axis=0)
    return FaultFree(detector.fault_free(rows), tip[rows["last_seq"][:-1] >= detector.FIRST_PACKET])


def deviation(values: np.ndarray) -> StudyEstimate:
    """Return the standard deviation about 0 of steps [runs, ..], with its range over runs."""
    by_run = np.sqrt(np.mean(np.square(values.reshape(len(values), -1), dtype=float), axis=1))
    return _over_runs(float(np.sqrt(np.mean(by_run**2))), by_run)


def _over_runs(value: float, by_run: np.ndarray) -> StudyEstimate:
    """Return a value with the range of the runs [n]."""
    return StudyEstimate(value, float(by_run.min()), float(by_run.max()), len(by_run), "runs")


def pooled_interval(values: np.ndarray, percent: float) -> StudyEstimate:
    """Return a percentile of `values` [runs, rows] with a 95 % bootstrap over runs."""
    runs, rows = values.shape
    flat, owner = values.ravel(), np.repeat(np.arange(runs), rows)
    beyond = (1.0 - percent / 100.0) * flat.size
    tail = np.argsort(flat)[::-1][: max(1, math.ceil(TAIL * beyond))]
    largest, owner = flat[tail], owner[tail]

    def quantile(indices: np.ndarray) -> np.ndarray:
        # How often each run was drawn, and steps at least as large, in each resample.
        times = np.stack([np.bincount(index, minlength=runs) for index in indices])
        passed = np.cumsum(times[:, owner], axis=1)
        return largest[np.minimum((passed <= beyond).sum(axis=1), len(largest) - 1)]

    band = bootstrap(runs, quantile, resamples=RESAMPLES, seed=SEED, batch=50)
    value = float(np.percentile(flat, percent))
    return StudyEstimate(value, float(band.low), float(band.high), runs, "runs")


def maxima_interval(maxima: np.ndarray, percent: float) -> StudyEstimate:
    """Return a percentile of maxima [runs] with its 95 % order-statistic interval."""
    from scipy.stats import quantile_test

    interval = quantile_test(maxima, p=percent / 100.0).confidence_interval(0.95)
    value, (low, high) = float(np.percentile(maxima, percent)), map(float, interval)
    return StudyEstimate(value, low, high, len(maxima), "runs")


def compare(context: study.Context) -> study.Findings:
    """Compare fault-free steps with the published ones, and show thresholds."""
    published, found, recorder = Published("dsn16"), {}, Recorder(detector.LOGGED)
    for variant in VARIANTS:
        if variant.name in context.folders:
            measured = recorder.measure(context.folders[variant.name], measure_run)
            found[variant.name] = FaultFree(*map(stacked, zip(*measured, strict=True)))
    both = stacked([run for name in MOTIONS for run in found[name].steps])
    numbers = {"runs": len(both), "first": detector.FIRST_PACKET}
    return study.Findings(
        tuple(_lines(found, published)),
        (
            read_table(NAME, "thresholds", _thresholds(both), **numbers),
            read_table(NAME, "sensitivity", _sensitivity(found, published)),
        ),
        study.read_notes(NAME),
    )


def _lines(found: Mapping[str, FaultFree], published: Published) -> Iterator[Line]:
    words = "standard deviation of the change per packet"
    for name in MOTIONS:
        for v, variable in enumerate(VARIABLES[:2]):
            for j, joint in enumerate(JOINTS):
                reference = published.estimate(f"step.{variable}.{joint}")
                predicted = deviation(found[name].steps[:, :, v, j])
                share = f"{predicted.value / reference.value:.2f} times the published value"
                quantity = f"{words}, {NAMES[variable]}, {joint}, motion {name}"
                reason = f"{share}; the motions differ"
                yield Line(quantity, UNITS[variable][j], reference, predicted, reason=reason)
        quantity, tip = f"{words}, tip, per axis, motion {name}", deviation(found[name].tip)
        yield Line(quantity, "um", published.estimate("step.tip"), tip)
    reason = "generated motion of the hands is smooth; the published trajectories contain steps"
    for key in ("mpos.shoulder", "mvel.shoulder", "mvel.elbow", "mvel.insertion"):
        variable, joint = key.split(".")
        place = VARIABLES.index(variable), JOINTS.index(joint)
        largest = found[MOTIONS[0]].steps.max(axis=1)[:, *place]
        quantity = f"largest change per packet, {NAMES[variable]}, {joint}, motion {MOTIONS[0]}"
        predicted = _over_runs(float(largest.max()), largest)
        reference = published.estimate(f"largest.{key}")
        yield Line(quantity, UNITS[variable][0], reference, predicted, reason=reason)
    reason = "the simulation integrates implicitly: changes come from the motion, not the time step"
    # Published: a second implementation of the model, by its integrator
    for name in (name for name in INTEGRATORS if name in found):
        key = INTEGRATORS[name]
        method = published.numbers[f"integrator.{key}"]["what"]
        quantity = f"{words}, motor velocity, insertion, variant {name} compared with {method}"
        predicted = deviation(found[name].steps[:, :, VARIABLES.index("mvel"), 2])
        reference = published.estimate(f"integrator.{key}")
        yield Line(quantity, "rad/s", reference, predicted, reason=reason)


def _thresholds(steps: np.ndarray) -> Iterator[Sequence[str | float]]:
    """Yield rows of steps [runs, rows, 3, 3]."""
    for v, variable in enumerate(VARIABLES):
        for j, joint in enumerate(JOINTS):
            values = steps[:, :, v, j]
            maxima = values.max(axis=1)
            for percent in PERCENTILES:
                code, text = pooled_interval(values, percent), maxima_interval(maxima, percent)
                shown = map(_shown, (code, text, maxima_interval(maxima, 50.0)))
                name = f"{NAMES[variable]}, {joint}, {UNITS[variable][j]}"
                yield name, percent, *shown, f"{text.value / code.value:.3f}"


def _shown(estimate: StudyEstimate) -> str:
    ends = (f"{end:.4g}" if math.isfinite(end) else "-" for end in (estimate.low, estimate.high))
    return f"{estimate.value:.4g} [{', '.join(ends)}]"


def _sensitivity(
    found: Mapping[str, FaultFree], published: Published
) -> Iterator[tuple[str | int | float, ...]]:
    questions = {variant.name: variant.question for variant in VARIANTS}
    keys = [f"step.{variable}.{joint}" for variable in VARIABLES[:2] for joint in JOINTS]
    reference = map(published.value, (*keys, "step.tip"))
    yield "published", "", "", *reference, *("not published",) * 6
    for name, (steps, tip) in found.items():
        spread = [deviation(steps[:, :, v, j]).value for v in (0, 1) for j in range(3)]
        level = np.percentile(steps, 99.9, axis=(0, 1))[:2].ravel()
        numbers = (float(f"{x:.3g}") for x in (*spread, deviation(tip).value, *level))
        yield name, questions[name], len(steps), *numbers


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
