"""Study: which thresholds does the detector of the targeted attacks (DSN 2016) learn from
fault-free runs, and how certain are they?
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.stats.bootstrap.units import bootstrap
from studies import study
from studies.dsn16 import detector
from studies.dsn16.detector import JOINTS, VARIABLES, log, stacked
from studies.series import Recorder, Row, Series
from studies.study import Line, Published, StudyEstimate, read_table

NAME, MOTIONS = "dsn16_thresholds", ("suture", "peg_transfer")
"""The two motions of 300 runs each; other variants have fewer runs."""
BASELINE = MOTIONS[0]
NAMES = {"mpos": "motor position", "mvel": "motor velocity", "jpos": "joint position"}
"""Variables whose steps were published."""
UNITS = {"mpos": ("rad",) * 3, "mvel": ("rad/s",) * 3, "jpos": ("rad", "rad", "m")}
PERCENTILES = (99.8, 99.9)
TAIL = 20.0
"""Number of steps kept for the bootstrap, as a multiple of those above the percentile. No resample
of runs needs more.
"""
RESAMPLES = 1000
SEED = 2016
INTEGRATORS = {"suture": "euler", "substeps_4": "rk4", "substeps_10": "converged"}
"""Maps a variant to the integrator of a rebuild beside which its steps are shown."""
VARIANTS = study.read_variants(NAME)


class FaultFree(NamedTuple):
    """Measurements of one run after it has begun to move; of a variant's runs: runs first."""

    steps: np.ndarray  # [rows, 3 variables, 3 joints] |step|
    tip: np.ndarray  # [rows, 3] um, steps of the reported tip
    error: np.ndarray  # [3] rad, root mean square of desired minus measured motor position
    dac: np.ndarray  # [3] counts, standard deviation of the commands
    distance_mm: np.ndarray  # [2] mean and largest distance of the reported tip from the desired


def measure_run(_: Row, series: Series) -> FaultFree:
    """Measure a fault-free run from its series."""
    trace, moving = log(series), series["last_seq"] >= detector.FIRST_PACKET
    error = (series["mpos_d"] - series["mpos"])[moving, :3]
    apart = (series["position_d"] - series["position"])[moving]
    distance = np.linalg.norm(apart, axis=1) * 1e3
    return FaultFree(
        steps=detector.fault_free(trace),
        tip=np.diff(trace.tip, axis=0)[trace.packet[:-1] >= detector.FIRST_PACKET],
        error=np.sqrt(np.mean(np.square(error, dtype=float), axis=0)),
        dac=np.std(series["dac_cnt"][moving, :3].astype(float), axis=0),
        distance_mm=np.array((distance.mean(), distance.max())),
    )


def deviation(values: np.ndarray) -> StudyEstimate:
    """Return the standard deviation about 0 of steps [runs, ..], with its range over runs. The
    mean of steps is negligible.
    """
    by_run = np.sqrt(np.mean(np.square(values.reshape(len(values), -1), dtype=float), axis=1))
    return _over_runs(float(np.sqrt(np.mean(by_run**2))), by_run)


def _over_runs(value: float, by_run: np.ndarray) -> StudyEstimate:
    """Return a value with the range of the runs [n]."""
    return StudyEstimate(value, float(by_run.min()), float(by_run.max()), len(by_run), "runs")


def pooled_interval(values: np.ndarray, percent: float) -> StudyEstimate:
    """Return a percentile of `values` [runs, rows] with a 95 % block bootstrap: runs are drawn, and
    their rows stay together.
    """
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
    """Return a percentile of the runs' maxima [runs] with its 95 % order-statistic interval. An end
    that no run can give is infinite or NaN.
    """
    from scipy.stats import quantile_test

    interval = quantile_test(maxima, p=percent / 100.0).confidence_interval(0.95)
    value, (low, high) = float(np.percentile(maxima, percent)), map(float, interval)
    return StudyEstimate(value, low, high, len(maxima), "runs")


