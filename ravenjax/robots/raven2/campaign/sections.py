"""Sections of a Raven-II's campaign file: [campaign], [operator], [limits], [reaction], [hand],
[controller].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from ravenjax.campaign.file import own_part
from ravenjax.campaign.file.section import OneOf, Section
from ravenjax.campaign.file.sections import CampaignSection
from ravenjax.errors import format_value, suggest_name
from ravenjax.parts import part
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.tools import TOOLS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.store.motion.options import (
    MAX_GAP_S,
    MOST_GAP_S,
    AtEnd,
    Columns,
    Frame,
    Place,
    ReplayOptions,
    Spikes,
    Triple,
    Turn,
)
from ravenjax.vocabulary import packets
from ravenjax.vocabulary.parts import OwnSource


def _packets(raw: Any) -> Any:
    """Return a distribution of packets: its name, or its shares. Raises ValueError."""
    names = ", ".join(map(repr, packets.CHOICES))
    if isinstance(raw, str) and raw not in packets.CHOICES:
        raise ValueError(
            f"got {raw!r}, expected one of {names}{suggest_name(raw, packets.CHOICES)}, or a list"
            " of shares"
        )
    if not isinstance(raw, list | tuple):
        return raw
    if not 1 <= len(raw) <= packets.MOST_CYCLES:
        raise ValueError(
            f"got {len(raw)} shares, expected 1 to {packets.MOST_CYCLES}: of 1, 2, 3, .. cycles"
        )
    numbers = [x for x in raw if isinstance(x, int | float) and not isinstance(x, bool) and x >= 0]
    if len(numbers) < len(raw) or abs(math.fsum(numbers) - 1.0) > 1e-6:
        total = f", whose sum is {math.fsum(numbers):g}" if len(numbers) == len(raw) else ""
        raise ValueError(
            f"got {format_value(list(raw))}{total}, expected shares of packets that last 1, 2, 3,"
            " .. cycles, none negative and 1 in all, such as [0.1, 0.8, 0.1]"
        )
    return tuple(float(x) for x in numbers)


Packets = Annotated[
    Literal["every_cycle", "measured", "bursts"] | tuple[float, ...], BeforeValidator(_packets)
]
"""How long packets last: a name of `vocabulary.packets`, or a list of shares."""


class RavenCampaign(CampaignSection):
    """[campaign]: settings of every run."""

    arms: tuple[ArmName, ...] = Field(default=("gold",), min_length=1, max_length=2)
    """arms, gold first"""
    noise: bool = False
    """draw noise of the sizes plant.encoder_noise and plant.torque_noise for each run"""
    software: Literal["raven2", "fork2015"] = "raven2"
    """control software: present raven2, or the 2015 fork"""
    build: Literal["robot", "dyn_sim", "dyn_sim_tools"] = "robot"
    """what the software was built for; dyn_sim, of fork2015: motors 1-3 read from the model without
    encoders and filter, ideal tool joints, packets that end with a software E-stop; dyn_sim_tools:
    the same, but tool joints measured as on the robot, which nobody published"""
    dac_words: Literal["wrap", "saturate", "unwrapped"] | None = None
    """how a DAC command that a fault wrote behind the checks is stored in the 16 bits of a USB
    word; left out, it wraps, and a fault's value beyond 16 bits is refused"""
    tools: tuple[Annotated[str, OneOf("tool", TOOLS)], ...] | None = None
    """one tool per arm; default: the software's own"""
    console: Literal["increments", "absolute"] = "increments"
    """what a packet carries: increments of the hand's motion, or positions"""
    packets: Packets = "every_cycle"
    """how many control cycles a packet of the console lasts, drawn for each run: every_cycle: one;
    measured: as on a recorded robot, two in 93 of 100; bursts: as a recorded console sends, one to
    three, and 6 to 11 in 18 of 100; or the shares of packets that last 1, 2, 3, .. cycles. The hand
    moves on meanwhile; varied as network.packets, 0 to 3"""
    policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] = "soft_regulation"
    """what raven2's overdrive check does with a command above the limit of its level: nothing, clip
    it, or stop after ten; the fork has no policy"""
    level: Literal["beginner", "moderate", "advanced", "fork2015"] | None = None
    """limits of the overdrive check, counts a joint; default moderate for raven2, fork2015 for the
    fork"""
    parameter_set: parameter_sets.Name = parameter_sets.DEFAULT
    """mechanics of the virtual robot: power_consistent, or a set that the authors published for its
    first three joints, under their law of motor and cable"""
    kinematic_errors: Literal["none", "measured"] = "none"
    """what makes a healthy robot's report wrong (joint offsets after homing, drums, links): none;
    measured: drawn for each run and arm, as large as cameras saw on a real arm, an upper
    bound. Half of it: plant.kinematic_errors.scale = 0.5"""
    cables: Literal["unbreakable", "break"] = "unbreakable"
    """what a cable does whose tension exceeds plant.cable_strength: hold all the same, or part, and
    carry nothing for the rest of the run. Either way overload is an outcome of power_consistent;
    tensions of the published sets are no real ones, and nothing breaks there"""
    contact: bool = False
    """whether jaw tips press on the scene's tissue and vessel, and instruments on each other:
    forces on the robot, and outcomes; the numbers are parameters contact... Without it nothing is
    touched"""
    substeps: int = Field(default=1, ge=1, le=100)
    """plant steps per 1 ms tick"""

    @model_validator(mode="after")
    def _together(self) -> RavenCampaign:
        if self.tools is not None and len(self.tools) != len(self.arms):
            raise ValueError(
                f"tools: got {len(self.tools)}, expected one per arm ({len(self.arms)})"
            )
        if self.build != "robot" and self.software != "fork2015":
            raise ValueError(
                f"build: got {self.build!r}, expected software = 'fork2015': only the 2015 fork was"
                " built so"
            )
        if self.cables == "break" and not parameter_sets.tells_tension(self.parameter_set):
            raise ValueError(
                "cables: got 'break', but motors pull at the cables of parameter_set"
                f" {self.parameter_set!r} twelve times as hard as real ones can: take parameter_set"
                " = 'power_consistent'"
            )
        if self.software == "fork2015" and self.policy != "soft_regulation":
            raise ValueError(
                f"policy: got {self.policy!r}, but the 2015 fork has no policy: remove the key"
            )
        return self

    @property
    def packet_choice(self) -> int:
        """Number of the distribution of packets: one of CHOICES, or OWN."""
        if isinstance(self.packets, str):
            return packets.CHOICES.index(self.packets)
        every_cycle = self.packets == packets.SHARES[packets.EVERY_CYCLE]
        return packets.EVERY_CYCLE if every_cycle else packets.OWN

    @property
    def packet_shares(self) -> tuple[float, ...]:
        """Shares of packets that last 1, 2, 3, .. cycles."""
        if isinstance(self.packets, str):
            return packets.SHARES[self.packet_choice]
        return self.packets


