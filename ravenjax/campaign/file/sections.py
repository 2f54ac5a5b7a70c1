"""Defines the sections of a campaign file that every robot has, as pydantic models.

They are [campaign], [haptics], [[detector]], [[check]], [outcomes] and [stop]. The models define
keys, units and ranges. The module `group` defines groups of runs.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

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
    """[campaign]: keys that hold for every run. A robot may have further keys."""

    robot: str = robots.DEFAULT
    """kind of robot, or the Python module that declares ROBOT"""
    name: str = Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=100)
    """short name; also names the default output folder"""
    description: str = ""
    """what the campaign asks"""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """seed of designs, noise and random effects"""
    duration_s: float = Field(default=3.0, gt=0.0, le=3600.0)
    """length of each run, s"""
    observe_ms: int | None = Field(default=None, ge=1, le=3_600_000)
    """end each run this long after its last fault ended, with the outcomes up to then. Left out,
    each run lasts for duration_s. So does a run whose faults have no certain end: a fault that
    lasts, or one that counts time in pedal-down where a fault may move the pedal"""
    arms: tuple[str, ...] = Field(
        default_factory=lambda known: robots.find_robot(known["robot"]).arms[:1], min_length=1
    )
    """arms, in order"""
    noise: bool = False
    """draw the robot's noise, a new draw for each run"""
    limit: int | None = Field(default=None, ge=1)
    """compute only this many runs, the first ones; a later start with more, or with all,
    continues
    """
    chunk: int | None = Field(default=None, ge=1, le=1_000_000)
    """rows per Parquet part; default: by the number of runs"""

    @property
    def ticks(self) -> int:
        """Control cycles per run, 1 ms each."""
        return round(self.duration_s * 1000.0)

    @field_validator("duration_s")
    @classmethod
    def _whole_ms(cls, duration: float) -> float:
        ticks = round(duration * 1000.0)
        if ticks < 1 or abs(duration * 1000.0 - ticks) > 1e-6 * ticks:
            raise ValueError(
                f"got {duration:.10g} s, expected whole milliseconds, at least 0.001 s, such as"
                f" {max(1, ticks) / 1000:g}"
            )
        return duration


class CueSet(NamedTuple):
    """One haptic threshold and gain set, in SI and device units."""

    threshold_m: float
    kp: float  # device units per m
    kd: float  # device units per m/s
    cap: float  # device units


_Item = TypeVar("_Item")
OneOrMore = _Item | Annotated[list[_Item], Field(min_length=1)]
"""Annotation for the JSON Schema: a file may write one value in place of a list of one."""


def _listed(raw: Any) -> Any:
    return raw if isinstance(raw, list | tuple) else (raw,)


_Least0 = Annotated[float, Field(ge=0.0, le=1e6)]
_Numbers = Annotated[
    tuple[_Least0, ...],
    BeforeValidator(_listed, json_schema_input_type=OneOrMore[_Least0]),
    Field(min_length=1),
]
"""A number or a list of numbers, none negative."""

MOST_CUES = 256
"""Largest number of haptic sets. Each costs every run some time and four columns."""


class Haptics(Section):
    """[haptics]: the cue's thresholds and gains, all evaluated in the same run."""

    threshold_mm: _Numbers = (PUBLISHED_CUE_MM,)
    """tip distance above which the cue pulls, mm"""
    kp_per_mm: _Numbers = (0.0045,)
    """spring, device units per mm"""
    kd_per_mm_s: _Numbers = (0.00009,)
    """damper, device units per mm/s"""
    cap: _Numbers = (0.05,)
    """largest force, device units"""
    combine: Literal["grid", "zip"] = "grid"
    """grid: every combination; zip: side by side"""

    @model_validator(mode="after")
    def _same_length(self) -> Haptics:
        lengths = {name: len(values) for name, values in self._lists().items() if len(values) > 1}
        if self.combine == "zip" and len(set(lengths.values())) > 1:
            raise ValueError(
                "combine = 'zip' needs lists of one length (or single numbers), got lengths"
                f" {lengths}"
            )
        sets = (
            max(lengths.values(), default=1)
            if self.combine == "zip"
            else math.prod(lengths.values())
        )
        if sets > MOST_CUES:
            raise ValueError(f"the lists make {sets} haptic sets, expected at most {MOST_CUES}")
        return self

    def _lists(self) -> dict[str, tuple[float, ...]]:
        return self.model_dump(exclude={"combine"})

    def cues(self) -> tuple[CueSet, ...]:
        """Every haptic set, in the order of the lists. The last list varies fastest."""
        lists = list(self._lists().values())
        if self.combine == "zip":
            longest = max(len(values) for values in lists)
            rows = zip(
                *(values * longest if len(values) == 1 else values for values in lists), strict=True
            )
        else:
            rows = itertools.product(*lists)
        return tuple(
            CueSet(threshold / 1e3, kp * 1e3, kd * 1e3, cap) for threshold, kp, kd, cap in rows
        )


