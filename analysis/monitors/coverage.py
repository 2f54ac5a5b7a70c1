"""Tests whether thresholds of `ravenjax monitor calibrate` have their stated false-alarm rate, over
200 calibrations, with and without varied robots, and with shifted robots.

    python analysis/monitors/pools.py FOLDER && python analysis/monitors/coverage.py FOLDER

Half of the simulated operators represent the population. Each of 200 calibrations draws its
operators from this half with replacement. Each calibration is therefore an independent draw from a
population whose false-alarm rate at any threshold is known exactly. The calibrated threshold is
compared with a naive threshold, the quantile of all scores. The other half of the operators is used
to test the detection of a shift: with the same robots, drawn 200 times, and with shifted robots.
The script prints one table and writes no file.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

from ravenjax.analyses.monitors import score_folder
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.conformal import shift, threshold
from ravenjax.stats.conformal.threshold import FalseAlarmTarget, OperationScores
from ravenjax.stats.multiplicity import holm_test

CALIBRATIONS, UNITS, LEVEL = 200, 150, 0.05
TARGET = FalseAlarmTarget(2.0, 0.95, 1 / 60)
FRESH_UNITS = 20


class Coverage(NamedTuple):
    """Results of CALIBRATIONS thresholds from one pool, arrays [calibrations]."""

    # Alarms per hour in the population that the calibrations are drawn from.
    population: np.ndarray
    loss: np.ndarray  # mean loss there, promised to be at most TARGET.risk
    naive: np.ndarray  # mean loss of the naive threshold
    fresh: np.ndarray  # alarms per hour in fresh operations
    naive_fresh: np.ndarray

    @property
    def broken(self) -> int:
        """Return the calibrations whose promise does not hold in the population."""
        return int((self.loss > TARGET.risk).sum())


def naive_threshold(operations: threshold.OperationScores) -> float:
    """Return the plain quantile of all scores at the target's risk. It promises nothing."""
    return float(np.quantile(operations.score, 1.0 - TARGET.risk, method="higher"))


def scores(peaks: OperationScores) -> OperationScores:
    """Return the joint score of each operation. Every eighth operator provides the scales and is
    left out.
    """
    learns = peaks.unit % 8 == 0
    some = peaks.score[learns]
    scale = threshold.signal_scales(some[np.isfinite(some).all(axis=1)][:, :, None])
    score = threshold.joint_scores(peaks.score[~learns][:, :, None], scale)
    return OperationScores(
        peaks.unit[~learns], np.where(np.isnan(score), np.inf, score), peaks.hours[~learns]
    )


def halves(whole: OperationScores) -> tuple[OperationScores, OperationScores]:
    """Return population and fresh operators."""
    units = np.unique(whole.unit)
    return whole.taken_from(units[::2]), whole.taken_from(units[1::2])


def drawn(
    population: OperationScores, rng: np.random.Generator, units: int = UNITS
) -> OperationScores:
    """Draw units of the population with replacement. Each draw is a separate unit."""
    order = np.argsort(population.unit, kind="stable")
    each = len(order) // population.units  # operations of each
    rows = order.reshape(-1, each)[rng.integers(population.units, size=units)]
    return OperationScores(
        np.repeat(np.arange(units), each), *(v[rows.ravel()] for v in population[1:])
    )


def loss(whole: OperationScores, limit: float) -> float:
    """Return the mean loss of an operation."""
    return float(np.where(whole.score > limit, 1.0, TARGET.without_alarm(whole.hours)).mean())


def rate(whole: OperationScores, limit: float) -> float:
    """Return operations with an alarm, per hour."""
    return float((whole.score > limit).sum() / whole.hours.sum())


def coverage(whole: OperationScores, one_each: bool, seed: int) -> Coverage:
    """Return the results of CALIBRATIONS independent calibrations.

    `one_each`: with one operation of each unit, which is Wilks' order statistic.
    """
    population, fresh = halves(whole)
    if one_each:
        population = population.first_operations()
    rng, rows = np.random.default_rng(seed), []
    for _ in range(CALIBRATIONS):
        some = drawn(population, rng)
        limit, plain = threshold.smallest_threshold(some, TARGET).value, naive_threshold(some)
        rows.append(
            (
                rate(population, limit),
                loss(population, limit),
                loss(population, plain),
                rate(fresh, limit),
                rate(fresh, plain),
            )
        )
    return Coverage(*np.array(rows).T)


