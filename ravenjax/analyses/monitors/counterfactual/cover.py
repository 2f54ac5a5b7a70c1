"""A small set of candidates that covers much: greedy, then pruned.

In each step the candidate that covers most of what is left is taken; coverage is submodular, so a
greedy set of k covers at least 1 - 1/e of what the best k do (Nemhauser, Wolsey, Fisher, Math.
Program. 14, 1978). Then whatever the others have made superfluous is left out again.
"""

from __future__ import annotations

import numpy as np


def greedy(
    covered: np.ndarray, most: int, weight: np.ndarray | None = None, least: float = 0.0
) -> list[int]:
    """Numbers of at most `most` candidates, those that cover most alone of the others first.

    covered: bool [runs, candidates]. weight: of each run, at least 0; None: 1. Of candidates that
    add the same the earlier is taken. Nothing is taken that adds nothing, or less than the share
    `least` of all weight.
    """
    runs, candidates = covered.shape
    value = np.ones(runs) if weight is None else np.asarray(weight, float)
    left = value.copy()
    picks: list[int] = []
    while len(picks) < min(most, candidates):
        gain = left @ covered
        best = int(np.argmax(gain))
        if not gain[best] > 0 or gain[best] < least * value.sum():
            break
        picks.append(best)
        left[covered[:, best]] = 0.0
    return _pruned(covered, picks, value)


def _pruned(covered: np.ndarray, picks: list[int], value: np.ndarray) -> list[int]:
    """Without those that cover nothing which the others do not, the last first."""
    rest = list(picks)
    for one in reversed(picks):
        others = [other for other in rest if other != one]
        alone = covered[:, one] & ~covered[:, others].any(axis=1)
        if others and not value[alone].sum() > 0:
            rest = others
    return rest
