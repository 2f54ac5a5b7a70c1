"""Sections of a Raven-II campaign file: campaign, operator, limits, reaction, hand, controller."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from ravenjax.campaign.file import own_part
from ravenjax.campaign.file.section import OneOf, Section
from ravenjax.campaign.file.sections import CampaignSection
from ravenjax.errors import format_value, is_table, require_utf8, suggest_name
from ravenjax.parts import part
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
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


def _check_packets(raw: str | float | Sequence[Any]) -> Any:
    # Checks the key `packets`: a name of a distribution, or shares of packets that last 1, 2, 3, ..
    # cycles. Returns shares as a tuple. Raises ValueError. Pydantic then refuses all other types.
    names = ", ".join(map(repr, packets.CHOICES))
    if isinstance(raw, str) and raw not in packets.CHOICES:
        raise ValueError(
            f"got {raw!r}, expected one of {names}, or a list with the shares of packets that last"
            f" 1, 2, 3, .. cycles{suggest_name(raw, packets.CHOICES)}"
        )
    if not isinstance(raw, list | tuple):
        return raw
    if not 1 <= len(raw) <= packets.MOST_CYCLES:
        raise ValueError(
            f"got {len(raw)} shares, expected 1 to {packets.MOST_CYCLES}, the shares of packets"
            " that last 1, 2, 3, .. cycles"
        )
    shares = [x for x in raw if isinstance(x, int | float) and not isinstance(x, bool) and x >= 0]
    if len(shares) < len(raw) or abs(math.fsum(shares) - 1.0) > 1e-6:
        total = f", whose sum is {math.fsum(shares):g}" if len(shares) == len(raw) else ""
        raise ValueError(
            f"got {format_value(list(raw))}{total}, expected shares of packets that last 1, 2, 3,"
            " .. cycles: none negative, with the sum 1, such as [0.1, 0.8, 0.1]"
        )
    return tuple(float(share) for share in shares)


Packets = Annotated[
    Literal["every_cycle", "measured", "bursts"] | tuple[float, ...],
    BeforeValidator(_check_packets),
]
"""How long packets last: a name of `vocabulary.packets`, or a list of shares."""


class RavenCampaign(CampaignSection):
    """[campaign]: settings of every run."""

    # Sections are immutable, so the type may be narrower than the one that other robots have.
    arms: tuple[ArmName, ...] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default=("gold",), min_length=1, max_length=2
    )
    """arms, gold first"""
    noise: bool = False
    """draw noise of the sizes plant.encoder_noise and plant.torque_noise for each run"""
    software: Literal["raven2", "fork2015"] = "raven2"
    """control software: present raven2, or the 2015 fork"""
    build: Literal["robot", "dyn_sim", "dyn_sim_tools"] = "robot"
    """build of the control software. robot: for the real robot; dyn_sim, only of fork2015: motors
    1-3 are read from the model without encoders and filter, tool joints are ideal, and packets end
    with a software E-stop; dyn_sim_tools: as dyn_sim, but tool joints are measured as on the robot
    (no such build was published)"""
    dac_words: Literal["wrap", "saturate", "unwrapped"] | None = None
    """how a DAC command that a fault wrote after the checks is stored in the 16 bits of a USB word.
    Without this key, the command wraps, and a fault's value beyond 16 bits is refused"""
    tools: tuple[Annotated[str, OneOf("tool", TOOLS)], ...] | None = None
    """one tool per arm; default: the tools of the control software"""
    console: Literal["increments", "absolute"] = "increments"
    """what a packet contains: increments of the hand's motion, or absolute positions"""
    packets: Packets = "every_cycle"
    """number of control cycles from one packet of the console to the next. every_cycle: one;
    measured: drawn as on a recorded robot, two for 93 % of the packets; bursts: drawn as a recorded
    console sends, one to three, and 6 to 11 for 18 % of the packets; or a list of the shares of
    packets that last 1, 2, 3, .. cycles. A campaign varies the key as network.packets, 0 to 3"""
    policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] = "soft_regulation"
    """what raven2's overdrive check does with a command above the limit: nothing, clip the command,
    or stop the robot after ten such commands. fork2015 has no policy"""
    level: Literal["beginner", "moderate", "advanced", "fork2015"] | None = None
    """limits of the overdrive check, in DAC counts for each joint; default: moderate for raven2,
    fork2015 for fork2015"""
    parameter_set: parameter_sets.Name = parameter_sets.DEFAULT
    """mechanical parameters of the virtual robot: power_consistent, or a published set for the
    first three joints, with the equations of motor and cable of its authors"""
    kinematic_errors: Literal["none", "measured"] = "none"
    """errors of joint offsets, drum ratios and links, which make the reported tip of a fault-free
    robot wrong. none; measured: drawn for each run and arm, as large as cameras saw on a real arm,
    which is an upper bound. For half of these errors write plant.kinematic_errors.scale = 0.5"""
    cables: Literal["unbreakable", "break"] = "unbreakable"
    """what happens to a cable whose tension exceeds plant.cable_strength. unbreakable: nothing;
    break: it breaks and transmits no force for the rest of the run. With parameter_set
    power_consistent, overload is an outcome in both cases. Published sets have no realistic
    tensions, so break is refused"""
    contact: bool = False
    """whether contact forces act between jaw tips and the scene's tissue and vessel, and between
    the instruments. The forces act on the robot and are outcomes. Their parameters begin with
    contact. Without contact, instruments pass through everything"""
    substeps: int = Field(default=1, ge=1, le=100)
    """plant steps per 1 ms tick"""

    @model_validator(mode="after")
    def _check_combinations(self) -> RavenCampaign:
        # Refuses combinations of keys that contradict each other.
        if self.tools is not None and len(self.tools) != len(self.arms):
            raise ValueError(
                f"tools: got {len(self.tools)}, expected one per arm ({len(self.arms)})"
            )
        if self.build != "robot" and self.software != "fork2015":
            raise ValueError(
                f"build: got {self.build!r}, which is a build of the 2015 fork only: write"
                " software = 'fork2015', or build = 'robot'"
            )
        if self.cables == "break" and not self.overload:
            raise ValueError(
                f"cables: got 'break', but with parameter_set {self.parameter_set!r} motors pull"
                " the cables twelve times as hard as real motors can: write parameter_set ="
                " 'power_consistent'"
            )
        if self.software == "fork2015" and self.policy != "soft_regulation":
            raise ValueError(
                f"policy: got {self.policy!r}, but software 'fork2015' has no policy: remove policy"
            )
        return self

    @property
    def overload(self) -> bool:
        """Whether overload of cables is an outcome.

        Only forces that agree with statics can be compared with a cable's strength. In the
        published sets, a motor pulls its cable twelve times as hard as a real motor.
        """
        return self.parameter_set == parameter_sets.DEFAULT

    @property
    def packet_choice(self) -> int:
        """Number of the distribution of packet lengths: an index of `packets.CHOICES`, or `OWN`."""
        if isinstance(self.packets, str):
            return packets.CHOICES.index(self.packets)
        every_cycle = self.packets == packets.SHARES[packets.EVERY_CYCLE]
        return packets.EVERY_CYCLE if every_cycle else packets.OWN

    @property
    def packet_shares(self) -> tuple[float, ...]:
        """Shares of packets that last 1, 2, 3, .. cycles, by name or as listed."""
        if isinstance(self.packets, str):
            return packets.SHARES[self.packet_choice]
        return self.packets


