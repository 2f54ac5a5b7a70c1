"""Axes of maps: the values of one input, binned where there are many, and joined where runs are
few.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ravenjax.document.ticks import round_step
from ravenjax.store.access.query import text

MIN_BINS, MAX_BINS = 2, 8
RUNS_PER_BIN = 8
"""Aimed at in each cell of two binned inputs."""
MOST_VALUES = 12
"""Values of an input that have a bin each."""
UNTIL_END = -1
"""Duration of a fault that lasts until the run ends."""
TO_THE_END, UNSET, OTHERS = "to the end", "not set", "others"


_ENDS = re.compile(r" to |, | \.\. ")
"""What stands between the ends of a label."""


class MapAxis(NamedTuple):
    """Bins of one input, in order: numbers from each of `edges` to the next, or one of `words`, and
    then those that stand for no number."""

    title: str
    labels: list[str]
    edges: np.ndarray = np.zeros(0)
    words: tuple[str, ...] = ()  # the last bin holds all others where there are more labels
    special: tuple[str, ...] = ()  # labels of the last bins: TO_THE_END, UNSET
    ranges: bool = False  # a bin of numbers is a range, not one value

    def number(self, values: np.ndarray) -> np.ndarray:
        """Bin of each number."""
        place = np.searchsorted(self.edges, values, side="right") - 1
        for offset, label in self._specials():
            place = np.where(
                np.isnan(values) if label == UNSET else values == UNTIL_END, offset, place
            )
        return place

    def sql(self, column: str) -> str:
        """The same of a column, of numbers or words."""
        if self.words:
            cases = " ".join(
                f"WHEN {text(word)} THEN {place}" for place, word in enumerate(self.words)
            )
            return f"CASE {column}::VARCHAR {cases} ELSE {len(self.labels) - 1} END"
        inside = (
            " + ".join(f"({column} >= {edge!r})::INTEGER" for edge in self.edges.tolist()) or "0"
        )
        whens = "".join(
            f"WHEN {f'isnan({column}::DOUBLE)' if label == UNSET else f'{column} = {UNTIL_END}'}"
            f" THEN {offset} "
            for offset, label in self._specials()
        )
        return f"CASE {whens}ELSE {inside} - 1 END" if whens else f"{inside} - 1"

    def _specials(self) -> list[tuple[int, str]]:
        return list(enumerate(self.special, start=len(self.labels) - len(self.special)))

    @property
    def joinable(self) -> int:
        """How many bins may be joined with their neighbours: those of numbers."""
        return 0 if self.words else len(self.labels) - len(self.special)

    def join(self, bins: int) -> tuple[MapAxis, np.ndarray]:
        """With so many bins of numbers, and the new bin of each."""
        count = self.joinable
        groups = [group for group in np.array_split(np.arange(count), max(1, bins)) if len(group)]
        labels = [
            _label(self.labels[group[0]], self.labels[group[-1]], len(group), self.ranges)
            for group in groups
        ]
        new = np.concatenate([np.full(len(group), place) for place, group in enumerate(groups)])
        rest = len(groups) + np.arange(len(self.special))
        firsts = self.edges[[group[0] for group in groups]]
        return (
            self._replace(labels=[*labels, *self.special], edges=firsts),
            np.concatenate([new, rest]).astype(int),
        )


def of_numbers(
    title: str,
    values: np.ndarray | None,
    low: float,
    high: float,
    n: int,
    special: Sequence[str] = (),
) -> MapAxis:
    """Bins of n numbers from low to high: one per value if few, by powers of two if wide, else
    even.

    values: the different ones in order, None if very many; special: see `Axis`.
    """
    if values is not None and len(values) <= MOST_VALUES:
        return MapAxis(
            title,
            [*map(compact, values.tolist()), *special],
            values.astype(float),
            special=tuple(special),
        )
    edges = _edges(low, high, min(MAX_BINS, max(MIN_BINS, round(math.sqrt(n / RUNS_PER_BIN)))))
    labels = [f"{compact(a)} to {compact(b)}" for a, b in pairwise(edges)]
    return MapAxis(title, [*labels, *special], edges[:-1], special=tuple(special), ranges=True)


def of_words(title: str, counts: Sequence[tuple[str, int]], order: Sequence[str] = ()) -> MapAxis:
    """A bin for each word, those of `order` first and the others in the order of the alphabet; of
    more than MOST_VALUES the most frequent, and one for the others. counts: (word, runs)."""
    frequent = sorted(counts, key=lambda one: (-one[1], one[0]))
    many = len(counts) > MOST_VALUES
    words = [word for word, _ in (frequent[: MOST_VALUES - 1] if many else frequent)]
    places = {word: place for place, word in enumerate(order)}
    words.sort(key=lambda word: (places.get(word, len(places)), word))
    return MapAxis(
        title,
        [*(word or "none" for word in words), *([OTHERS] if many else [])],
        words=tuple(words),
    )


def compact(value: float) -> str:
    """12000 -> 12k, 2000000 -> 2M, 0.123 -> 0.12, so that axis labels stay short."""
    if value and abs(value) >= 1_000_000:
        return f"{value / 1e6:.3g}M".replace("-", "−")
    if value and abs(value) >= 10_000:
        return f"{value / 1000:.3g}k".replace("-", "−")
    return (
        f"{value:.3g}".replace("-", "−") if abs(value) < 1000 else f"{value:.0f}".replace("-", "−")
    )


def _label(first: str, last: str, bins: int, ranges: bool) -> str:
    """The label of so many bins that become one."""
    if bins == 1:
        return first
    least, most = (_ENDS.split(label)[end] for label, end in ((first, 0), (last, -1)))
    if ranges:
        return f"{least} to {most}"
    return (
        f"{least}, {most}" if bins == 2 and (least, most) == (first, last) else f"{least} .. {most}"
    )


def _edges(low: float, high: float, wanted: int) -> np.ndarray:
    """Round edges of about `wanted` bins, from at most `low` to at least `high`."""
    if low > 0 and high / low > 30:
        step = math.ceil(math.log2(high / low) / (wanted + 2))
        powers = np.arange(math.floor(math.log2(low)), math.log2(high) + step + 1e-9, step)
        return 2.0**powers
    step = round_step((high - low) / wanted)
    first, last = (
        math.floor(low / step + 1e-9),
        math.ceil(high / step - 1e-9),
    )  # the last bin holds its upper edge
    return np.arange(first, max(last, first + 1) + 1) * step