MOST_THRESHOLDS = 64
"""Largest number of thresholds of a detector. Each costs every run some time and two columns."""

_UpTo8 = Annotated[int, Field(ge=1, le=8)]


class Detector(Section):
    """[[detector]]: a detector that observes the runs and is scored. If `fusion` or `consecutive`
    is a list, each pair of their values is one detector.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=60)
    """what it is called in tables"""
    kind: BuiltInKind | None = Field(
        default=None,
        description="; ".join(
            f"{kind}: {meaning}" for kind, meaning in MEANINGS.items() if kind != "own"
        ),
    )
    file: Path | None = None
    """in place of kind: a Python file with a detector of your own, from this file's folder"""
    sha256: own_part.Sha256 = None
    acts: Literal["watch", "stop"] = "watch"
    """of a file: watch; or stop: an alarm at its first threshold presses the E-stop a millisecond
    later"""
    fusion: Annotated[
        tuple[Fusion, ...],
        BeforeValidator(_listed, json_schema_input_type=OneOrMore[Fusion]),
        Field(min_length=1),
    ] = ("all",)
    """of steps: which of the three must be over; all, two, any, or one of them alone"""
    consecutive: Annotated[
        tuple[_UpTo8, ...],
        BeforeValidator(_listed, json_schema_input_type=OneOrMore[_UpTo8]),
        Field(min_length=1),
    ] = (1,)
    """milliseconds in a row above the threshold that make an alarm, 1 to 8"""
    threshold: Annotated[_Numbers, Field(max_length=MOST_THRESHOLDS)] = (1.0,)
    """alarm above it; all evaluated in the same run"""

    @model_validator(mode="after")
    def _fits(self) -> Detector:
        if (self.kind is None) == (self.file is None):
            got = "neither" if self.file is None else "both"
            raise ValueError(f"expected one of kind (built in) and file (your own), got {got}")
        if self.file is None and (self.acts != "watch" or self.sha256 is not None):
            raise ValueError("acts and sha256 belong to a detector with a file: remove them")
        if self.file is not None:
            own_part.require_identifier(self.name)
        if self.kind != "steps" and self.fusion != ("all",):
            raise ValueError(
                f"fusion = {list(self.fusion)} belongs to kind 'steps', got kind"
                f" {self.kind or 'file'!r}: remove it"
            )
        return self

    def uses(self) -> tuple[tuple[str, DetectorUse], ...]:
        """(name, detector) of each detector that this table declares."""
        many_fusions, many_counts = len(self.fusion) > 1, len(self.consecutive) > 1
        return tuple(
            (
                self.name + f"/{fusion}" * many_fusions + f"/{count}" * many_counts,
                DetectorUse(
                    self.kind or "own",
                    fusion,
                    count,
                    len(self.threshold),
                    self.part,
                    self.acts == "stop",
                ),
            )
            for fusion in self.fusion
            for count in self.consecutive
        )

    @property
    def part(self) -> OwnSource | None:
        """Return the code of the detector's file; None for a built-in detector.

        Raises UserError for a file that is unusable or changed.
        """
        if self.file is None:
            return None
        return own_part.part_source(self.name, self.file, self.sha256, "detector")