# Hard stops of the joints, or the original soft limits where no hard stop is published; raven2
# `defines.h`, `tools.cpp` (r_grasper).
_Shoulder = Annotated[float, Field(ge=0.0, le=90.0)]
_Elbow = Annotated[float, Field(ge=45.0, le=137.5)]
_Insertion = Annotated[float, Field(ge=0.23, le=0.562)]
_Roll = Annotated[float, Field(ge=-330.0, le=330.0)]
_Wrist = Annotated[float, Field(ge=-100.0, le=100.0)]


class Start(Section):
    """[operator.start]: joints at the start of a generated motion; omitted joints start at home."""

    shoulder_deg: _Shoulder | None = None
    """shoulder, between its hard stops"""
    elbow_deg: _Elbow | None = None
    """elbow, between its hard stops"""
    insertion_m: _Insertion | None = None
    """insertion of the instrument; a smaller value is farther out of the patient"""
    tool_roll_deg: _Roll | None = None
    """roll of the instrument"""
    wrist_deg: _Wrist | None = None
    """wrist of the instrument"""

    def jpos(self) -> dict[str, float]:
        """Return the position of each joint, rad and m."""
        home: dict[str, float] = dict(zip(JOINTS, HOME_JPOS, strict=True))
        return home | {joint: value * factor for joint, factor, value in _keys(self)}


