"""Defines the sections of a campaign file that every robot has, as pydantic models.

They are [campaign], [haptics], [[detector]], [[check]], [outcomes] and [stop]. The models define
keys, units and ranges. The module `group` defines groups of runs.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_validator

from ravenjax import robots
from ravenjax.campaign.file import own_part
from ravenjax.campaign.file.section import OneOf, Section
from ravenjax.numbers import harm
from ravenjax.outcomes import events
from ravenjax.outcomes.verdict import LIMIT_MM, PUBLISHED_CUE_MM
from ravenjax.vocabulary.checks import DOES, Action, Check, CheckUse, of_own
from ravenjax.vocabulary.detectors import MEANINGS, BuiltInKind, DetectorUse, Fusion
from ravenjax.vocabulary.parts import OwnSource


class CampaignSection(Section):
    """[campaign]: keys for all runs. A robot may have further keys."""

    robot: str = robots.DEFAULT
    """name of the robot, or the Python module that declares ROBOT"""
    name: str = Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=100)
    """short name, also of the default output folder"""
    description: str = ""
    """purpose of the campaign"""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """seed of designs, noise and random effects"""
    duration_s: float = Field(default=3.0, gt=0.0, le=3600.0)
    """duration of each run, s"""
    observe_ms: int | None = Field(default=None, ge=1, le=3_600_000)
    """time between the end of a run's last fault and the end of the run. Default: runs last for
    duration_s. So do runs whose last fault has no known end: a fault that never ends, or a fault
    that counts time in pedal-down if a fault may change the pedal"""
    arms: tuple[str, ...] = Field(
        default_factory=lambda known: robots.find_robot(known["robot"]).arms[:1], min_length=1
    )
    """arms, in order"""
    noise: bool = False
    """draw the robot's noise at random, with other numbers in each run"""
    limit: int | None = Field(default=None, ge=1)
    """compute only the first runs, this many; the same campaign with a larger limit continues"""
    chunk: int | None = Field(default=None, ge=1, le=1_000_000)
    """number of runs in each Parquet file; the default depends on the number of runs"""

    @property
    def ticks(self) -> int:
        """Number of control cycles of a run."""
        return self.duration_ms // robots.find_robot(self.robot).period_ms

    @property
    def duration_ms(self) -> int:
        """Duration of each run."""
        return round(self.duration_s * 1000.0)

    @field_validator("duration_s")
    @classmethod
    def _whole_ms(cls, duration: float) -> float:
        # A tick may last several milliseconds. `semantics` then checks that a run has whole ticks.
        ms = round(duration * 1000.0)
        if ms < 1 or abs(duration * 1000.0 - ms) > 1e-6 * ms:
            raise ValueError(
                f"got {duration:.10g} s, expected whole milliseconds, at least 0.001 s, such as"
                f" {max(1, ms) / 1000:g}"
            )
        return duration


class CueSet(NamedTuple):
    """One haptic set: threshold and gains of the cue, in SI and device units."""

    threshold_m: float
    kp: float  # device units per m
    kd: float  # device units per m/s
    cap: float  # device units


_Item = TypeVar("_Item")
OneOrMore = _Item | Annotated[list[_Item], Field(min_length=1)]
"""Annotation for the JSON Schema of a list. A single value is accepted in place of a list."""


def _make_list(raw: Sequence[Any] | float) -> Sequence[Any]:
    # Returns a single value as a list with one entry.
    return raw if isinstance(raw, list | tuple) else (raw,)


_Least0 = Annotated[float, Field(ge=0.0, le=1e6)]
_Numbers = Annotated[
    tuple[_Least0, ...],
    BeforeValidator(_make_list, json_schema_input_type=OneOrMore[_Least0]),
    Field(min_length=1),
]
"""A number of at least 0, or a list of such numbers."""

MOST_CUES = 256
"""Largest number of haptic sets. Each set adds time to every run, and four columns."""


