"""Defines a calibrated monitor as data: scores of signals, the scale of each score, and a
threshold."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import numpy as np

from ravenjax.analyses.monitors.scores import Score


@dataclasses.dataclass(frozen=True)
class Segments:
    """Segments of an operation, in which a monitor has different thresholds.

    The value of a signal determines the segment: below the first edge, then from each edge to the
    next. With `tick` the segments are stretches of time; with `runlevel` or `surgeon_mode` they are
    phases. Without edges the whole operation is one segment.
    """

    field: str = ""  # name of the signal, a single number of the robot's view
    edges: tuple[float, ...] = ()  # ascending limits between segments, float32

    def __post_init__(self) -> None:
        numbers = np.asarray(self.edges, np.float32)
        if (
            not re.fullmatch(r"([A-Za-z]\w*)?", self.field)
            or bool(self.field) != bool(self.edges)
            or not np.isfinite(numbers).all()
            or (np.diff(numbers) <= 0).any()
        ):
            raise ValueError("expected the name of a signal and ascending numbers")
        object.__setattr__(self, "edges", tuple(float(number) for number in numbers))

    @property
    def count(self) -> int:
        """Return the number of segments."""
        return len(self.edges) + 1

    @property
    def words(self) -> str:
        """Return the segments as text for the command line, such as "tick=1000,5000"."""
        return (
            f"{self.field}={','.join(f'{edge:.9g}' for edge in self.edges)}" if self.field else ""
        )

    @staticmethod
    def parsed(text: str) -> Segments:
        """Parse `FIELD=EDGE,EDGE`; "" is WHOLE. Raises ValueError for anything else."""
        if not text:
            return WHOLE
        field, _, edges = text.strip().partition("=")
        try:
            return Segments(field or "?", tuple(map(float, edges.split(","))))
        except ValueError:
            raise ValueError(
                f"--segments {text!r}: expected the name of a signal and ascending numbers, such as"
                " tick=1000,5000"
            ) from None


WHOLE = Segments()
"""An operation as a single segment."""


@dataclasses.dataclass(frozen=True)
class Monitor:
    """A calibrated monitor. It raises an alarm if the robot is live and the score of a term,
    divided by its scale, exceeds the threshold.
    """

    terms: tuple[Score, ...]  # scores with one channel each
    segments: Segments
    # Scale of each term in each segment, float32, in the unit of the term.
    scales: tuple[tuple[float, ...], ...]
    threshold: float  # float32

    def __post_init__(self) -> None:
        names = [term.name for term in self.terms]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                "a monitor needs one or more terms with different names, got"
                f" {', '.join(names) or 'none'}"
            )
        if np.shape(self.scales) != (len(self.terms), self.segments.count):
            raise ValueError("a monitor needs a scale for each term and segment")

    @property
    def limits(self) -> np.ndarray:
        """Return the value above which a term raises an alarm, in its unit; [terms, segments]."""
        return np.array(self.scales) * self.threshold


def split_scores(scores: Sequence[Score]) -> tuple[Score, ...]:
    """Split scores into single channels with scale 1, so that each channel can have a limit."""
    singles = [single.scaled([1.0]) for score in scores for single in score.singles]
    return tuple({single.name: single for single in singles}.values())


def list_reads(terms: Sequence[Score], segments: Segments) -> dict[str, str]:
    """Return the monitor's inputs in order: name of the number -> expression in the robot's view.

    For example, "boards_cmd_shoulder" -> "view.boards_cmd[0]".
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
    """Return the name of the number that a term reads from a field, such as boards_cmd_shoulder."""
    return f"{field}_{term.labels[0]}" if term.channels else field
