"""Brackets the smallest number at which a condition holds, for many cells side by side.

The module is independent of robots. The scan makes the result honest: a cell that is never or
always true is censored. A cell whose answer changes more than once is reported as such instead of
being treated as a threshold.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

Asked = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Maps (cell [n], number [n]) to [n]: 1 yes, 0 no, NaN no valid answer."""

CROSSING, NEVER, ALWAYS, INVALID = "crossing", "never", "always", "invalid"


@dataclasses.dataclass(frozen=True)
class SearchRange:
    """The range of numbers that is searched."""

    low: float
    high: float
    log: bool  # True if equal ratios, rather than equal differences, are equivalent
    # A bracket is narrow enough at this share of its lower end (log), or of the whole range.
    tolerance: float

    def spread(self, low: np.ndarray, high: np.ndarray, points: int) -> np.ndarray:
        """Return [points, cells] evenly spaced from `low` to `high` [cells], both included."""
        share = np.linspace(0.0, 1.0, points)[:, None]
        if self.log:
            values = np.exp(np.log(low) * (1.0 - share) + np.log(high) * share)
        else:
            values = low * (1.0 - share) + high * share
        values[0], values[-1] = low, high
        return values

    def narrow(self, low: np.ndarray, high: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Return whether brackets are narrow enough, or contain no further whole number."""
        width = self.tolerance * (low if self.log else self.high - self.low)
        return (high - low <= width) | (whole & (high - low <= 1.0))


@dataclasses.dataclass(frozen=True)
class Brackets:
    """The point at which the answer becomes yes, for each cell."""

    # text [cells]: CROSSING, NEVER, ALWAYS, or INVALID if an answer was not valid.
    state: np.ndarray
    # [cells], largest number below the crossing with a no; NaN without one.
    low: np.ndarray
    high: np.ndarray  # [cells], smallest number with a yes; NaN without one
    # Of each cell, the intervals of the scan in which the answer changes.
    changes: tuple[tuple[tuple[float, float], ...], ...]
    steps: int  # number of steps after the scan

    @property
    def monotone(self) -> np.ndarray:
        """Return whether the answer stays yes after the first yes of the scan; bool [cells]."""
        single = [
            len(changes) <= (state != ALWAYS)
            for state, changes in zip(self.state, self.changes, strict=True)
        ]
        return np.array(single, bool)


def find_brackets(
    asked: Asked, within: SearchRange, whole: np.ndarray, scan: int, sections: int = 2
) -> Brackets:
    """Return the smallest number at which `asked` says yes, for every cell.

    `whole`: bool [cells], whether a cell takes only whole numbers. `scan`: count of numbers that
    are tried first, evenly over the range. `sections`: parts into which each step cuts a bracket;
    if it holds several changes, the first is kept.
    """
    cells = len(whole)
    every = np.arange(cells)
    tried = within.spread(np.full(cells, within.low), np.full(cells, within.high), scan)
    tried = np.where(whole, np.rint(tried), tried)
    answer = _ask(asked, every, tried)
    state, low, high = _first(answer, tried)
    changes = tuple(_changes(answer[:, cell], tried[:, cell]) for cell in range(cells))
    steps = 0
    while len(active := np.flatnonzero((state == CROSSING) & ~within.narrow(low, high, whole))):
        steps += 1
        tried = within.spread(low[active], high[active], sections + 1)
        tried = np.where(whole[active], np.clip(np.rint(tried), low[active], high[active]), tried)
        # A bracket of whole numbers more than one apart contains another one.
        if sections == 2:
            inner = np.clip(tried[1], low[active] + 1.0, high[active] - 1.0)
            tried[1] = np.where(whole[active], inner, tried[1])
        answer = np.zeros(tried.shape)
        answer[-1] = 1.0
        answer[1:-1] = _ask(asked, active, tried[1:-1])
        states, low[active], high[active] = _first(answer, tried)
        state[active] = states
    return Brackets(state, low, high, changes, steps)


def _ask(asked: Asked, cells: np.ndarray, tried: np.ndarray) -> np.ndarray:
    return asked(np.tile(cells, len(tried)), tried.reshape(-1)).reshape(tried.shape)


def _first(answer: np.ndarray, tried: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the state, and the first change from no to yes, of each column."""
    yes = answer == 1.0
    first = np.argmax(yes, axis=0)
    cells = np.arange(answer.shape[1])
    state = np.where(~yes.any(axis=0), NEVER, np.where(first == 0, ALWAYS, CROSSING))
    state = np.where(np.isnan(answer).any(axis=0), INVALID, state).astype(object)
    low = np.where(
        state == CROSSING, tried[first - 1, cells], np.where(state == NEVER, tried[-1], np.nan)
    )
    high = np.where(
        state == CROSSING, tried[first, cells], np.where(state == ALWAYS, tried[0], np.nan)
    )
    return state, low, high


def _changes(answer: np.ndarray, tried: np.ndarray) -> tuple[tuple[float, float], ...]:
    at = np.flatnonzero(answer[1:] != answer[:-1])
    return (
        tuple((float(tried[i]), float(tried[i + 1])) for i in at)
        if not np.isnan(answer).any()
        else ()
    )
