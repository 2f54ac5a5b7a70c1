"""Measures which inputs cause an output's variance: Sobol indices, and Morris' cheaper screening.

Designs are points of the unit cube [runs, d]. The caller runs the model on all points. A coordinate
is the quantile of an input's distribution, and inputs are assumed to be independent. Rows of the
output must have the order of the design. For a binary outcome use a margin or a probability,
because a 0/1 output needs many more runs.
"""

from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import Estimate
from ravenjax.stats.units import bootstrap


class SobolIndices(NamedTuple):
    """First-order and total index of each input, arrays [d] with bands. They are the shares of the
    output's variance that an input explains alone, and together with its interactions. They are NaN
    if the output is constant.
    """

    first: Estimate
    total: Estimate


class MorrisEffects(NamedTuple):
    """Elementary effects of each input, arrays [d], in the output's unit per range of the input.
    mu_star: mean absolute effect, with its band. mu: mean effect with sign; if it is near 0 and
    mu_star is large, the output is not monotone. sigma: standard deviation; it is large if the
    output is not linear or has interactions.
    """

    mu_star: Estimate
    mu: np.ndarray
    sigma: np.ndarray


def sobol_sample(d: int, n: int, seed: int) -> np.ndarray:
    """Return Saltelli's design for d inputs: points of the unit cube, [n (d + 2), d].

    n is a power of two. A_i and B_i are the halves of the n points of a scrambled Sobol sequence in
    2 d dimensions. As in SALib.sample.sobol, block i contains A_i, then for each input A_i with
    this input of B_i, then B_i.
    """
    from scipy.stats import qmc

    base = qmc.Sobol(2 * d, rng=np.random.default_rng(seed)).random(n)
    a, b = base[:, :d], base[:, d:]
    # Axes [n, d, d]: block i, input taken from B_i, coordinate.
    crossed = np.where(np.eye(d, dtype=bool), b[:, None], a[:, None])
    return np.concatenate([a[:, None], crossed, b[:, None]], axis=1).reshape(-1, d)


def sobol_analyse(outputs: np.ndarray, d: int, *, resamples: int, seed: int = 0) -> SobolIndices:
    """Return indices from finite outputs [n (d + 2)] at the points of `sobol_sample(d, n)`, by
    scipy.stats.sobol_indices.

    The estimators are those of Saltelli et al. 2010. Bands are by percentile bootstrap over the n
    base points. A resample with a constant output has no index and is left out (SALib would divide
    by nearly 0, its issue 619). A Sobol sequence fills the cube more evenly than a bootstrap
    assumes, so for a smooth model the bands are several times too wide.
    """
    from scipy.stats import sobol_indices

    # Axes [d + 2, n]: outputs of A, then A with one input of B, then B.
    block = outputs.reshape(-1, d + 2).T
    n = block.shape[1]

    def compute_indices(base_points: np.ndarray) -> np.ndarray:
        # Returns first-order and total indices [b, 2, d] of resamples, given as base points [b, n].
        # Axes [d + 2, b, n]. scipy treats the resamples as separate outputs of one model.
        resample = block[:, base_points]
        functions = {"f_A": resample[0], "f_B": resample[-1], "f_AB": resample[1:-1]}
        result = sobol_indices(func=functions, n=n)
        # scipy drops the first axis of a single output.
        first = np.reshape(result.first_order, (-1, d))
        total = np.reshape(result.total_order, (-1, d))
        is_constant = np.ptp(resample[[0, -1]], axis=(0, 2)) == 0
        return np.where(is_constant[:, None, None], np.nan, np.stack([first, total], axis=1))

    # A batch has at most two million outputs, to limit memory.
    batch = max(1, 2_000_000 // outputs.size)
    value, low, high = bootstrap(n, compute_indices, resamples=resamples, seed=seed, batch=batch)
    return SobolIndices(Estimate(value[0], low[0], high[0]), Estimate(value[1], low[1], high[1]))


def morris_sample(d: int, n: int, seed: int, levels: int = 4) -> np.ndarray:
    """Return Morris' design for d inputs by SALib: points of the unit cube, [n (d + 1), d]. Each of
    the n trajectories has d + 1 points. A step moves one input by levels / (2 (levels - 1)) of its
    range. `levels` is even.
    """
    from SALib.sample.morris import sample

    return sample(_problem(d), n, num_levels=levels, seed=seed)


def morris_analyse(
    design: np.ndarray,
    outputs: np.ndarray,
    *,
    levels: int = 4,
    resamples: int = 1000,
    seed: int = 0,
) -> MorrisEffects:
    """Return elementary effects from a design of `morris_sample` and its finite outputs [runs], by
    SALib (Campolongo et al. 2007). The band of mu_star is normal, with the standard error of a
    bootstrap over trajectories, and at least 0. With fewer than about 20 trajectories it is too
    narrow.
    """
    from SALib.analyze.morris import analyze

    problem = _problem(design.shape[1])
    effects = analyze(problem, design, outputs, resamples, num_levels=levels, seed=seed)
    mu_star, half, mu, sigma = (
        np.asarray(effects[key], float) for key in ("mu_star", "mu_star_conf", "mu", "sigma")
    )
    return MorrisEffects(
        Estimate(mu_star, np.maximum(0.0, mu_star - half), mu_star + half), mu, sigma
    )


def _problem(d: int) -> dict[str, object]:
    return {"num_vars": d, "names": [f"x{i}" for i in range(d)], "bounds": [[0.0, 1.0]] * d}
