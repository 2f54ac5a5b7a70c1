"""The campaign file: its sections and keys, with units and ranges; its groups of runs are in `group`.

`loading` reads a file, `semantics` checks its words.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from ravenjax.campaign.file.axis import Number
from ravenjax.campaign.file.group import Cross, Group, Section, flatten_parameters
from ravenjax.errors import shown, suggestion
from ravenjax.numbers.setup import DetectorUse
from ravenjax.outcomes import events
from ravenjax.outcomes.verdict import LIMIT_MM, PUBLISHED_CUE_MM
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.store.motion.options import MAX_GAP_S, AtEnd, ReplayOptions, Spikes
from ravenjax.vocabulary.robot import Robot


class Campaign(Section):
    """[campaign]: what holds for every run."""

    name: str = Field(
        description="short name; also names the default output folder",
        pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$",
        max_length=100,
    )
    description: str = Field(default="", description="what the campaign asks")
    seed: int = Field(default=0, ge=0, lt=2**31, description="seed of designs, noise and random effects")
    duration_s: float = Field(default=3.0, gt=0.0, le=3600.0, description="length of each run, s")
    arms: tuple[ArmName, ...] = Field(default=("gold",), min_length=1, max_length=2, description="arms, gold first")
    software: Literal["raven2", "fork2015"] = Field(
        default="raven2", description="control software: present raven2, or the 2015 fork"
    )
    build: Literal["robot", "dyn_sim"] = Field(
        default="robot",
        description="what the software was built for; dyn_sim, of fork2015: motors 1-3 read from the model without "
        "encoders and filter, ideal tool joints, packets that end with a software E-stop",
    )
    dac_words: Literal["wrap", "saturate", "unwrapped"] | None = Field(
        default=None,
        description="how a DAC command that a fault wrote behind the checks is stored in the 16 bits of a USB word; "
        "left out, it wraps, and a fault's value beyond 16 bits is refused",
    )
    tools: tuple[str, ...] | None = Field(default=None, description="one tool per arm; default: the software's own")
    console: Literal["increments", "absolute"] = Field(
        default="increments", description="what a packet carries: increments of the hand's motion, or positions"
    )
    policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] = Field(
        default="soft_regulation",
        description="what raven2's overdrive check does with a command above the limit of its level: nothing, clip it, "
        "or stop after ten; the fork has no policy",
    )
    level: Literal["beginner", "moderate", "advanced", "fork2015"] | None = Field(
        default=None,
        description="limits of the overdrive check, counts a joint; default moderate for raven2, fork2015 for the fork",
    )
    parameter_set: Literal["traj3", "A", "B", "C", "D", "E", "matlab_main", "matlab_global"] = Field(
        "traj3", description="published parameters of the virtual robot's first three joints"
    )
    noise: bool = Field(
        default=False, description="draw noise of the sizes plant.encoder_noise and plant.torque_noise, anew each run"
    )
    substeps: int = Field(default=1, ge=1, le=100, description="plant steps per 1 ms tick")
    limit: int | None = Field(
        default=None, ge=1, description="compute only the first so many runs; a start with more, or with all, goes on"
    )
    chunk: int | None = Field(
        default=None, ge=1, le=1_000_000, description="rows per Parquet part; default: by the number of runs"
    )

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
                f"got {duration:.10g} s, expected whole milliseconds from 0.001 on, such as {max(1, ticks) / 1000:g}"
            )
        return duration

    @property
    def stored_words(self) -> Literal["wrap", "saturate", "unwrapped"]:
        """How a DAC command behind the checks is stored."""
        return self.dac_words or "wrap"


HARD_RANGES = {
    "shoulder_deg": (0.0, 90.0),
    "elbow_deg": (45.0, 137.5),
    "insertion_m": (0.23, 0.562),
    "tool_roll_deg": (-330.0, 330.0),
    "wrist_deg": (-100.0, 100.0),
}
"""Where the joint meets its hard stop, or its original soft limit where no stop is published; raven2 `defines.h`,
`tools.cpp` (r_grasper)."""


class Start(Section):
    """[operator.start]: joints in which a generated motion begins; what is left out is as after homing."""

    shoulder_deg: float | None = Field(default=None, description="shoulder, between its hard stops")
    elbow_deg: float | None = Field(default=None, description="elbow, between its hard stops")
    insertion_m: float | None = Field(default=None, description="insertion; less draws the instrument back")
    tool_roll_deg: float | None = Field(default=None, description="roll of the instrument")
    wrist_deg: float | None = Field(default=None, description="wrist of the instrument")

    @field_validator(*HARD_RANGES)
    @classmethod
    def _within(cls, value: float | None, info: ValidationInfo) -> float | None:
        low, high = HARD_RANGES[str(info.field_name)]
        if value is not None and not low <= value <= high:
            raise ValueError(f"got {value:g}, expected {low:g}..{high:g} (the hard stops)")
        return value

    def si(self) -> dict[str, float]:
        """The joints that were given, rad and m."""
        return {joint: value * factor for joint, factor, value in _given(self)}


def _given(section: Section) -> Iterator[tuple[str, float, Any]]:
    """(joint, factor to rad or m, what was given) of each key of HARD_RANGES that a section holds."""
    for name in HARD_RANGES:
        if (value := getattr(section, name)) is not None:
            joint, _, unit = name.rpartition("_")
            yield joint, math.pi / 180.0 if unit == "deg" else 1.0, value


RECORDED = tuple(field.name for field in dataclasses.fields(ReplayOptions))
GENERATED = ("seed",)
"""Keys of [operator] that only one kind of motion has."""


class Operator(Section):
    """[operator]: whose hands move."""

    motion: str | None = Field(default=None, description="a generated motion: " + ", ".join(MOTIONS))
    file: Path | None = Field(
        default=None, description="a recorded motion (Parquet, CSV, MCAP), from this file's folder"
    )
    scale: float = Field(
        default=0.1,
        gt=0.0,
        le=1.0,
        description="teleoperation scale; varied as operator.scale. At the scale written here a recorded tip moves as "
        "recorded; a generated motion is planned for 0.1",
    )
    seed: int = Field(default=0, ge=0, lt=2**31, description="seed of the generated motion")
    window_s: tuple[float, float] | None = Field(default=None, description="[begin, end] within a recorded motion, s")
    rate_hz: float | None = Field(
        default=None,
        gt=0.0,
        le=100_000.0,
        description="rows a second of a recorded motion, evenly spaced: where it has no times, or those of arrival",
    )
    cutoff_hz: float | None = Field(
        default=None, gt=0.0, lt=500.0, description="low-pass of a recorded motion, Hz; without it none: tremor stays"
    )
    max_gap_s: float = Field(
        default=MAX_GAP_S,
        gt=0.0,
        le=60.0,
        description="longest gap of a recorded motion that is bridged by interpolation, s",
    )
    spikes: Spikes = Field(
        default="refuse",
        description="a recorded tip that jumps: refuse; remove: interpolate where it comes back; replay: as it is",
    )
    at_end: AtEnd = Field(
        default="refuse",
        description="a recorded motion that ends before the run: refuse; hold: hands rest; reverse: back and forth",
    )
    start: Start = Start()
    slow_down: float = Field(default=1.0, ge=0.1, le=100.0, description="how much slower than recorded it is replayed")

    @model_validator(mode="before")
    @classmethod
    def _one_source(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and raw.get("motion") is not None and raw.get("file") is not None:
            raise ValueError("give either motion (generated) or file (recorded), not both")
        return raw

    @field_validator("file")
    @classmethod
    def _path(cls, file: Path | None) -> Path | None:
        if file is not None and (not file.name or "\0" in str(file)):
            raise ValueError(f"got {shown(str(file))}, expected the path of a .parquet, .csv or .mcap file")
        return file

    @model_validator(mode="after")
    def _window(self) -> Operator:
        if self.file is not None and self.start.si():
            raise ValueError(
                "start belongs to a generated motion; a recorded one begins where it was recorded: remove it"
            )
        if self.window_s is not None and not 0.0 <= self.window_s[0] < self.window_s[1]:
            raise ValueError(f"window_s = [begin, end] in s: expected 0 <= begin < end, got {list(self.window_s)}")
        for name in RECORDED if self.file is None else GENERATED:
            if getattr(self, name) != type(self).model_fields[name].default:
                kind, other = ("recorded", "generated") if self.file is None else ("generated", "recorded")
                raise ValueError(f"{name} belongs to a {kind} motion, a {other} one has none: remove it")
        return self

    @property
    def options(self) -> ReplayOptions:
        """How a recorded motion is replayed."""
        return ReplayOptions(**{name: getattr(self, name) for name in RECORDED})

    @property
    def label(self) -> str:
        """Name of the motion in tables."""
        return self.file.stem if self.file is not None else self.motion or "suture"


class CueSet(NamedTuple):
    """One haptic threshold and gain set, in SI and device units."""

    threshold_m: float
    kp: float  # device units per m
    kd: float  # device units per m/s
    cap: float  # device units


_Item = TypeVar("_Item")
OneOrMore = _Item | Annotated[list[_Item], Field(min_length=1)]
"""What a file may write where one value stands for a list of one; for the JSON Schema."""


def _listed(raw: Any) -> Any:
    return raw if isinstance(raw, list | tuple) else (raw,)


_Least0 = Annotated[float, Field(ge=0.0, le=1e6)]
_Numbers = Annotated[
    tuple[_Least0, ...], BeforeValidator(_listed, json_schema_input_type=OneOrMore[_Least0]), Field(min_length=1)
]
"""A number or a list of numbers, none negative."""

MOST_CUES = 256
"""Haptic sets: each costs every run some time and four columns."""


class Haptics(Section):
    """[haptics]: the cue's thresholds and gains, all evaluated in the same run."""

    threshold_mm: _Numbers = Field(
        default=(PUBLISHED_CUE_MM,), description="tip distance above which the cue pulls, mm"
    )
    kp_per_mm: _Numbers = Field(default=(0.0045,), description="spring, device units per mm")
    kd_per_mm_s: _Numbers = Field(default=(0.00009,), description="damper, device units per mm/s")
    cap: _Numbers = Field(default=(0.05,), description="largest force, device units")
    combine: Literal["grid", "zip"] = Field(default="grid", description="grid: every combination; zip: side by side")

    @model_validator(mode="after")
    def _same_length(self) -> Haptics:
        lengths = {name: len(values) for name, values in self._lists().items() if len(values) > 1}
        if self.combine == "zip" and len(set(lengths.values())) > 1:
            raise ValueError(f"combine = 'zip' needs lists of one length (or single numbers), got lengths {lengths}")
        sets = max(lengths.values(), default=1) if self.combine == "zip" else math.prod(lengths.values())
        if sets > MOST_CUES:
            raise ValueError(f"the lists make {sets} haptic sets, expected at most {MOST_CUES}")
        return self

    def _lists(self) -> dict[str, tuple[float, ...]]:
        return {name: getattr(self, name) for name in ("threshold_mm", "kp_per_mm", "kd_per_mm_s", "cap")}

    def cues(self) -> tuple[CueSet, ...]:
        """Every set, in the order of the lists, the last list varying fastest."""
        lists = list(self._lists().values())
        if self.combine == "zip":
            longest = max(len(values) for values in lists)
            rows = zip(*(values * longest if len(values) == 1 else values for values in lists), strict=True)
        else:
            rows = itertools.product(*lists)
        return tuple(CueSet(threshold / 1e3, kp * 1e3, kd * 1e3, cap) for threshold, kp, kd, cap in rows)