class OwnCheck(Section):
    """[[check]]: a check of your own inside the control loop. It acts in the same millisecond."""

    name: own_part.OwnName
    """what it is called in tables, where its columns are check_own_NAME_.."""
    file: Path
    """a Python file with the check, from this file's folder"""
    sha256: own_part.Sha256 = None
    at: str
    """seam at which the check acts"""
    acts: Action = Field(
        default="watch",
        description="what it does when it trips, by the robot's own means; "
        + "; ".join(f"{word}: {meaning}" for word, meaning in DOES.items()),
    )
    threshold: float = Field(default=1.0, ge=0.0, le=1e6)
    """it trips above it; varied as checks.threshold.NAME"""
    consecutive: int = Field(default=1, ge=1, le=8)
    """milliseconds in a row above the threshold in which it trips from then on"""

    @property
    def part(self) -> OwnSource:
        """The code of its file. Raises UserError for one that is unusable or changed."""
        return own_part.part_source(self.name, self.file, self.sha256, "check")

    @property
    def use(self) -> CheckUse:
        """Return the check as the tick uses it. Raises UserError as `part`."""
        return CheckUse(self.name, self.part, self.at, self.acts, self.consecutive)

    @property
    def check(self) -> Check:
        """Return the check as the result table describes it."""
        return of_own(self.name, self.at, self.acts)


class OwnHarm(Section):
    """[[harm]]: a harm of your own. It begins in the first millisecond in which its expression is
    true, also if it comes without a fault.
    """

    name: own_part.OwnName
    """what it is called in tables, where its columns are harm_NAME_.."""
    when: str
    """expression over signals and time, such as `depth > 2 and once[0:100](speed > 50)`"""
    counts: Literal["joins", "replaces", "watch"] = "joins"
    """joins: an unintended motion beyond the limit is harm, too; replaces: it is not; watch: the
    harm has columns and decides nothing"""

    @field_validator("when")
    @classmethod
    def _understood(cls, when: str) -> str:
        harm.parse_harm(when)
        return when

    @property
    def use(self) -> harm.HarmUse:
        """The harm as the tick uses it."""
        return harm.HarmUse(self.name, self.when, self.counts)


class Outcomes(Section):
    """[outcomes]: the haptic set and the limit that decide the verdict, and the rule for jumps."""

    jump: Literal["code", "text"] = "code"
    """code: measured tip steps > jump_step_mm on two packets in a row, the golden run's not; text:
    true tip > large_jump_mm within 2 ms"""
    cue: int = Field(default=0, ge=0)
    """number of the haptic set, from 0"""
    jump_step_mm: float = Field(default=0.1, gt=0.0, le=1000.0)
    """of rule code: step of the measured tip per packet, mm"""
    large_jump_mm: float = Field(default=1.0, gt=0.0, le=1000.0)
    """of rule text: motion of the true tip within 2 ms, mm"""
    limit_mm: float = Field(default=LIMIT_MM, gt=0.0, le=1000.0)
    """a motion, or an error of the report, of more than this is a hazard, mm"""


class Stop(Section):
    """[stop]: stop the campaign early, at one of the planned looks, when every rate is precise
    enough.

    Groups without faults are computed as a whole and not judged.
    """

    half_width: float = Field(gt=0.0, lt=0.5)
    """stop once each rate is known within +- this fraction"""
    rates: tuple[Annotated[str, OneOf("rate", events.EVENTS)], ...] = Field(
        default=("evades", "unintended_motion"), min_length=1
    )
    """which rates"""
    of: Literal["groups", "whole"] = "groups"
    """groups: the rates of each group; whole: those of the whole table"""
    looks: tuple[float, ...] = Field(
        default=(0.1, 0.2, 0.4, 0.7, 1.0), min_length=1, max_length=100
    )
    """shares of each group after which one looks, increasing; no more than the last is computed"""
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """with which all intervals of all looks hold"""
    allocation: Literal["proportional", "neyman"] = "proportional"
    """proportional: as many of each group; neyman: after the first look where it narrows most"""

    @model_validator(mode="after")
    def _increasing(self) -> Stop:
        if (
            list(self.looks) != sorted(set(self.looks))
            or not 0.0 < self.looks[0] <= self.looks[-1] <= 1.0
        ):
            raise ValueError(
                f"looks = {list(self.looks)}, expected increasing shares, above 0 and at most 1"
            )
        if len(set(self.rates)) < len(self.rates):
            raise ValueError(f"rates = {list(self.rates)}, expected each once")
        return self
