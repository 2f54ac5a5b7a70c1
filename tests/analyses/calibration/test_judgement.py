"""Following errors of a log and of what is replayed of it."""

from __future__ import annotations

import numpy as np

from ravenjax.analyses.calibration import judgement


def test_errors_are_root_mean_squares_of_what_is_compared() -> None:
    desired = np.zeros((4, 7))
    measured = np.full((4, 7), 3.0)
    measured[:2] = np.nan
    measured[:, 6] = np.nan
    model = np.full((4, 7), 7.0)
    log, ours = judgement.following("log", measured, desired, {"ours": model})
    np.testing.assert_allclose(log.following[:6], 3.0)
    np.testing.assert_allclose(ours.following[:6], 7.0)
    np.testing.assert_allclose(ours.residual[:6], 4.0)
    assert np.isnan(log.following[6]) and np.isnan(ours.residual[6]) and not log.residual.any()