class Limits(Section):
    """[limits]: soft joint limits of the control software; what is left out keeps the original's."""

    shoulder_deg: tuple[float, float] | None = Field(default=None, description="[min, max] of the shoulder")
    elbow_deg: tuple[float, float] | None = Field(default=None, description="[min, max] of the elbow")
    insertion_m: tuple[float, float] | None = Field(default=None, description="[min, max] of the insertion")
    tool_roll_deg: tuple[float, float] | None = Field(default=None, description="[min, max] of the instrument's roll")
    wrist_deg: tuple[float, float] | None = Field(default=None, description="[min, max] of the instrument's wrist")

    @field_validator(*HARD_RANGES)
    @classmethod
    def _within(cls, pair: tuple[float, float] | None, info: ValidationInfo) -> tuple[float, float] | None:
        low, high = HARD_RANGES[str(info.field_name)]
        if pair is not None and not low <= pair[0] < pair[1] <= high:
            raise ValueError(f"got {list(pair)}, expected {low:g} <= min < max <= {high:g} (the hard stops)")
        return pair

    def si(self) -> dict[str, tuple[float, float]]:
        """The limits that were given, by joint, in rad and m."""
        return {joint: (low * factor, high * factor) for joint, factor, (low, high) in _given(self)}


class Reaction(Section):
    """[reaction]: an operator who reacts to the first haptic cue; varied as reaction.delay_ms and so on."""

    action: Literal["none", "release", "slow", "correct"] = Field(
        default="release", description="lift the pedal, slow down, or correct by eye; varied as reaction.action, 0 to 3"
    )
    delay_ms: float = Field(
        default=250.0, ge=0.0, le=60_000.0, description="from the first felt pull to the action, ms"
    )
    felt_force: float = Field(default=0.0, ge=0.0, description="a weaker pull is not noticed, device units")
    slow_to: float = Field(default=0.25, ge=0.0, le=1.0, description="speed of slowed hands, of what it was")
    correct_per_s: float = Field(default=5.0, ge=0.0, le=1000.0, description="share of the distance corrected, 1/s")
    correct_mm_s: float = Field(default=50.0, ge=0.0, le=10_000.0, description="fastest correction of the tip, mm/s")