def columns(peaks: OperationScores, scale: np.ndarray) -> np.ndarray:
    """Return joint score and each term of the first operation of each operator, [operators, 1 +
    terms].
    """
    peak = np.nan_to_num(peaks.first_operations().score, nan=np.inf)
    return np.column_stack([threshold.joint_scores(peak[:, :, None], scale), peak])


def shifts(same: np.ndarray, other: np.ndarray | None, seed: int) -> int:
    """Return how many of CALIBRATIONS checks of FRESH_UNITS operators against UNITS others report a
    shift at LEVEL.
    """
    rng, calls = np.random.default_rng(seed), 0
    for k in range(CALIBRATIONS):
        order = rng.permutation(len(same))
        calibration, fresh = same[order[:UNITS]], same[order[UNITS : UNITS + FRESH_UNITS]]
        if other is not None:
            fresh = other[rng.permutation(len(other))[:FRESH_UNITS]]
        p = {
            str(c): shift.test_shift(calibration[:, c], fresh[:, c], k).p
            for c in range(same.shape[1])
        }
        calls += any(one.rejected for one in holm_test(p, 1 - LEVEL).values())
    return calls


def main() -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    pools = {
        name: score_folder.read_scores(folder / name / score_folder.FOLDER)
        for name in ("drawn", "one", "shifted")
    }
    most = int(binom.ppf(0.95, CALIBRATIONS, 1 - TARGET.confidence))
    print(
        f"promise: at most {TARGET.per_hour:g} alarms an hour with {TARGET.confidence:.0%}"
        f" confidence; {CALIBRATIONS} calibrations on {UNITS} operators each.\nIf the confidence"
        f" were exact, {CALIBRATIONS * (1 - TARGET.confidence):g} would break it, and 95 of 100"
        f" such studies would have at most {most}.\n"
    )
    print(
        "| robots | operations of an operator | broken | naive: broken | alarms/h, fresh: median,"
        " 95th of 100 | naive |"
    )
    print("|---|---|---|---|---|---|")
    for seed, (name, one_each) in enumerate(
        (n, o) for n in ("drawn", "one") for o in (False, True)
    ):
        whole = scores(pools[name])
        own = coverage(whole, one_each, seed)
        plain = int((own.naive > TARGET.risk).sum())
        median, high = np.quantile(own.fresh, [0.5, 0.95])
        naive_median, naive_high = np.quantile(own.naive_fresh, [0.5, 0.95])
        print(
            f"| {name} | {1 if one_each else 'all'} | {own.broken} | {plain} | {median:.2f},"
            f" {high:.2f} | {naive_median:.2f}, {naive_high:.2f} |"
        )
    whole, moved = scores(pools["drawn"]), pools["shifted"]
    unit = pools["drawn"].unit
    learns = unit % 8 == 0
    scale = threshold.signal_scales(pools["drawn"].score[learns][:, :, None])
    same, other = columns(pools["drawn"].taken_from(unit[~learns]), scale), columns(moved, scale)
    limit = threshold.smallest_threshold(halves(whole)[0], TARGET).value
    broken_rate = alarm_rate(
        int((other[:, 0] > limit).sum()), float(moved.first_operations().hours.sum())
    )
    false, true = shifts(same, None, 1), shifts(same, other, 2)
    print(
        f"\nshift at level {LEVEL:g}, {FRESH_UNITS} fresh operators against {UNITS}: called in"
        f" {false} of {CALIBRATIONS} where nothing changed, in {true} of {CALIBRATIONS} with"
        f" shifted robots, whose alarms are {broken_rate.per_hour:.1f} an hour"
        f" ({broken_rate.low:.1f} to {broken_rate.high:.1f}) at the promised threshold"
    )


if __name__ == "__main__":
    main()