class Haptics(Section):
    """[haptics]: thresholds and gains of the haptic cue. All are evaluated in the same run."""

    threshold_mm: _Numbers = (PUBLISHED_CUE_MM,)
    """distance of the tip from the nominal model above which the cue is on, mm"""
    kp_per_mm: _Numbers = (0.0045,)
    """spring, device units per mm"""
    kd_per_mm_s: _Numbers = (0.00009,)
    """damper, device units per mm/s"""
    cap: _Numbers = (0.05,)
    """largest force, device units"""
    combine: Literal["grid", "zip"] = "grid"
    """grid: every combination of the lists; zip: one set for each position in the lists"""

    @model_validator(mode="after")
    def _check_lists(self) -> "Haptics":
        # Checks that the lists of settings can be combined, and the number of haptic sets.
        lengths = {name: len(values) for name, values in self._lists().items() if len(values) > 1}
        if self.combine == "zip" and len(set(lengths.values())) > 1:
            raise ValueError(f"combine = 'zip' needs lists of one length, got lengths {lengths}")
        sets = math.prod(lengths.values())
        if self.combine == "zip":
            sets = max(lengths.values(), default=1)
        if sets > MOST_CUES:
            raise ValueError(f"the lists make {sets} haptic sets, expected at most {MOST_CUES}")
        return self

    def _lists(self) -> dict[str, tuple[float, ...]]:
        return self.model_dump(exclude={"combine"})

    def cues(self) -> tuple[CueSet, ...]:
        """Return all haptic sets. The last list varies fastest."""
        lists = list(self._lists().values())
        rows: Any = itertools.product(*lists)
        # A list of one value is repeated to the length of the other lists.
        if self.combine == "zip":
            rows = np.transpose(np.broadcast_arrays(*lists)).tolist()
        # Lengths are converted from mm to m.
        return tuple(
            CueSet(threshold / 1e3, kp * 1e3, kd * 1e3, cap) for threshold, kp, kd, cap in rows
        )


MOST_THRESHOLDS = 64
"""Largest number of thresholds of a detector. Each adds time to every run, and two columns."""

_UpTo8 = Annotated[int, Field(ge=1, le=8)]


class Detector(Section):
    """[[detector]]: a detector, which observes the runs and may raise alarms. If `fusion` or
    `consecutive` is a list, each combination of their values is one detector.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=60)
    """name of the detector in tables"""
    kind: BuiltInKind | None = Field(
        default=None,
        description="; ".join(
            f"{kind}: {meaning}" for kind, meaning in MEANINGS.items() if kind != "own"
        ),
    )
    file: Path | None = None
    """instead of kind: a Python file with your own detector, relative to the campaign file"""
    sha256: own_part.Sha256 = None
    acts: Literal["watch", "stop"] = "watch"
    """only with file: watch, or stop: an alarm at the first threshold presses the E-stop a
    millisecond later"""
    fusion: Annotated[
        tuple[Fusion, ...],
        BeforeValidator(_make_list, json_schema_input_type=OneOrMore[Fusion]),
        Field(min_length=1),
    ] = ("all",)
    """only for kind steps: how many of its three signals must exceed their thresholds: all, two,
    any, or the named signal alone"""
    consecutive: Annotated[
        tuple[_UpTo8, ...],
        BeforeValidator(_make_list, json_schema_input_type=OneOrMore[_UpTo8]),
        Field(min_length=1),
    ] = (1,)
    """number of consecutive ticks above the threshold that raise an alarm, 1 to 8"""
    threshold: Annotated[_Numbers, Field(max_length=MOST_THRESHOLDS)] = (1.0,)
    """scores above which an alarm is raised; all are evaluated in the same run"""

    @model_validator(mode="after")
    def _fits(self) -> "Detector":
        # Checks that the keys of a detector can be used together.
        if (self.kind is None) == (self.file is None):
            got = "neither" if self.file is None else "both"
            raise ValueError(f"expected one key: kind (built-in) or file (your code), got {got}")
        if self.file is None and (self.acts != "watch" or self.sha256 is not None):
            raise ValueError("remove the keys `acts` and `sha256`, which need the key `file`")
        if self.file is not None:
            own_part.require_identifier(self.name)
        if self.kind != "steps" and self.fusion != ("all",):
            raise ValueError(
                f"fusion = {list(self.fusion)} needs kind 'steps', got kind"
                f" {self.kind or 'file'!r}: remove fusion"
            )
        return self

    def uses(self) -> Iterator[tuple[str, DetectorUse]]:
        """Yield (name, detector) for each combination of values of `fusion` and `consecutive`."""
        for fusion, count in itertools.product(self.fusion, self.consecutive):
            # A key with several values adds its value to the name, such as "mine/any/2".
            name = self.name
            name += f"/{fusion}" if len(self.fusion) > 1 else ""
            name += f"/{count}" if len(self.consecutive) > 1 else ""
            use = DetectorUse(
                kind=self.kind or "own",
                fusion=fusion,
                consecutive=count,
                thresholds=len(self.threshold),
                part=self.source,
                stops=self.acts == "stop",
            )
            yield name, use

    @property
    def source(self) -> OwnSource | None:
        """Return the code of the detector's file; None for a built-in detector. Raise UserError for
        a file that cannot be used or was changed.
        """
        if self.file is None:
            return None
        return own_part.own_source(self.name, self.file, self.sha256, "detector")


class OwnCheck(Section):
    """[[check]]: a check of your own inside the control loop. It acts in the same millisecond."""

    name: own_part.OwnName
    """name of the check in tables; its columns are check_own_NAME_.."""
    file: Path
    """Python file with the check, relative to the campaign file"""
    sha256: own_part.Sha256 = None
    at: str
    """seam at which the check acts"""
    acts: Action = Field(
        default="watch",
        description="action of the check when it trips; "
        + "; ".join(f"{word}: {meaning}" for word, meaning in DOES.items()),
    )
    threshold: float = Field(default=1.0, ge=0.0, le=1e6)
    """score above which the check trips; its parameter is checks.threshold.NAME"""
    consecutive: int = Field(default=1, ge=1, le=8)
    """number of consecutive ticks above the threshold before the check trips"""

    @property
    def source(self) -> OwnSource:
        """Code of the check's file. Raise UserError if it cannot be used or was changed."""
        return own_part.own_source(self.name, self.file, self.sha256, "check")

    @property
    def use(self) -> CheckUse:
        """Return the check in the form that the tick uses. Raise UserError as `source`."""
        return CheckUse(self.name, self.source, self.at, self.acts, self.consecutive)

    @property
    def check(self) -> Check:
        """Return the check in the form that the result table uses."""
        return of_own(self.name, self.at, self.acts)