# Where the joint meets its hard stop, or its original soft limit if no stop is published; raven2
# `defines.h`, `tools.cpp` (r_grasper).
_Shoulder = Annotated[float, Field(ge=0.0, le=90.0)]
_Elbow = Annotated[float, Field(ge=45.0, le=137.5)]
_Insertion = Annotated[float, Field(ge=0.23, le=0.562)]
_Roll = Annotated[float, Field(ge=-330.0, le=330.0)]
_Wrist = Annotated[float, Field(ge=-100.0, le=100.0)]


class Start(Section):
    """[operator.start]: joint positions at the start of a generated motion. Omitted joints start at
    the home pose.
    """

    shoulder_deg: _Shoulder | None = None
    """shoulder, between its hard stops"""
    elbow_deg: _Elbow | None = None
    """elbow, between its hard stops"""
    insertion_m: _Insertion | None = None
    """insertion; less draws the instrument back"""
    tool_roll_deg: _Roll | None = None
    """roll of the instrument"""
    wrist_deg: _Wrist | None = None
    """wrist of the instrument"""

    def si(self) -> dict[str, float]:
        """Return the joints that were given, rad and m."""
        return {joint: value * factor for joint, factor, value in _given(self)}


def _given(section: Section) -> Iterator[tuple[str, float, Any]]:
    """Yield (joint, factor to rad or m, given value) for each joint that a section has."""
    for name in type(section).model_fields:
        if (value := getattr(section, name)) is not None:
            joint, _, unit = name.rpartition("_")
            yield joint, math.pi / 180.0 if unit == "deg" else 1.0, value