MOST_LEVELS = 64
"""Of a detector: each costs every run some time and two columns."""

Fusion = Literal["all", "two", "any", "mpos", "mvel", "jpos"]
_UpTo8 = Annotated[int, Field(ge=1, le=8)]


class Detector(Section):
    """[[detector]]: an observer that is scored. Lists of `fusion` and `consecutive` make one detector of each pair."""

    name: str = Field(
        description="what it is called in tables", pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=60
    )
    kind: Literal["steps", "derivative_sum", "tip_error", "overdrive"] = Field(
        description="steps: of motor position, motor velocity and joint position over their thresholds, model-based; "
        "derivative_sum: of link and motor derivatives; tip_error: distance from the nominal model, mm; overdrive: "
        "command over its clip limit"
    )
    fusion: Annotated[
        tuple[Fusion, ...], BeforeValidator(_listed, json_schema_input_type=OneOrMore[Fusion]), Field(min_length=1)
    ] = Field(
        default=("all",), description="of steps: which of the three must be over; all, two, any, or one of them alone"
    )
    consecutive: Annotated[
        tuple[int, ...], BeforeValidator(_listed, json_schema_input_type=OneOrMore[_UpTo8]), Field(min_length=1)
    ] = Field(default=(1,), description="milliseconds in a row above the level that make an alarm, 1 to 8")
    level: _Numbers = Field(default=(1.0,), description="alarm above it; all evaluated in the same run")

    @model_validator(mode="after")
    def _fits(self) -> Detector:
        if self.kind != "steps" and self.fusion != ("all",):
            raise ValueError(f"fusion = {list(self.fusion)} belongs to kind 'steps', got kind {self.kind!r}: remove it")
        if not all(1 <= count <= 8 for count in self.consecutive):
            raise ValueError(f"consecutive = {list(self.consecutive)}, expected 1 to 8")
        if len(self.level) > MOST_LEVELS:
            raise ValueError(f"level has {len(self.level)} numbers, expected at most {MOST_LEVELS}")
        return self

    def uses(self) -> tuple[tuple[str, DetectorUse], ...]:
        """(name, detector) of each that it stands for."""
        many_fusions, many_counts = len(self.fusion) > 1, len(self.consecutive) > 1
        return tuple(
            (
                self.name + (f"/{fusion}" if many_fusions else "") + (f"/{count}" if many_counts else ""),
                DetectorUse(self.kind, fusion, count, len(self.level)),
            )
            for fusion in self.fusion
            for count in self.consecutive
        )