def _keys(section: Section) -> Iterator[tuple[str, float, Any]]:
    """Yield (joint, factor to rad or m, value) for each key of the section that the file has."""
    for name in type(section).model_fields:
        if (value := getattr(section, name)) is not None:
            joint, _, unit = name.rpartition("_")  # such as shoulder, deg
            yield joint, math.pi / 180.0 if unit == "deg" else 1.0, value


RECORDED_KEYS = tuple(field.name for field in dataclasses.fields(ReplayOptions))
GENERATED_KEYS = ("seed",)
"""Keys of [operator] for recorded motions only, and keys for generated motions only."""


class Operator(Section):
    """[operator]: a generated or recorded motion, and optionally a Python file with an operator of
    your own, whose hands may deviate from this motion.
    """

    motion: Annotated[str, OneOf("motion", MOTIONS)] | None = None
    """a generated motion"""
    file: Path | None = None
    """a recorded motion (Parquet, CSV, text, MCAP, ROS bag), relative to the campaign's folder; a
    Python file (.py) is treated as `hands`"""
    hands: Path | None = None
    """a Python file with an operator of your own, relative to the campaign's folder. Its hands may
    deviate from the planned motion, which is `motion` or `file`. Its parameters begin with
    operator.own.hands"""
    hands_sha256: str | None = Field(
        default=None, pattern=own_part.SHA256, description=f"of hands {own_part.CONTENT}"
    )
    scale: float = Field(default=0.1, ge=0.001, le=1.0)
    """teleoperation scale; a campaign may vary operator.scale. With the scale of this key, the tip
    moves as in the recording. Generated motions are planned for 0.1"""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """seed of the generated motion"""
    window_s: tuple[float, float] | None = None
    """[begin, end] of the replayed part of a recorded motion, s"""
    rate_hz: float | None = Field(default=None, gt=0.0, le=100_000.0)
    """rows per second of a recorded motion, evenly spaced: for a recording without times, or with
    times of arrival only"""
    columns: Columns = Field(default=[])
    """names of a table's columns: a list of all names in order, if the table has no header line; a
    table from ravenjax's names to those of the file, { gold_x_mm = 'X' }; or jigsaws"""
    topics: dict[ArmName, str] = Field(default={})
    """topic or namespace of each arm in a bag, { gold = '/PSM2' }"""
    sensors: dict[Literal["column", "gold", "green"], str | int] = Field(default={})
    """the column that names the sensor of each row, and the sensor of each arm, { column = 'tool',
    gold = 'L' }"""
    frame: Frame | None = None
    """frame of recorded tips: frame0, arm_base (CRTK's) or console; default: the frame that the
    headers of the recording name, otherwise frame0"""
    rotation: Turn | dict[ArmName, Turn] | None = None
    """rotation of recorded tips: rows of a matrix, or a quaternion x, y, z, w; or a table with the
    rotation of each arm"""
    offset_mm: Triple | dict[ArmName, Triple] | None = None
    """displacement of recorded tips after the rotation, mm; or a table with that of each arm"""
    place: Place = "recorded"
    """home: recorded tips are moved and rotated so that the replayed part begins at home"""
    cutoff_hz: float | None = Field(default=None, gt=0.0, lt=500.0)
    """cutoff of a low-pass filter for a recorded motion, Hz; default: no filter, so tremor stays"""
    max_gap_s: float = Field(default=MAX_GAP_S, gt=0.0, le=MOST_GAP_S)
    """longest gap of a recorded motion that is bridged by interpolation, s"""
    spikes: Spikes = "refuse"
    """what to do if a recorded tip jumps: refuse the recording; remove: interpolate if the tip
    jumps back; replay: replay the jump"""
    console: str = "auto"
    """console profile of a recorded stream of packets: a profile's name, a .toml file, or auto,
    which finds the profile from the packets"""
    at_end: AtEnd = "refuse"
    """what to do if a recorded motion ends before the run: refuse the recording; hold: the hands
    rest; reverse: replay the motion back and forth"""
    start: Start = Start()
    slow_down: float = Field(default=1.0, ge=0.1, le=100.0)
    """factor by which a recorded motion is replayed more slowly"""

    @model_validator(mode="before")
    @classmethod
    def _choose_source(cls, raw: Any) -> Any:
        # Moves a Python file from key `file` to `hands`, and refuses two sources of the motion.
        if not is_table(raw):
            return raw
        if str(raw.get("file")).endswith(".py"):
            if raw.get("hands") is not None:
                raise ValueError("file and hands are both Python files: write only one of them")
            raw = {**raw, "hands": raw["file"]}
            del raw["file"]
        if raw.get("motion") is not None and raw.get("file") is not None:
            raise ValueError("write either motion (generated) or file (recorded), not both")
        return raw

    @field_validator("file", "hands")
    @classmethod
    def _check_path(cls, file: Path | None, info: ValidationInfo) -> Path | None:
        # Refuses a path that cannot be a file, and hands that are no Python file.
        from ravenjax.store.motion.recording import ANY_KIND  # late, because the import is slow

        is_hands = info.field_name == "hands"
        if file and (not file.name or "\0" in str(file) or (is_hands and file.suffix != ".py")):
            kind = ".py file (for a recorded motion write file)" if is_hands else f"{ANY_KIND} file"
            raise ValueError(f"got {format_value(str(file))}, expected the path of a {kind}")
        return file

    @field_validator("rotation")
    @classmethod
    def _check_rotation(cls, value: Turn | dict[ArmName, Turn] | None) -> Any:
        # Refuses a quaternion or matrix [3, 3] that is no rotation. A dict has one for each arm.
        import numpy as np

        rotations = list(value.values()) if isinstance(value, dict) else [value]
        for rotation in filter(None, rotations):
            rows = np.array(rotation)
            error = rows @ rows - 1.0 if rows.ndim == 1 else rows @ rows.T - np.eye(3)
            if np.abs(error).max() > 0.01 or (rows.ndim == 2 and np.linalg.det(rows) < 0.0):
                raise ValueError(
                    f"got {format_value(rotation)}, expected a rotation: three rows of length 1 at"
                    " right angles without a reflection, or a quaternion x, y, z, w of length 1"
                )
        return value

    @model_validator(mode="after")
    def _check_keys(self) -> Operator:
        # Refuses keys for another kind of motion, a hash without a file, and a wrong window.
        if self.file is not None and self.start != Start():
            raise ValueError(
                "start is for generated motions only; a recorded motion begins where it was"
                " recorded: remove start"
            )
        if self.hands is None and self.hands_sha256 is not None:
            raise ValueError(
                "hands_sha256 is the hash of hands, but hands is missing: remove hands_sha256"
            )
        if self.window_s is not None and not 0.0 <= self.window_s[0] < self.window_s[1]:
            raise ValueError(
                "window_s = [begin, end] in s: expected 0 <= begin < end, got"
                f" {list(self.window_s)}"
            )
        refused, kind, actual = RECORDED_KEYS, "recorded", "generated"
        if self.file is not None:
            refused, kind, actual = GENERATED_KEYS, "generated", "recorded"
        for name in refused:
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(
                    f"{name} is for {kind} motions only, but the motion is {actual}: remove {name}"
                )
        return self

    @property
    def options(self) -> ReplayOptions:
        """Options for the replay of a recorded motion."""
        return ReplayOptions(**{name: getattr(self, name) for name in RECORDED_KEYS})

    @property
    def own(self) -> OwnSource | None:
        """The code of the file `hands`; None if there is no file, and the hands follow the plan.

        Raises UserError if the file is unusable or has changed.
        """
        if self.hands is None:
            return None
        return own_part.own_source("hands", self.hands, self.hands_sha256, "operator")

    def locate_files(self, folder: Path) -> Operator:
        """Return the section with absolute paths of its files in `folder`. Raises UserError."""
        section = own_part.locate_part(
            self, folder, what="operator", name="hands", key="hands", sha256="hands_sha256"
        )
        file = None if self.file is None else (folder / self.file).absolute()
        require_utf8(str(file))
        return section.model_copy(update={"file": file})

    @property
    def label(self) -> str:
        """Name of the motion in tables."""
        return self.file.stem if self.file is not None else self.motion or "suture"


