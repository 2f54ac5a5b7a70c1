"""Adjusts the p-values of several tests, so that a guarantee is valid for all tests together."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of


class Finding(NamedTuple):
    """One hypothesis: its p-value, its adjusted p-value, and whether it is rejected."""

    p: float
    adjusted: float
    rejected: bool


def holm_test(p: Mapping[str, float], confidence: float = 0.95) -> dict[str, Finding]:
    """Test several hypotheses by Holm's step-down method (Holm 1979). With this confidence no
    rejection is wrong, even if the tests depend on each other. p: p-values by name. A hypothesis
    with NaN is left out and never rejected.
    """
    from statsmodels.stats.multitest import multipletests  # slow to import

    values = np.array(list(p.values()), float)
    is_tested = ~np.isnan(values)
    adjusted = np.full(len(values), np.nan)
    if is_tested.any():
        _, adjusted[is_tested], *_ = multipletests(values[is_tested], alpha_of(confidence), "holm")
    # A comparison with NaN is false.
    rejected = adjusted <= alpha_of(confidence)
    findings = map(Finding, values.tolist(), adjusted.tolist(), rejected.tolist())
    return dict(zip(p, findings, strict=True))
