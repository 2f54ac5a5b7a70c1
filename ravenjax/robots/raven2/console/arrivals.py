"""Computes how many control cycles each packet lasts from the times at which packets arrive.

The result is a distribution for `campaign.packets`.
"""

import numpy as np

from ravenjax.vocabulary.packets import MOST_CYCLES

_STEPS = 1000


def packet_lengths(ms: np.ndarray) -> np.ndarray:
    """Return the number of cycles from each cycle with datagrams to the next such cycle, int.
    ms: arrival times of the datagrams, ascending. A cycle lasts 1 ms.
    """
    return np.diff(np.unique(np.floor(ms)).astype(int))


def length_shares(cycles: np.ndarray) -> np.ndarray:
    """Return the shares of packets that last 1, 2, 3, .. cycles. cycles: int [n], lengths."""
    return np.bincount(cycles)[1:] / len(cycles)


def rounded_shares(cycles: np.ndarray) -> tuple[float, ...]:
    """Return `length_shares` for a campaign file: rounded to multiples of 0.001 with the sum 1.
    Packets that are longer than allowed count as packets of the largest allowed length.
    """
    exact = length_shares(np.minimum(cycles, MOST_CYCLES)) * _STEPS
    # Round down, then add 0.001 to the shares with the largest remainders until the sum is 1
    thousandths = np.floor(exact).astype(int)
    thousandths[np.argsort(thousandths - exact)[: _STEPS - thousandths.sum()]] += 1
    longest = np.flatnonzero(thousandths)[-1] + 1
    return tuple((thousandths[:longest] / _STEPS).tolist())
