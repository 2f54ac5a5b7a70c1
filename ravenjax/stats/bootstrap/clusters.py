"""Bootstrap of rows that come in clusters: runs of one cell resemble each other, so cells are
resampled, not runs.

Davison, Hinkley, Bootstrap Methods and their Application, 1997, 3.8; Field, Welsh, JRSS B 69, 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap.resample import BootstrapBand, bootstrap

_ELEMENTS = 2_000_000  # of a batch of weights, 16 MB


def cluster_bootstrap(
    cluster: ArrayLike,
    statistic: Callable[[np.ndarray], np.ndarray],
    confidence: float = 0.95,
    *,
    resamples: int = 1000,
    seed: int = 0,
) -> BootstrapBand:
    """Band of any statistic of n rows that belong to clusters; `cluster` [n] is each row's label
    (no NaN).

    statistic: weight [b, n] -> values [b, ...]: how often each row is drawn (whole, 0 where its
    cluster is not), one resample a line. A mean is `weight @ x / weight.sum(1)`; what takes no
    weights repeats rows, `np.repeat(x, weight[i].astype(int))`. Band.units counts the clusters.
    ValueError with fewer than 2.
    """
    code, clusters = codes(cluster)

    def weighted(index: np.ndarray) -> np.ndarray:
        line = np.arange(len(index))[:, None] * clusters
        weights = np.bincount((index + line).ravel(), minlength=len(index) * clusters).reshape(
            -1, clusters
        )
        return statistic(weights[:, code].astype(float))

    batch = max(1, _ELEMENTS // max(1, len(code)))
    return bootstrap(clusters, weighted, confidence, resamples=resamples, seed=seed, batch=batch)


def codes(cluster: ArrayLike) -> tuple[np.ndarray, int]:
    """Number of each row's cluster [n], and how many clusters there are. ValueError where a
    label is missing.
    """
    import pandas as pd

    labels: Any = (
        cluster if isinstance(cluster, pd.Series | pd.Categorical) else np.asarray(cluster)
    )
    code, names = pd.factorize(labels)
    if (code < 0).any():
        raise ValueError(
            f"cluster: {int((code < 0).sum())} rows have no cluster (NaN); name it or leave"
            " them out"
        )
    return code, len(names)
