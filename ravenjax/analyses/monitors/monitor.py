"""Defines a calibrated monitor as data: scores of signals, their scales, and a threshold."""

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
        edges = np.asarray(self.edges, np.float32)
        # The name becomes a part of generated code.
        is_name = bool(re.fullmatch(r"([A-Za-z]\w*)?", self.field))
        is_ascending = bool(np.isfinite(edges).all() and (np.diff(edges) > 0).all())
        # Either both the name and the edges are given, or neither is.
        if not is_name or not is_ascending or bool(self.field) != bool(self.edges):
            raise ValueError(f"segments: expected a signal and ascending limits, got {self}")
        # The edges as float32 numbers. A frozen dataclass can be changed only in this way.
        object.__setattr__(self, "edges", tuple(float(edge) for edge in edges))

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.edges) + 1

    @property
    def words(self) -> str:
        """The segments as text for the command line, such as "tick=1000,5000"; "" for WHOLE."""
        if not self.field:
            return ""
        # Nine digits determine a float32.
        return f"{self.field}={','.join(f'{edge:.9g}' for edge in self.edges)}"

    @staticmethod
    def parsed(text: str) -> "Segments":
        """Return the segments of a text such as "tick=1,5"; WHOLE for "". Raises ValueError."""
        if not text:
            return WHOLE
        field, _, edges = text.strip().partition("=")
        try:
            # "?" is not the name of a signal, so a missing name is refused too.
            return Segments(field or "?", tuple(float(edge) for edge in edges.split(",")))
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
            raise ValueError("a monitor needs one scale for each of its scores in each segment")

    @property
    def limits(self) -> np.ndarray:
        """The value above which a term raises an alarm, in the term's unit; [terms, segments]."""
        return np.array(self.scales) * self.threshold


def split_scores(scores: Sequence[Score]) -> tuple[Score, ...]:
    """Return a score with scale 1 for each channel of the scores, each channel once."""
    channels = [channel.scaled([1.0]) for score in scores for channel in score.channel_scores]
    return tuple({channel.name: channel for channel in channels}.values())


def input_expressions(terms: Sequence[Score], segments: Segments) -> dict[str, str]:
    """Return the names of a monitor's inputs in order, each with the Python expression that reads
    it from the robot's view, such as {"boards_cmd_shoulder": "view.boards_cmd[0]"}.
    """
    expressions = {}
    for term in terms:
        # A signal without channels is a single number, which needs no index.
        index = f"[{term.channels[0]}]" if term.channels else ""
        expressions[input_name(term, term.signal)] = f"view.{term.signal}{index}"
        if term.against:
            expressions[input_name(term, term.against)] = f"view.{term.against}{index}"
    if segments.field:
        expressions.setdefault(segments.field, f"view.{segments.field}")
    return expressions


def input_name(term: Score, field: str) -> str:
    """Return a name for the number that a term reads from a field, such as boards_cmd_shoulder."""
    return f"{field}_{term.labels[0]}" if term.channels else field
