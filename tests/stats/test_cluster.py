"""Cluster bootstrap against the known variance of clustered data."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from ravenjax.stats.bootstrap.clusters import cluster_bootstrap, cluster_ratio

CLUSTERS, EACH = 60, 20
LABEL = np.repeat(np.arange(CLUSTERS), EACH)
BETWEEN, WITHIN = (
    1.0,
    2.0,
)  # standard deviations: the mean's is sqrt(1 / 60 + 4 / 1200), not sqrt(5 / 1200)
ERROR = np.sqrt(BETWEEN**2 / CLUSTERS + WITHIN**2 / (CLUSTERS * EACH))


def clustered(seed):
    random = np.random.default_rng(seed)
    return np.repeat(random.normal(3, BETWEEN, CLUSTERS), EACH) + random.normal(
        0, WITHIN, CLUSTERS * EACH
    )


def test_coverage_and_width_of_a_mean():
    bands = [
        cluster_ratio(clustered(seed), 1, LABEL, resamples=400, seed=seed) for seed in range(400)
    ]
    inside = np.mean([band.low <= 3 <= band.high for band in bands])
    assert (
        0.905 < inside < 0.975
    )  # the percentile band of 60 units covers some 94 %; 3.5 standard errors
    assert np.mean([band.high - band.low for band in bands]) == pytest.approx(
        2 * 1.96 * ERROR, rel=0.04
    )
    rows = cluster_ratio(clustered(0), 1, np.arange(len(LABEL)))
    assert (
        rows.high - rows.low < 0.6 * 2 * 1.96 * ERROR
    )  # runs taken as independent: far too narrow


@pytest.mark.parametrize("kind", ["percentile", "BCa"])
def test_weights_and_sums_agree(kind):
    x = clustered(1)
    sums = cluster_ratio(x, 1, LABEL, resamples=200, seed=5, kind=kind)
    weights = cluster_bootstrap(
        LABEL, lambda w: w @ x / w.sum(axis=1), resamples=200, seed=5, kind=kind
    )
    assert sums[:3] == pytest.approx(weights[:3]) and sums.units == weights.units == CLUSTERS
    assert sums.value == pytest.approx(x.mean())


def test_whole_clusters_are_drawn_as_often_as_there_are():
    seen = []

    def statistic(weight):
        seen.append(weight)
        return weight[:, 0]

    cluster_bootstrap(LABEL, statistic, resamples=50)
    drawn = np.concatenate(seen).reshape(-1, CLUSTERS, EACH)
    assert (drawn == drawn[..., :1]).all() and (drawn[..., 0].sum(axis=1) == CLUSTERS).all()
    assert len(np.unique(drawn[..., 0], axis=0)) > 45


def test_bca_follows_the_skew_of_a_ratio():
    random = np.random.default_rng(2)
    x = random.lognormal(0, 1.2, CLUSTERS)
    plain, corrected = (
        cluster_ratio(x, 1, np.arange(CLUSTERS), kind=kind, resamples=4000)
        for kind in ("percentile", "BCa")
    )
    assert corrected.low > plain.low and corrected.high > plain.high


def test_rate_among_some_rows():
    hit, asked = np.array([1, 0, 1, 1, 0, 0]), np.array([1, 1, 1, 1, 0, 0], bool)
    band = cluster_ratio(hit & asked, asked, pd.Series(list("aabbcc")), resamples=500)
    assert band.value == pytest.approx(3 / 4) and band.units == 3
    assert band.undefined == pytest.approx(
        500 / 27, abs=15
    )  # cluster c alone, in 1 of 27 resamples


def test_rows_without_a_cluster_are_refused():
    with pytest.raises(ValueError, match="1 rows have no cluster"):
        cluster_ratio([1, 2, 3], 1, ["a", None, "b"])
