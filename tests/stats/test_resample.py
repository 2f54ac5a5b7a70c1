"""The bootstrap of chosen units, against scipy's own on rows and what a caller relies on."""

import numpy as np
import pytest
from scipy.stats import bootstrap as rows_bootstrap

from ravenjax.stats.bootstrap.units import bootstrap

X = np.random.default_rng(0).exponential(1.0, 60)


def mean(index):
    return X[index].mean(axis=-1)


def test_as_scipy_on_rows():
    band = bootstrap(60, mean, 0.9, resamples=2000, seed=4)
    theirs = rows_bootstrap(
        (X,),
        np.mean,
        confidence_level=0.9,
        n_resamples=2000,
        method="percentile",
        rng=np.random.default_rng(4),
    )
    assert (band.low, band.high) == pytest.approx(tuple(theirs.confidence_interval), rel=1e-9)
    assert band.value == pytest.approx(X.mean())


def test_one_unit_is_refused():
    with pytest.raises(ValueError, match="at least 2 independent units, got 1"):
        bootstrap(1, mean)
