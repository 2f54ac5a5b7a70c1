"""Sensitivity indices of functions whose indices are known."""

import numpy as np
import pytest
from SALib.sample.sobol import sample as salib_sample

from ravenjax.stats.sensitivity import morris_analyse, morris_sample, sobol_analyse, sobol_sample

# Ishigami, a = 7, b = 0.1: V = a^2/8 + b pi^4/5 + b^2 pi^8/18 + 1/2
V = 49 / 8 + np.pi**4 / 50 + np.pi**8 / 1800 + 0.5
FIRST = np.array([0.5 * (1 + np.pi**4 / 50) ** 2, 49 / 8, 0]) / V
TOTAL = FIRST + np.array([1, 0, 1]) * 8 * np.pi**8 / 22500 / V  # V13 = 8 b^2 pi^8 / 225


def ishigami(u):
    x = (2 * u - 1) * np.pi
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def linear(u):
    return u @ np.array([4.0, 2.0, 1.0, 0.0])


def test_ishigami():
    found = sobol_analyse(ishigami(sobol_sample(3, 2048, seed=1)), 3, resamples=200)
    assert found.first.value == pytest.approx(FIRST, abs=0.03)
    assert found.total.value == pytest.approx(TOTAL, abs=0.03)
    assert (found.first.low <= FIRST).all() and (found.first.high >= FIRST).all()
    assert (found.total.low <= TOTAL).all() and (found.total.high >= TOTAL).all()


def test_coverage_of_the_bands():
    inside = np.zeros((2, 3))
    for seed in range(40):
        found = sobol_analyse(ishigami(sobol_sample(3, 256, seed)), 3, resamples=150, seed=seed)
        for i, (band, truth) in enumerate(((found.first, FIRST), (found.total, TOTAL))):
            inside[i] += (band.low <= truth) & (truth <= band.high)
    assert (inside / 40 > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 40)).all(), inside / 40


def test_design_has_saltellis_layout():
    design = sobol_sample(3, 8, seed=2)
    problem = {"num_vars": 3, "names": list("abc"), "bounds": [[0, 1]] * 3}
    assert design == pytest.approx(
        salib_sample(problem, 8, calc_second_order=False, seed=np.random.default_rng(2))
    )
    assert (design == sobol_sample(3, 8, seed=2)).all() and (
        design != sobol_sample(3, 8, seed=3)
    ).any()


def test_output_that_never_varies_has_no_index():
    found = sobol_analyse(np.ones(5 * 16), 3, resamples=20)
    assert np.isnan(found.first.value).all() and np.isnan(found.total.low).all()


def test_morris_orders_and_measures():
    def model(u):
        return linear(u) + 3 * (u[:, 3] - 0.5) ** 2 * u[:, 2]

    design = morris_sample(4, 60, seed=3)
    assert design.shape == (300, 4) and ((design >= 0) & (design <= 1)).all()
    found = morris_analyse(design, model(design))
    assert list(np.argsort(-found.mu_star.value)) == [0, 1, 2, 3]
    assert found.mu[:2] == pytest.approx([4, 2]) and found.sigma[:2] == pytest.approx(
        [0, 0], abs=1e-9
    )
    assert found.sigma[3] > 0.1 and abs(found.mu[3]) < 0.5 * found.mu_star.value[3]  # up and down
    assert (found.mu_star.low <= found.mu_star.value).all() and found.mu_star.low[3] > 0
    again = morris_analyse(design, model(design))
    assert (again.mu_star.high == found.mu_star.high).all() and (
        morris_sample(4, 60, seed=3) == design
    ).all()