class Limits(Section):
    """[limits]: soft joint limits. Omitted keys keep the limits of the chosen control software."""

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
    def _check_order(cls, pair: tuple[float, float] | None) -> tuple[float, float] | None:
        # Refuses limits whose minimum is not below the maximum.
        if pair is not None and not pair[0] < pair[1]:
            raise ValueError(f"got {list(pair)}, expected [min, max] with min < max")
        return pair

    def si(self) -> dict[str, tuple[float, float]]:
        """Return the limits in the file as joint -> (min, max), rad and m."""
        return {joint: (low * factor, high * factor) for joint, factor, (low, high) in _keys(self)}


class Reaction(Section):
    """[reaction]: how the operator reacts to the cue of the first haptic set. The paths of its
    parameters begin with reaction, such as reaction.delay_ms.
    """

    action: Literal["none", "release", "slow", "correct"] = "release"
    """what the operator does: nothing, lift the pedal, slow down, or correct by eye; a campaign may
    vary reaction.action, 0 to 3"""
    delay_ms: float = Field(default=250.0, ge=0.0, le=60_000.0)
    """time from the first pull that the operator feels to the action, ms"""
    felt_force: float = Field(default=0.0, ge=0.0)
    """smallest force of the cue that the operator feels, device units"""
    slow_to: float = Field(default=0.25, ge=0.0, le=1.0)
    """speed of slowed hands, as a share of the planned speed"""
    correct_per_s: float = Field(default=5.0, ge=0.0, le=1000.0)
    """share of the distance that a correction removes per second, 1/s"""
    correct_mm_s: float = Field(default=50.0, ge=0.0, le=10_000.0)
    """largest speed of the tip during a correction, mm/s"""