def _rate(raw: Any) -> Any:
    """The name of an event; ValueError where it is none, with what to write instead."""
    if isinstance(raw, str) and raw not in events.EVENTS:
        if raw in events.FORMER:
            raise ValueError(f"got {raw!r}, which is now called {events.FORMER[raw]!r}: write that")
        raise ValueError(f"got {raw!r}, expected one of {', '.join(events.EVENTS)}{suggestion(raw, events.EVENTS)}")
    return raw


Rate = Annotated[str, BeforeValidator(_rate)]
"""A rate of the table: the share of runs with an event of `ravenjax.outcomes.events`."""


class Outcomes(Section):
    """[outcomes]: which of the recorded outcomes the headline verdict uses."""

    jump: Literal["code", "text"] = Field(
        default="code",
        description="code: measured tip steps > jump_step_mm on two packets in a row, the golden run's not; text: true "
        "tip > large_jump_mm within 2 ms",
    )
    cue: int = Field(default=0, ge=0, description="number of the haptic set, from 0")
    jump_step_mm: float = Field(
        default=0.1, gt=0.0, le=1000.0, description="of rule code: step of the measured tip per packet, mm"
    )
    large_jump_mm: float = Field(
        default=1.0, gt=0.0, le=1000.0, description="of rule text: motion of the true tip within 2 ms, mm"
    )
    limit_mm: float = Field(
        default=LIMIT_MM,
        gt=0.0,
        le=1000.0,
        description="a motion, or an error of the report, of more than this is a hazard, mm",
    )


