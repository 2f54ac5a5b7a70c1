"""Brackets the smallest number at which a condition holds, for many cells side by side.

Knows nothing of robots. The scan is what makes it honest: a cell without a yes, or with nothing
else, is censored, and one whose answer changes more than once is reported as such instead of being
taken for a threshold.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

Asked = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(cell [n], number [n]) -> [n]: 1 yes, 0 no, NaN no valid answer."""

CROSSING, NEVER, ALWAYS, INVALID = "crossing", "never", "always", "invalid"


@dataclasses.dataclass(frozen=True)
class SearchRange:
    """The numbers that are searched."""

    low: float
    high: float
    log: bool  # whether equal ratios, rather than equal differences, count the same
    # a bracket is narrow enough at this share of its lower end (log), or of the whole range
    tolerance: float

    def spread(self, low: np.ndarray, high: np.ndarray, points: int) -> np.ndarray:
        """[points, cells] evenly from `low` to `high` [cells], both included."""
        share = np.linspace(0.0, 1.0, points)[:, None]
        if self.log:
            values = np.exp(np.log(low) * (1.0 - share) + np.log(high) * share)
        else:
            values = low * (1.0 - share) + high * share
        values[0], values[-1] = low, high
        return values

    def narrow(self, low: np.ndarray, high: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Whether brackets are narrow enough, or have no whole number in between."""
        width = self.tolerance * (low if self.log else self.high - self.low)
        return (high - low <= width) | (whole & (high - low <= 1.0))


@dataclasses.dataclass(frozen=True)
class Brackets:
    """Where the yes begins, of each cell."""

    state: (
        np.ndarray
    )  # text [cells]: CROSSING, NEVER, ALWAYS, or INVALID where an answer was not valid
    low: np.ndarray  # [cells], largest number below the crossing with a no; NaN without one
    high: np.ndarray  # [cells], smallest with a yes; NaN without one
    changes: tuple[
        tuple[tuple[float, float], ...], ...
    ]  # of each cell, the scan's intervals in which the answer changes
    steps: int  # after the scan

    @property
    def monotone(self) -> np.ndarray:
        """Whether the answer, once yes, stays yes, as far as the scan can tell; bool [cells]."""
        single = [
            len(changes) <= (state != ALWAYS)
            for state, changes in zip(self.state, self.changes, strict=True)
        ]
        return np.array(single, bool)


def bracket(
    asked: Asked, within: SearchRange, whole: np.ndarray, scan: int, sections: int = 2
) -> Brackets:
    """The smallest number at which `asked` says yes, of every cell.

    whole: of each cell whether it takes whole numbers only, bool [cells]. scan: numbers that are
    tried first, evenly over the range. sections: parts that each step cuts a bracket into; of
    several changes in one, the first is kept.
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
        if (
            sections == 2
        ):  # a bracket of two whole numbers further apart than one has one in between
            inner = np.clip(tried[1], low[active] + 1.0, high[active] - 1.0)
            tried[1] = np.where(whole[active], inner, tried[1])
        answer = np.zeros(tried.shape)
        answer[-1] = 1.0
        answer[1:-1] = _ask(asked, active, tried[1:-1])
        states, low[active], high[active] = _first(answer, tried)
        state[active] = states
    return Brackets(state, low, high, changes, steps)


def _ask(asked: Asked, cells: np.ndarray, tried: np.ndarray) -> np.ndarray:
    """[points, cells] answers, all in one batch."""
    return asked(np.tile(cells, len(tried)), tried.reshape(-1)).reshape(tried.shape)


def _first(answer: np.ndarray, tried: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State, and the first change from no to yes, of each column."""
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