RECORDED = tuple(field.name for field in dataclasses.fields(ReplayOptions))
GENERATED = ("seed",)
"""Keys of [operator] that apply to one kind of motion only."""


class Operator(Section):
    """[operator]: a generated or recorded motion, and optionally a Python file that decides what
    the hands make of it.
    """

    motion: Annotated[str, OneOf("motion", MOTIONS)] | None = None
    """a generated motion"""
    file: Path | None = None
    """a recorded motion (Parquet, CSV, text, MCAP, ROS bag), from this file's folder; a Python file
    (.py) is `hands`"""
    hands: Path | None = None
    """a Python file with an operator of your own, from this file's folder: what hands make of
    motion or file, which is their plan; its parameters are operator.own.hands..."""
    hands_sha256: str | None = Field(
        default=None, pattern=own_part.SHA256, description=f"of hands {own_part.CONTENT}"
    )
    scale: float = Field(default=0.1, ge=0.001, le=1.0)
    """teleoperation scale; varied as operator.scale. At the scale written here a recorded tip moves
    as recorded; a generated motion is planned for 0.1"""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """seed of the generated motion"""
    window_s: tuple[float, float] | None = None
    """[begin, end] within a recorded motion, s"""
    rate_hz: float | None = Field(default=None, gt=0.0, le=100_000.0)
    """rows a second of a recorded motion, evenly spaced: where it has no times, or those of
    arrival"""
    columns: Columns = Field(default=[])
    """names of a table's columns: all in order where it has no header line; the file's name by
    ravenjax's, { gold_x_mm = 'X' }; or jigsaws"""
    topics: dict[ArmName, str] = Field(default={})
    """topic or namespace of each arm in a bag, { gold = '/PSM2' }"""
    sensors: dict[Literal["column", "gold", "green"], str | int] = Field(default={})
    """the column that names each row's sensor, and each arm's sensor, { column = 'tool', gold = 'L'
    }"""
    frame: Frame | None = None
    """frame of recorded tips: frame0, arm_base (CRTK's) or console; without it as headers say, else
    frame0"""
    rotation: Turn | dict[ArmName, Turn] | None = None
    """turns recorded tips: rows of a matrix, or x, y, z, w; or a table with those of each arm"""
    offset_mm: Triple | dict[ArmName, Triple] | None = None
    """moves recorded tips after the turn; or a table as of rotation"""
    place: Place = "recorded"
    """home: recorded tips are moved and turned so that the replayed part begins as after homing"""
    cutoff_hz: float | None = Field(default=None, gt=0.0, lt=500.0)
    """low-pass of a recorded motion, Hz; without it none: tremor stays"""
    max_gap_s: float = Field(default=MAX_GAP_S, gt=0.0, le=MOST_GAP_S)
    """longest gap of a recorded motion that is bridged by interpolation, s"""
    spikes: Spikes = "refuse"
    """a recorded tip that jumps: refuse; remove: interpolate where it comes back; replay: as it
    is"""
    console: str = "auto"
    """whose packets a recorded stream holds: a profile's name, a .toml file, or auto, found from
    them"""
    at_end: AtEnd = "refuse"
    """a recorded motion that ends before the run: refuse; hold: hands rest; reverse: back and
    forth"""
    start: Start = Start()
    slow_down: float = Field(default=1.0, ge=0.1, le=100.0)
    """how much slower than recorded it is replayed"""

    @model_validator(mode="before")
    @classmethod
    def _one_source(cls, raw: Any) -> Any:
        if not isinstance(raw, dict):
            return raw
        if str(raw.get("file")).endswith(".py"):
            if raw.get("hands") is not None:
                raise ValueError("file and hands are both Python: give one of them")
            raw = {**raw, "hands": raw["file"]}
            del raw["file"]
        if raw.get("motion") is not None and raw.get("file") is not None:
            raise ValueError("give either motion (generated) or file (recorded), not both")
        return raw

    @field_validator("file", "hands")
    @classmethod
    def _path(cls, file: Path | None, info: ValidationInfo) -> Path | None:
        # imported late, because the import is slow
        from ravenjax.store.motion.recording import ANY_KIND

        python = info.field_name == "hands"
        if file and (not file.name or "\0" in str(file) or (python and file.suffix != ".py")):
            kind = ".py file; a recorded motion is `file`" if python else f"{ANY_KIND} file"
            raise ValueError(f"got {format_value(str(file))}, expected the path of a {kind}")
        return file

    @field_validator("rotation")
    @classmethod
    def _proper(cls, value: Any) -> Any:
        # Requires a proper rotation, as a matrix or a quaternion.
        import numpy as np

        for turn in value.values() if isinstance(value, dict) else [value] if value else []:
            rows = np.array(turn)
            apart = rows @ rows - 1.0 if rows.ndim == 1 else rows @ rows.T - np.eye(3)
            if np.abs(apart).max() > 0.01 or (rows.ndim == 2 and np.linalg.det(rows) < 0.0):
                raise ValueError(
                    f"got {format_value(turn)}, expected a rotation: three rows of length 1 at"
                    " right angles, without a mirror, or x, y, z, w of length 1"
                )
        return value

    @model_validator(mode="after")
    def _window(self) -> Operator:
        # Keys of recorded motions are refused for generated ones, and the reverse.
        if self.file is not None and self.start.si():
            raise ValueError(
                "start belongs to a generated motion; a recorded one begins where it was recorded:"
                " remove it"
            )
        if self.hands is None and self.hands_sha256 is not None:
            raise ValueError(
                "hands_sha256 belongs to hands, which the section does not have: remove it"
            )
        if self.window_s is not None and not 0.0 <= self.window_s[0] < self.window_s[1]:
            raise ValueError(
                "window_s = [begin, end] in s: expected 0 <= begin < end, got"
                f" {list(self.window_s)}"
            )
        for name in RECORDED if self.file is None else GENERATED:
            if getattr(self, name) != type(self).model_fields[name].default:
                kind, other = ("recorded", "generated")[:: 1 if self.file is None else -1]
                raise ValueError(
                    f"{name} belongs to a {kind} motion, a {other} one has none: remove it"
                )
        return self

    @property
    def options(self) -> ReplayOptions:
        """Options for the replay of a recorded motion."""
        return ReplayOptions(**{name: getattr(self, name) for name in RECORDED})

    @property
    def own(self) -> OwnSource | None:
        """The code of `hands`; None if the plan is followed.

        Raises UserError if the file is unusable or has changed.
        """
        if self.hands is None:
            return None
        return own_part.part_source("hands", self.hands, self.hands_sha256, "operator")

    def located(self, folder: Path) -> Operator:
        """Return the section with its files taken from `folder` and the code of `hands` read."""
        there = own_part.locate_part(self, folder, "operator", "hands", "hands", "hands_sha256")
        file = None if self.file is None else (folder / self.file).absolute()
        return there.model_copy(update={"file": file})

    @property
    def label(self) -> str:
        """Name of the motion in tables."""
        return self.file.stem if self.file is not None else self.motion or "suture"