class Hand(Section):
    """[hand]: the operator's hand, which the force of the first haptic set moves. Paths of its
    parameters begin with hand, such as hand.grip.

    The robot and the nominal model both follow the moved hand.
    """

    grip: float = Field(default=0.5, ge=0.0, le=1.0)
    """how firmly the hand grips the console: 0 relaxed, 1 firm"""
    newtons_per_unit: float = Field(default=3.3, ge=-1e3, le=1e3)
    """force per device unit of the cue, N; assumed, because no source states this force"""


class OwnStages(Section):
    """[controller]: Python files that replace stages. Parameters: control.own.STAGE.NAME."""

    motor_control: Path | None = None
    """a file whose step returns (state, tau_d): desired torques from desired motor positions"""
    dac: Path | None = None
    """a file whose step returns (state, current_cmd): DAC counts from desired torques"""
    sha256: dict[str, str] = Field(
        default_factory=dict, description=f"stage = of that file {own_part.CONTENT}"
    )

    @model_validator(mode="after")
    def _check_stages(self) -> OwnStages:
        # Requires a file for at least one stage. Refuses the hash of a stage without a file.
        if not list(self.files()):
            raise ValueError(
                '[controller] replaces no stage: write motor_control or dac = "file.py", or remove'
                " [controller]"
            )
        if strays := [stage for stage in self.sha256 if stage not in dict(self.files())]:
            raise ValueError(
                f"sha256 has the key {strays[0]!r}, for which [controller] has no file: remove it"
            )
        return self

    def files(self) -> Iterator[tuple[str, Path]]:
        """Yield (stage, file) for the stages that are replaced, in the order of the tick."""
        files = {"motor_control": self.motor_control, "dac": self.dac}
        yield from ((stage, file) for stage, file in files.items() if file is not None)

    def parts(self) -> Iterator[tuple[str, OwnSource]]:
        """Yield (stage, code of its file). Raises UserError if a file is unusable or changed."""
        for stage, file in self.files():
            yield stage, own_part.own_source(stage, file, self.sha256.get(stage), "stage")

    def locate_files(self, folder: Path) -> OwnStages:
        """Return the section with absolute paths of its files in `folder`, and their hashes."""
        paths = {stage: folder.absolute() / file for stage, file in self.files()}
        section = self.model_copy(update=paths)
        hashes = {stage: part.hash_source(source) for stage, source in section.parts()}
        return section.model_copy(update={"sha256": hashes})
