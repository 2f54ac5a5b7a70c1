"""Compares two groups of measurements that are not independent within clusters.

For example, the hazards of one participant resemble each other, so the participant is the
independent unit. A cluster is an array of measurements. In an independent comparison each cluster
is in one group. In a paired comparison, `first[i]` and `second[i]` are the same cluster under both
conditions.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.stats import paired
from ravenjax.stats.intervals import ALPHA, Estimate, independent_difference, rate_bounds

Clusters = Sequence[np.ndarray]

DRAWS = 9999
"""Number of permutations that are drawn if there are too many to enumerate."""


class Correlation(NamedTuple):
    """How alike rows of one cluster are, and by how much that inflates the variance of a mean."""

    icc: float  # intraclass correlation, 0 to 1
    design_effect: float  # factor by which the effective number of rows is smaller


def intraclass_correlation(*groups: Clusters) -> Correlation:
    """Return the intraclass correlation within groups, by analysis of variance (Donner, Klar,
    2000), at least 0.

    icc is NaN and the design effect 1 if no cluster has two rows.
    """
    sizes = np.array([len(one) for group in groups for one in group], float)
    clusters, rows = len(sizes), sizes.sum()
    if clusters <= len(groups) or rows <= clusters:
        return Correlation(math.nan, 1.0)
    within = sum(((one - one.mean()) ** 2).sum() for group in groups for one in group)
    between, typical = 0.0, 0.0
    for group in groups:
        mean = np.concatenate(list(group)).mean()
        between += sum(len(one) * (one.mean() - mean) ** 2 for one in group)
        mine = np.array([len(one) for one in group], float)
        typical += (mine.sum() - (mine**2).sum() / mine.sum()) / (clusters - len(groups))
    between, within = between / (clusters - len(groups)), within / (rows - clusters)
    if between + (typical - 1) * within <= 0:
        return Correlation(0.0, 1.0)
    icc = min(1.0, max(0.0, (between - within) / (between + (typical - 1) * within)))
    return Correlation(float(icc), float(1 + ((sizes**2).sum() / rows - 1) * icc))


def risk_difference(first: Clusters, second: Clusters) -> Estimate:
    """Return the rate of `first` minus the rate of `second`, for clusters of bool rows, with each
    cluster in one group.

    The interval is Newcombe's square-and-add of two Wilson intervals (Stat. Med. 17, 1998) with
    each n divided by the design effect. If clusters have several rows, Student's quantile for
    clusters - 2 replaces the normal one. With one row per cluster it is Newcombe's own interval.
    The result is NaN if a group is empty.
    """
    from scipy.stats import norm, t

    if not len(first) or not len(second):
        return Estimate()
    inflation = intraclass_correlation(first, second)
    clusters = len(first) + len(second)
    alpha = ALPHA
    if not math.isnan(inflation.icc):
        alpha = 2 * float(norm.sf(t.isf(alpha / 2, max(1, clusters - 2))))
    hits = np.array([sum(float(one.sum()) for one in group) for group in (first, second)])
    n = np.array([sum(len(one) for one in group) for group in (first, second)], float)
    low, high = rate_bounds(hits / inflation.design_effect, n / inflation.design_effect, alpha)
    rates = map(Estimate, (hits / n).tolist(), low.tolist(), high.tolist())
    found = independent_difference(*rates)
    return Estimate(found.value, max(-1.0, found.low), min(1.0, found.high))


def paired_risk_difference(first: Clusters, second: Clusters) -> Estimate:
    """Return the difference of rates if each cluster was under both conditions: the mean of the
    clusters' differences.

    With one row per cluster and condition, the interval is Bonett and Price's
    (`paired.difference_of_counts`), else Student's over the clusters. The result is NaN for fewer
    than 2 clusters, and has no interval if all differences are equal.
    """
    if all(len(one) == 1 for one in [*first, *second]):
        pairs = [(bool(one[0]), bool(other[0])) for one, other in zip(first, second, strict=True)]
        only = (sum(pair == kind for pair in pairs) for kind in ((True, False), (False, True)))
        return paired.difference_of_counts(*only, len(pairs))
    return mean_difference(first, second, is_paired=True)


def mean_difference(first: Clusters, second: Clusters, *, is_paired: bool = False) -> Estimate:
    """Return the mean over clusters of their means, `first` minus `second`, with Student's (paired)
    or Welch's interval.

    The result is NaN for fewer than 2 clusters in a group, and has no interval if clusters do not
    vary.
    """
    from scipy.stats import ttest_1samp, ttest_ind

    one, two = cluster_means(first), cluster_means(second)
    if min(len(one), len(two)) < 2:
        return Estimate()
    value = float((one - two).mean() if is_paired else one.mean() - two.mean())
    still = np.ptp(one - two) == 0 if is_paired else np.ptp(one) == 0 and np.ptp(two) == 0
    if still:
        return Estimate(value)
    test: Any = ttest_1samp(one - two, 0.0) if is_paired else ttest_ind(one, two, equal_var=False)
    low, high = test.confidence_interval()
    return Estimate(value, float(low), float(high))


def standardised_difference(
    first: np.ndarray, second: np.ndarray, *, is_paired: bool = False
) -> float:
    """Return Hedges' g: mean of `first` minus mean of `second` in standard deviations, corrected
    for the bias of small samples.

    The standard deviation is pooled; for pairs it is that of their differences. The result is NaN
    for fewer than 2 values in a group, or if they do not vary.
    """
    from scipy.special import gammaln

    if min(len(first), len(second)) < 2:
        return math.nan
    groups = [first - second] if is_paired else [first, second]
    freedom = sum(len(group) - 1 for group in groups)
    variance = sum(group.var(ddof=1) * (len(group) - 1) for group in groups) / freedom
    if not variance > 0:
        return math.nan
    unbiased = math.exp(gammaln(freedom / 2) - gammaln((freedom - 1) / 2)) if freedom > 1 else 0.0
    difference = float(first.mean() - second.mean())
    return unbiased / math.sqrt(freedom / 2) * difference / math.sqrt(variance)


def permutation_p(
    first: Clusters, second: Clusters, *, is_paired: bool = False, seed: int = 0
) -> float:
    """Return the two-sided p-value that the condition changes nothing in the clusters' means, by
    exchanging labels between clusters.

    If paired, labels are exchanged within clusters. The test is exact if there are few exchanges,
    else by 9999 draws. A randomised assignment of clusters justifies it for any distribution of the
    values. The result is NaN for fewer than 2 clusters.
    """
    from scipy.stats import permutation_test

    one, two = cluster_means(first), cluster_means(second)
    if min(len(one), len(two)) < 2:
        return math.nan

    def difference(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return a.mean(axis=axis) - b.mean(axis=axis)

    test: Any = permutation_test(
        (one, two),
        difference,
        permutation_type="samples" if is_paired else "independent",
        vectorized=True,
        n_resamples=DRAWS,
        rng=np.random.default_rng(seed),
    )
    return float(test.pvalue)


def cluster_means(clusters: Clusters) -> np.ndarray:
    """Return the mean of each cluster's rows."""
    return np.array([float(np.mean(one)) for one in clusters])