class Limits(Section):
    """[limits]: soft joint limits of the control software; omitted limits are the original's."""

    shoulder_deg: tuple[_Shoulder, _Shoulder] | None = None
    """[min, max] of the shoulder"""
    elbow_deg: tuple[_Elbow, _Elbow] | None = None
    """[min, max] of the elbow"""
    insertion_m: tuple[_Insertion, _Insertion] | None = None
    """[min, max] of the insertion"""
    tool_roll_deg: tuple[_Roll, _Roll] | None = None
    """[min, max] of the instrument's roll"""
    wrist_deg: tuple[_Wrist, _Wrist] | None = None
    """[min, max] of the instrument's wrist"""

    @field_validator("*")
    @classmethod
    def _increasing(cls, pair: tuple[float, float] | None) -> tuple[float, float] | None:
        if pair is not None and not pair[0] < pair[1]:
            raise ValueError(f"got {list(pair)}, expected [min, max] with min < max")
        return pair

    def si(self) -> dict[str, tuple[float, float]]:
        """Return the limits that were given, by joint, in rad and m."""
        return {joint: (low * factor, high * factor) for joint, factor, (low, high) in _given(self)}


class Reaction(Section):
    """[reaction]: how the operator reacts to the cue of the first haptic set. Its parameters are
    reaction.delay_ms and so on.
    """

    action: Literal["none", "release", "slow", "correct"] = "release"
    """lift the pedal, slow down, or correct by eye; varied as reaction.action, 0 to 3"""
    delay_ms: float = Field(default=250.0, ge=0.0, le=60_000.0)
    """from the first felt pull to the action, ms"""
    felt_force: float = Field(default=0.0, ge=0.0)
    """a weaker pull is not noticed, device units"""
    slow_to: float = Field(default=0.25, ge=0.0, le=1.0)
    """speed of slowed hands, of what it was"""
    correct_per_s: float = Field(default=5.0, ge=0.0, le=1000.0)
    """share of the distance corrected, 1/s"""
    correct_mm_s: float = Field(default=50.0, ge=0.0, le=10_000.0)
    """fastest correction of the tip, mm/s"""


