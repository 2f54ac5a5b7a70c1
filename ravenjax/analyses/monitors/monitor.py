"""A calibrated monitor as data: terms with their scales, and a threshold."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import numpy as np

from ravenjax.analyses.monitors.scores import Score


@dataclasses.dataclass(frozen=True)
class Segments:
    """Stretches of an operation by a number of the robot's view: below the first edge, from each
    edge to the next.

    `tick` makes them stretches of time, `runlevel` or `surgeon_mode` phases. No edges: one segment,
    the whole.
    """

    field: str = ""  # a single number of the view
    edges: tuple[float, ...] = ()  # ascending, float32

    def __post_init__(self) -> None:
        numbers = np.asarray(self.edges, np.float32)
        if (
            bool(self.field) != bool(self.edges)
            or not np.isfinite(numbers).all()
            or (np.diff(numbers) <= 0).any()
        ):
            raise ValueError(
                f"segments {self.words!r}: expected a field and ascending numbers, as"
                " tick=1000,5000"
            )
        object.__setattr__(self, "edges", tuple(float(number) for number in numbers))

    @property
    def count(self) -> int:
        """How many."""
        return len(self.edges) + 1

    @property
    def words(self) -> str:
        """As the command line takes them: tick=1000,5000."""
        return (
            f"{self.field}={','.join(f'{edge:.9g}' for edge in self.edges)}" if self.field else ""
        )

    @staticmethod
    def parsed(text: str) -> Segments:
        """From `FIELD=EDGE,EDGE`. ValueError for anything else."""
        match = re.fullmatch(r"([A-Za-z]\w*)=(.+)", text.strip())
        try:
            return (
                Segments(match[1], tuple(float(edge) for edge in match[2].split(",")))
                if match
                else Segments("?")
            )
        except ValueError:
            raise ValueError(
                f"segments {text!r}: expected a field and ascending numbers, as tick=1000,5000"
            ) from None


WHOLE = Segments()
"""An operation in one piece."""


@dataclasses.dataclass(frozen=True)
class Monitor:
    """An alarm where the largest of its terms, each over its scale, is above the threshold while
    the robot is live.
    """

    terms: tuple[Score, ...]  # of one channel each
    segments: Segments
    scales: tuple[tuple[float, ...], ...]  # float32, of each term in each segment, in its unit
    threshold: float  # float32

    def __post_init__(self) -> None:
        names = [term.name for term in self.terms]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                "a monitor needs a term or more of different names, got"
                f" {', '.join(names) or 'none'}"
            )
        if {len(scales) for scales in self.scales} != {self.segments.count} or len(
            self.scales
        ) != len(self.terms):
            raise ValueError("a monitor has a scale for each term and segment")

    @property
    def limits(self) -> np.ndarray:
        """Where each term has an alarm in each segment, in its unit; [terms, segments]."""
        return np.array(self.scales) * self.threshold


def split_scores(scores: Sequence[Score]) -> tuple[Score, ...]:
    """Each channel of the scores by itself, scale 1, so that each has a band of its own."""
    singles = [single.scaled([1.0]) for score in scores for single in score.singles]
    return tuple({single.name: single for single in singles}.values())


def list_reads(terms: Sequence[Score], segments: Segments) -> dict[str, str]:
    """What a monitor reads each millisecond: name of the number -> where it stands in the
    robot's view, in order.
    """
    reads = {}
    for term in terms:
        for field in filter(None, (term.signal, term.against)):
            place = f"[{term.channels[0]}]" if term.channels else ""
            reads[name_read(term, field)] = f"view.{field}{place}"
    if segments.field:
        reads.setdefault(segments.field, f"view.{segments.field}")
    return reads


def name_read(term: Score, field: str) -> str:
    """Name of the number of a field that a term reads."""
    return f"{field}_{term.labels[0]}" if term.channels else field
