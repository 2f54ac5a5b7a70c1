"""Computes how many control cycles each packet lasts from the times at which packets arrive.

The result is a distribution for `campaign.packets`.
"""

import numpy as np

from ravenjax.vocabulary.packets import MOST_CYCLES

_PARTS = 1000


def packet_lengths(ms: np.ndarray) -> np.ndarray:
    """Return the cycles from each cycle that gets datagrams to the next one that does, int.

    ms: when each datagram arrives, ascending.
    """
    return np.diff(np.unique(np.floor(ms)).astype(int))


def length_shares(cycles: np.ndarray) -> np.ndarray:
    """Return the share of packets that last 1, 2, 3, .. cycles, from each length (int [n])."""
    return np.bincount(cycles)[1:] / len(cycles)


def as_campaign(cycles: np.ndarray) -> tuple[float, ...]:
    """Return the shares in thousandths whose sum is 1, as a campaign file has them.

    Longer packets count as the longest that is allowed.
    """
    exact = length_shares(np.minimum(cycles, MOST_CYCLES)) * _PARTS
    parts = np.floor(exact).astype(int)
    parts[np.argsort(parts - exact)[: _PARTS - parts.sum()]] += 1
    used = np.flatnonzero(parts)[-1] + 1
    return tuple((parts[:used] / _PARTS).tolist())