class Hand(Section):
    """[hand]: a hand that the force of the first haptic set moves. Its parameters are hand.grip and
    so on.

    Robot and nominal model follow the moved hand alike.
    """

    grip: float = Field(default=0.5, ge=0.0, le=1.0)
    """how firmly it holds the console: 0 relaxed, 1 firm"""
    newtons_per_unit: float = Field(default=3.3, ge=-1e3, le=1e3)
    """force per device unit of the cue, N; no source says it, assumed"""


class OwnStages(Section):
    """[controller]: Python files that replace stages of the control software. Their parameters are
    control.own.STAGE.NAME.
    """

    motor_control: Path | None = None
    """a file whose step gives (state, tau_d): desired torques from desired motor positions"""
    dac: Path | None = None
    """a file whose step gives (state, current_cmd): DAC counts from desired torques"""
    sha256: dict[str, str] = Field(
        default_factory=dict, description=f"stage = of that file {own_part.CONTENT}"
    )

    @model_validator(mode="after")
    def _some(self) -> OwnStages:
        # Requires at least one replaced stage, and no hash of a stage that is not replaced.
        if not list(self.files()):
            raise ValueError(
                'replaces nothing: write motor_control or dac = "file.py", or remove the section'
            )
        if strays := [stage for stage in self.sha256 if stage not in dict(self.files())]:
            raise ValueError(f"sha256 has {strays[0]!r}, which is not replaced: remove it")
        return self

    def files(self) -> Iterator[tuple[str, Path]]:
        """Yield (stage, file) for the stages that are replaced, in the order of the tick."""
        files = {"motor_control": self.motor_control, "dac": self.dac}
        yield from ((stage, file) for stage, file in files.items() if file is not None)

    def parts(self) -> Iterator[tuple[str, OwnSource]]:
        """Yield (stage, code). Raises UserError for a file that is unusable or has changed."""
        for stage, file in self.files():
            yield stage, own_part.part_source(stage, file, self.sha256.get(stage), "stage")

    def located(self, folder: Path) -> OwnStages:
        """Return the section with its files taken from `folder` and their content read."""
        there = self.model_copy(
            update={stage: folder.absolute() / file for stage, file in self.files()}
        )
        hashes = {stage: part.hash_source(source) for stage, source in there.parts()}
        return there.model_copy(update={"sha256": hashes})
