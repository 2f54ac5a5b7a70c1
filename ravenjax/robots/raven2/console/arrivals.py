"""Computes how many control cycles each packet lasts from the times at which packets arrive.

The result is a distribution for `campaign.packets`.
"""

import numpy as np

from ravenjax.vocabulary.packets import MOST_CYCLES

_THOUSAND = 1000


def packet_lengths(ms: np.ndarray) -> np.ndarray:
    """Return the number of cycles from each cycle with datagrams to the next such cycle, int.

    ms: arrival times of the datagrams, ascending.
    """
    return np.diff(np.unique(np.floor(ms)).astype(int))


def length_shares(cycles: np.ndarray) -> np.ndarray:
    """Return the shares of packets that last 1, 2, 3, .. cycles. cycles: int [n], lengths."""
    return np.bincount(cycles)[1:] / len(cycles)


def as_campaign(cycles: np.ndarray) -> tuple[float, ...]:
    """Return the shares of packet lengths for a campaign file: multiples of 0.001 with the sum 1.

    Packets that are longer than allowed count as packets of the largest allowed length.
    """
    exact = length_shares(np.minimum(cycles, MOST_CYCLES)) * _THOUSAND
    thousandths = np.floor(exact).astype(int)
    thousandths[np.argsort(thousandths - exact)[: _THOUSAND - thousandths.sum()]] += 1
    count = np.flatnonzero(thousandths)[-1] + 1
    return tuple((thousandths[:count] / _THOUSAND).tolist())