class Stop(Section):
    """[stop]: compute the table by looks that are planned here, and stop once every rate is known well enough.

    Groups without faults are computed as a whole and not judged.
    """

    half_width: float = Field(gt=0.0, lt=0.5, description="stop once each rate is known within +- this fraction")
    rates: tuple[Rate, ...] = Field(
        default=("evades", "unintended_motion"), min_length=1, description="which rates: " + ", ".join(events.EVENTS)
    )
    of: Literal["groups", "whole"] = Field(
        default="groups", description="groups: the rates of each group; whole: those of the whole table"
    )
    looks: tuple[float, ...] = Field(
        default=(0.1, 0.2, 0.4, 0.7, 1.0),
        min_length=1,
        max_length=100,
        description="shares of each group after which one looks, increasing; no more than the last is computed",
    )
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0, description="with which all intervals of all looks hold")
    allocation: Literal["proportional", "neyman"] = Field(
        default="proportional",
        description="proportional: as many of each group; neyman: after the first look where it narrows most",
    )

    @model_validator(mode="after")
    def _increasing(self) -> Stop:
        if list(self.looks) != sorted(set(self.looks)) or not 0.0 < self.looks[0] <= self.looks[-1] <= 1.0:
            raise ValueError(f"looks = {list(self.looks)}, expected increasing shares, above 0 and at most 1")
        if len(set(self.rates)) < len(self.rates):
            raise ValueError(f"rates = {list(self.rates)}, expected each once")
        return self


class CampaignConfig(Section):
    """A whole campaign file."""

    campaign: Campaign
    operator: Operator = Operator(motion="suture")
    parameters: dict[str, Number] = Field(default_factory=dict, description="path = value, list or distribution")
    cross: Cross = Field(
        default_factory=dict,
        description="path = list: every run once with each value, all else alike, random numbers too; for pairs",
    )
    limits: Limits = Limits()
    haptics: Haptics = Haptics()
    reaction: Reaction | None = Field(default=None, description="an operator who reacts; without it nobody does")
    detector: tuple[Detector, ...] = Field(default=(), description="observers that are scored")
    outcomes: Outcomes = Outcomes()
    stop: Stop | None = Field(default=None, description="when to stop; without it the whole table is computed")
    group: tuple[Group, ...] = Field(min_length=1, description="the runs")
    _source: Path | None = PrivateAttr(None)

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, raw: Any) -> Any:
        return flatten_parameters(raw)

    @field_validator("group")
    @classmethod
    def _judged(cls, groups: tuple[Group, ...], info: ValidationInfo) -> tuple[Group, ...]:
        if info.data.get("stop") is not None and not any(group.fault for group in groups):
            raise ValueError("no group has a fault: there is nothing that [stop] could judge; remove it")
        return groups

    @field_validator("stop")
    @classmethod
    def _unlimited(cls, stop: Stop | None, info: ValidationInfo) -> Stop | None:
        campaign = info.data.get("campaign")
        if stop is not None and campaign is not None and campaign.limit is not None:
            raise ValueError(
                f"campaign.limit = {campaign.limit} would cut the groups that the looks are shares of; "
                "to compute less write a smaller last look, such as looks = [0.01, 0.05]"
            )
        return stop

    @property
    def source(self) -> Path | None:
        """The file that it was read from."""
        return self._source

    def with_source(self, path: Path) -> CampaignConfig:
        """Itself, read from `path`; a recorded operator's path is taken from there."""
        new, file = self, self.operator.file
        if file is not None and not file.is_absolute():
            operator = self.operator.model_copy(update={"file": (path.parent / file).absolute()})
            new = self.model_copy(update={"operator": operator})
        new._source = path
        return new

    @property
    def detectors(self) -> tuple[tuple[str, DetectorUse, tuple[float, ...]], ...]:
        """(name, detector, levels) of every one, in order."""
        return tuple((name, use, one.level) for one in self.detector for name, use in one.uses())

    @property
    def rules(self) -> events.Rules:
        """What it chooses of the definitions of outcomes."""
        cue, jump = self.outcomes.cue, f"jump_{self.outcomes.jump}"
        return events.Rules(cue, self.haptics.cues()[cue].threshold_m * 1e3, jump, self.outcomes.limit_mm)

    @property
    def robot(self) -> Robot:
        """The robot that it is of."""
        return ROBOT

    @property
    def slots(self) -> int:
        """Fault slots that a run needs."""
        return max(len(group.fault) for group in self.group)

    @property
    def tools(self) -> tuple[str, ...]:
        """One tool name per arm."""
        defaults = DEFAULT_TOOLS[self.campaign.software]
        return self.campaign.tools or tuple(defaults[arm] for arm in self.campaign.arms)