def compare(context: study.Context) -> study.Findings:
    """Compare fault-free steps with the published ones, and show thresholds, which were not
    published.
    """
    published, found = Published("dsn16"), {}
    recorder = Recorder((*detector.LOGGED, "mpos_d", "position_d", "dac_cnt"))
    for variant in VARIANTS:
        if variant.name in context.folders:
            measured = recorder.measure(context.folders[variant.name], measure_run)
            steps, tip, *others = zip(*measured, strict=True)
            found[variant.name] = FaultFree(stacked(steps), stacked(tip), *map(np.array, others))
    both = stacked([run for name in MOTIONS if name in found for run in found[name].steps])
    rows = _sensitivity(found, published)
    return study.Findings(
        (
            *_spread(found, published),
            *_largest(found[BASELINE].steps.max(axis=1), published),
            *_integrator(found, published),
            *_tracking(found, published),
        ),
        (
            read_table(
                NAME, "thresholds", _thresholds(both), runs=len(both), first=detector.FIRST_PACKET
            ),
            read_table(NAME, "sensitivity", rows),
        ),
        study.read_notes(NAME),
    )


def _spread(found: Mapping[str, FaultFree], published: Published) -> Iterator[Line]:
    words = "standard deviation of a step"
    for name in (name for name in MOTIONS if name in found):
        for v, variable in enumerate(VARIABLES[:2]):
            for j, joint in enumerate(JOINTS):
                predicted = deviation(found[name].steps[:, :, v, j])
                reference = published.estimate(f"step.{variable}.{joint}")
                yield Line(
                    f"{words}, {NAMES[variable]}, {joint}; {name}",
                    UNITS[variable][j],
                    reference,
                    predicted,
                    reason=f"{predicted.value / reference.value:.2f} of the published one: another"
                    " motion",
                )
        tip = deviation(found[name].tip)
        yield Line(f"{words}, tip, per axis; {name}", "um", published.estimate("step.tip"), tip)


def _largest(maxima: np.ndarray, published: Published) -> Iterator[Line]:
    """Yield the largest steps, of maxima [runs, 3, 3]."""
    for key in ("mpos.shoulder", "mvel.shoulder", "mvel.elbow", "mvel.insertion"):
        variable, joint = key.split(".")
        mine = maxima[:, VARIABLES.index(variable), JOINTS.index(joint)]
        yield Line(
            f"largest step, {NAMES[variable]}, {joint}; {BASELINE}",
            UNITS[variable][0],
            published.estimate(f"largest.{key}"),
            _over_runs(float(mine.max()), mine),
            reason="generated hands move smoothly; the published trajectories have steps of their"
            " own",
        )


def _integrator(found: Mapping[str, FaultFree], published: Published) -> Iterator[Line]:
    """Yield velocity steps of the insertion by plant steps per millisecond, compared with a
    rebuild's by integrator.
    """
    for name, key in INTEGRATORS.items():
        if name in found:
            yield Line(
                f"standard deviation of a step, motor velocity, insertion; {name} beside {key}",
                "rad/s",
                published.estimate(f"integrator.{key}"),
                deviation(found[name].steps[:, :, VARIABLES.index("mvel"), 2]),
                reason="an implicit step, not explicit Euler: these steps are the motion's,"
                " whatever the plant's step",
            )


def _tracking(found: Mapping[str, FaultFree], published: Published) -> Iterator[Line]:
    """Yield how well motors and tip follow, compared with a rebuild that followed the recording of
    one published trajectory.
    """
    for name in (name for name in MOTIONS if name in found):
        runs, lines = found[name], []
        for j, joint in enumerate(JOINTS):
            error, dac = runs.error[:, j], runs.dac[:, j]
            lines.append((f"motor error, root mean square, {joint}", "rad", f"rms.{joint}", error))
            words = f"DAC command, standard deviation, {joint}"
            lines.append((words, "counts", f"dac.{joint}", dac))
        for k, key in enumerate(("mean", "largest")):
            words = f"tip from desired tip, {key}"
            lines.append((words, "mm", f"tip_error.{key}", runs.distance_mm[:, k]))
        for words, unit, key, by_run in lines:
            predicted = _over_runs(float(by_run.mean()), by_run)
            reference = published.estimate(key)
            yield Line(f"{words}; {name}", unit, reference, predicted, reason="another motion")


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
    for name, (steps, tip, *_) in found.items():
        spread = [deviation(steps[:, :, v, j]).value for v in (0, 1) for j in range(3)]
        level = np.percentile(steps, 99.9, axis=(0, 1))[:2].ravel()
        numbers = (float(f"{x:.3g}") for x in (*spread, deviation(tip).value, *level))
        yield name, questions[name], len(steps), *numbers


STUDY = study.study(NAME, variants=VARIANTS, compare=compare)
