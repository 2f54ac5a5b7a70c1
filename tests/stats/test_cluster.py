"""Cluster bootstrap against the known variance of clustered data."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from ravenjax.stats.bootstrap.resample import cluster_bootstrap

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


def mean_band(x, label, **more):
    return cluster_bootstrap(label, lambda w: w @ x / w.sum(axis=1), **more)


def test_coverage_and_width_of_a_mean():
    bands = [mean_band(clustered(seed), LABEL, resamples=200, seed=seed) for seed in range(200)]
    inside = np.mean([band.low <= 3 <= band.high for band in bands])
    # the percentile band of 60 units covers some 93 %; 3 standard errors
    assert 0.875 < inside < 0.985
    assert np.mean([band.high - band.low for band in bands]) == pytest.approx(
        2 * 1.96 * ERROR, rel=0.04
    )
    rows = mean_band(clustered(0), np.arange(len(LABEL)))
    assert (
        rows.high - rows.low < 0.6 * 2 * 1.96 * ERROR
    )  # runs taken as independent: far too narrow


def test_whole_clusters_are_drawn_as_often_as_there_are():
    seen = []

    def statistic(weight):
        seen.append(weight)
        return weight[:, 0]

    cluster_bootstrap(LABEL, statistic, resamples=50)
    drawn = np.concatenate(seen).reshape(-1, CLUSTERS, EACH)
    assert (drawn == drawn[..., :1]).all() and (drawn[..., 0].sum(axis=1) == CLUSTERS).all()
    assert len(np.unique(drawn[..., 0], axis=0)) > 45


def test_rate_among_some_rows():
    hit, asked = np.array([1, 0, 1, 1, 0, 0]), np.array([1, 1, 1, 1, 0, 0])
    label = pd.Series(list("aabbcc"))
    band = cluster_bootstrap(label, lambda w: (w @ (hit * asked)) / (w @ asked), resamples=500)
    assert band.value == pytest.approx(3 / 4) and band.units == 3
    # cluster c alone, in 1 of 27 resamples
    assert band.undefined == pytest.approx(500 / 27, abs=15)


def test_rows_without_a_cluster_are_refused():
    with pytest.raises(ValueError, match="1 rows have no cluster"):
        mean_band(np.ones(3), ["a", None, "b"])