class OwnHarm(Section):
    """[[harm]]: a harm that you define. It begins in the first millisecond in which its expression
    is true, even in a run without a fault.
    """

    name: own_part.OwnName
    """name of the harm in tables; its columns are harm_NAME_.."""
    when: str
    """expression over signals and time, such as `depth > 2 and once[0:100](speed > 50)`"""
    counts: Literal["joins", "replaces", "watch"] = "joins"
    """joins: this harm and unintended motion beyond the limit both count; replaces: only this harm
    counts; watch: this harm has columns, but does not count"""

    @field_validator("when")
    @classmethod
    def _check_expression(cls, when: str) -> str:
        harm.parse_harm(when)
        return when

    @property
    def use(self) -> harm.HarmUse:
        """The harm in the form that the tick uses."""
        return harm.HarmUse(self.name, self.when, self.counts)


class Outcomes(Section):
    """[outcomes]: the haptic set and the limit for verdicts, and the rule for jumps."""

    jump: Literal["code", "text"] = "code"
    """code: the measured tip moves more than jump_step_mm in two consecutive packets, and that of
    the golden run does not; text: the true tip moves more than large_jump_mm within two ticks"""
    cue: int = Field(default=0, ge=0)
    """number of the haptic set for the verdict, from 0"""
    jump_step_mm: float = Field(default=0.1, gt=0.0, le=1000.0)
    """for rule code: motion of the measured tip per packet, mm"""
    large_jump_mm: float = Field(default=1.0, gt=0.0, le=1000.0)
    """for rule text: motion of the true tip within two ticks, mm"""
    limit_mm: float = Field(default=LIMIT_MM, gt=0.0, le=1000.0)
    """unintended motion, or error of the reported tip, above which a run has a hazard, mm"""


class Stop(Section):
    """[stop]: stop the campaign early, at one of the looks, when every rate is precise enough.
    Groups without faults are always computed as a whole.
    """

    half_width: float = Field(gt=0.0, lt=0.5)
    """wanted precision: half of the width of each rate's interval, as a fraction"""
    rates: tuple[Annotated[str, OneOf("rate", events.EVENTS)], ...] = Field(
        default=("evades", "unintended_motion"), min_length=1
    )
    """rates that must be precise"""
    of: Literal["groups", "whole"] = "groups"
    """groups: the rates of each group; whole: the rates of the whole table"""
    looks: tuple[float, ...] = Field(
        default=tuple(round(10 ** (number / 10), 3) for number in range(-20, 1)),
        min_length=1,
        max_length=100,
    )
    """shares of each group after which rates are examined, increasing; the last share is the
    largest that is computed"""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """probability that all intervals are correct at all times"""
    allocation: Literal["proportional", "neyman"] = "proportional"
    """proportional: the same share of each group; neyman: after the first look, more runs of groups
    in which they narrow the intervals most"""

    @model_validator(mode="after")
    def _check_looks(self) -> "Stop":
        # Checks that the shares of the looks increase, and that each rate is named once.
        increases = list(self.looks) == sorted(set(self.looks))
        if not increases or not 0.0 < self.looks[0] <= self.looks[-1] <= 1.0:
            raise ValueError(
                f"looks = {list(self.looks)}, expected increasing shares, above 0 and at most 1"
            )
        if len(set(self.rates)) < len(self.rates):
            raise ValueError(f"rates = {list(self.rates)}, expected each rate once")
        return self
