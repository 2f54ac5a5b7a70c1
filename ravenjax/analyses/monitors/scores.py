"""Defines the scores that candidate checks compute from a signal of the robot.

- `bound`: |x| divided by its scale.
- `rate`: |change of x since the last tick| divided by its scale; 0 in the first tick.
- `residual`: |x - y| divided by its scale, for two signals.

If a signal has several channels, each channel is divided by its scale, and the score is the largest
quotient. NaN is read as 0. The module `code` writes a score as a Python file that a campaign can
use as a detector (`ravenjax.stages.detectors`).
"""

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
    labels: tuple[str, ...]  # name of each channel, such as joints; ("",) for a single number
    units: tuple[str, ...]  # unit of each channel
    scales: tuple[float, ...]  # value of each channel at which the score is 1, in its unit
    layer: str  # code of the robot's layer
    against: str = ""  # second field of a residual, with the same channels

    def __post_init__(self) -> None:
        # These words become code, and they may come from a file of somebody else. Only `against`
        # and labels may be empty.
        optional_words = [word for word in (self.against, *self.labels) if word]
        for word in (self.name, self.signal, *optional_words):
            if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", word):
                raise ValueError(
                    f"score {self.name!r}: {word!r} must start with a letter and have only letters,"
                    " digits and _"
                )

    @property
    def words(self) -> str:
        """What the score observes, such as "step of boards_cmd (shoulder) within a tick"."""
        labels = ", ".join(label for label in self.labels if label)
        what = f"{self.signal} ({labels})" if labels else self.signal
        return _WORDS[self.kind].format(what=what, against=self.against)

    @property
    def channel_scores(self) -> "tuple[Score, ...]":
        """A separate score for each channel, with the channel's label in its name."""
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

    def scaled(self, scales: Sequence[float]) -> "Score":
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
    return tuple(score for signal in robot.signals for score in _scores_of(signal))


def _scores_of(signal: Signal) -> Iterator[Score]:
    """Yield all scores of a signal, with scales 1: its magnitude, its step, and its distance from
    other signals, each for every set of channels that are observed together.
    """
    # The kind of each score, and for a residual (a distance from another signal) this signal.
    kinds: list[tuple[Kind, str]] = []
    if signal.bounded:
        kinds.append(("bound", ""))
    if signal.steps:
        kinds.append(("rate", ""))
    for field in signal.against:
        kinds.append(("residual", field))
    for kind, against in kinds:
        for set_name, indices in _channel_sets(signal):
            # A signal without channels has one number, without a label.
            labels = tuple(signal.channels[index] for index in indices) or ("",)
            words = (signal.field, kind, against, set_name)
            yield Score(
                name="_".join(word for word in words if word),
                kind=kind,
                signal=signal.field,
                channels=indices,
                labels=labels,
                units=tuple(signal.unit_of(label) for label in labels),
                scales=(1.0,) * len(labels),
                layer=signal.layer,
                against=against,
            )


def _channel_sets(signal: Signal) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield (name, channel indices) of each set of channels that are observed together. The first
    set has no name and contains all channels that are in no other set. A signal without channels
    has one set without indices.
    """
    if not signal.channels:
        yield "", ()
        return
    in_named_set = {channel for _, channels in signal.together for channel in channels}
    yield ("", tuple(i for i, channel in enumerate(signal.channels) if channel not in in_named_set))
    for name, channels in signal.together:
        yield name, tuple(signal.channels.index(channel) for channel in channels)
