"""Defines the scores that candidate checks compute from a signal of the robot.

- `bound`: |x| divided by its scale.
- `rate`: |x - x a tick ago| divided by its scale; 0 in the first tick.
- `residual`: |x - y| divided by its scale, for two signals.

If a signal has several channels, each channel is divided by its scale, and the score is the largest
quotient. NaN is read as 0. The module `code` writes a score as a Python file that a campaign can
use as a detector (`ravenjax.stages.detectors`).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from typing import Literal

from ravenjax.errors import UserError
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.signals import Signal

Kind = Literal["bound", "rate", "residual"]
KINDS: tuple[Kind, ...] = ("bound", "rate", "residual")
_WORDS = {
    "bound": "{what}",
    "rate": "step of {what} within a tick",
    "residual": "distance of {what} from {against}",
}


@dataclasses.dataclass(frozen=True)
class Score:
    """The score of a candidate check: a number for each millisecond and arm."""

    name: str  # valid as the name of a detector in a campaign
    kind: Kind
    signal: str  # field of the robot's view
    channels: tuple[int, ...]  # indices in the field; (): the field is a single number
    # Name of each channel, such as joints and axes; ("",) for a single number.
    labels: tuple[str, ...]
    units: tuple[str, ...]  # unit of each channel
    # Value of each channel at which the score is 1, in the unit of the channel.
    scales: tuple[float, ...]
    layer: str  # code of the robot's layer
    against: str = ""  # second field of a residual, with the same channels

    def __post_init__(self) -> None:
        # These words become code. They may come from a file of somebody else.
        for word in (self.name, self.signal, *filter(None, (self.against, *self.labels))):
            if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", word):
                raise ValueError(
                    f"score {self.name!r}: {word!r} must start with a letter and have only letters,"
                    " digits and _"
                )

    @property
    def words(self) -> str:
        """Describe what the score observes: "step of boards_cmd (shoulder) within a tick"."""
        labels = ", ".join(filter(None, self.labels))
        what = f"{self.signal} ({labels})" if labels else self.signal
        return _WORDS[self.kind].format(what=what, against=self.against)

    @property
    def singles(self) -> tuple[Score, ...]:
        """Return each channel as a separate score."""
        if len(self.labels) == 1:
            return (self,)
        return tuple(
            dataclasses.replace(
                self,
                name=f"{self.name}_{label}",
                channels=(channel,),
                labels=(label,),
                units=(unit,),
                scales=(scale,),
            )
            for channel, label, unit, scale in zip(
                self.channels, self.labels, self.units, self.scales, strict=True
            )
        )

    def scaled(self, scales: Sequence[float]) -> Score:
        """Return the score with other scales, one for each channel, above 0."""
        return dataclasses.replace(self, scales=tuple(float(scale) for scale in scales))


def list_candidates(robot: Robot) -> tuple[Score, ...]:
    """Return the scores of all candidate checks of a robot, with scales 1.

    For each signal these are bounds, rates and residuals. Channels that are observed together have
    one score. Raise UserError for a robot that declares no signals.
    """
    if not robot.signals:
        raise UserError(
            f"robot {robot.name!r} declares no signals that a check could observe. Expected"
            " `signals` in its ROBOT, as ravenjax.vocabulary.signals describes"
        )
    return tuple(score for signal in robot.signals for score in _of(signal))


def _of(signal: Signal) -> Iterator[Score]:
    # Yields every score of a signal: its magnitude, its step, and its distance from other signals.
    kinds: list[tuple[Kind, str]] = [("residual", field) for field in signal.against]
    if signal.steps:
        kinds.insert(0, ("rate", ""))
    if signal.bounded:
        kinds.insert(0, ("bound", ""))
    for kind, against in kinds:
        for label, channels in _channels(signal):
            named = tuple(signal.channels[place] for place in channels) or ("",)
            words = (signal.field, kind, against, label)
            yield Score(
                "_".join(filter(None, words)),
                kind,
                signal.field,
                channels,
                named,
                tuple(signal.unit_of(name) for name in named),
                (1.0,) * len(named),
                signal.layer,
                against,
            )


def _channels(signal: Signal) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield (name, indices) of each set of channels that are observed together.

    The first set has no name and contains all channels that are in no other set.
    """
    if not signal.channels:
        yield "", ()
        return
    joined = {channel for _, channels in signal.together for channel in channels}
    yield "", tuple(place for place, channel in enumerate(signal.channels) if channel not in joined)
    for name, channels in signal.together:
        yield name, tuple(signal.channels.index(channel) for channel in channels)
