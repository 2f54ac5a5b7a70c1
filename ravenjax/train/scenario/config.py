"""Defines the scenario file: its keys and tables, with units and ranges.

`loading` reads the file, and `campaign` turns it into runs of a campaign.

    name = "dac_burst"
    [task]
    kind = "reach"
    [[hazard]]
    hazards = ["B27"]
    when = [20, 30]

The other tables are [speeds], [cue], [contact], [harm], [parameters] and [robot].
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from ravenjax.campaign.file.axis import Number
from ravenjax.campaign.file.group import Fault, Parameters, Section
from ravenjax.campaign.file.sections import OneOrMore
from ravenjax.errors import format_value
from ravenjax.outcomes.verdict import PUBLISHED_CUE_MM
from ravenjax.robots.raven2.campaign.sections import Start
from ravenjax.train.robot import ARMS, ArmName, Arms, parameter_sets

Response = Literal["release", "slow", "restart", "convert", "stop", "continue"]
"""Responses of an operator; convert: report that the procedure is converted to open surgery."""

INSTRUCTOR = "instructor"
"""`when` of a hazard that becomes active on the instructor's command."""
MAX_FAULTS = 8
"""The largest number of faults of a hazard."""
_Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
_Duration = Annotated[float, Field(gt=0.0, le=3600.0)]
_Amount = Annotated[float, Field(ge=0.0, le=1e6)]
_Seed = Annotated[int, Field(ge=0, lt=2**31)]
_Count = Annotated[int, Field(ge=1, le=1000)]
_Repeats = Annotated[int, Field(ge=1, le=100)]
_Limit = Annotated[float, Field(gt=0.0, le=1000.0)]
_Extent = Annotated[float, Field(gt=0.0, le=20.0)]


class Speeds(Section):
    """[speeds]: speeds of the tips when keys or sticks are fully deflected."""

    move_mm_s: float = Field(30.0, gt=0.0, le=500.0)
    """speed of the tip, mm/s; in surgery about 5 to 60"""
    turn_rad_s: float = Field(1.0, gt=0.0, le=20.0)
    """turning speed of the tip, rad/s"""
    grasp_mrad_s: float = Field(1500.0, gt=0.0, le=20_000.0)
    """speed of the jaws, mrad/s"""


class Cue(Section):
    """[cue]: the haptic cue. Its keys define one haptic set, as in a campaign's [haptics]."""

    on: bool = True
    """whether the operator feels the force"""
    blinded: bool = False
    """hide hazards, cue and score from the operator"""
    threshold_mm: _Amount = PUBLISHED_CUE_MM
    """distance from the model above which the cue pulls, mm"""
    kp_per_mm: _Amount = 0.0045
    """spring constant, device units per mm"""
    kd_per_mm_s: _Amount = 0.00009
    """damping constant, device units per mm/s"""
    cap: _Amount = 0.05
    """largest force, device units"""


class ContactSection(Section):
    """[contact]: contact of the instruments with tissue, vessel and each other."""

    on: bool = False
    """whether contact acts; its numbers are [parameters] contact.*"""
    units_per_n: float = Field(0.03, ge=0.0, le=1e3)
    """force at the operator's hand per N on the instrument, device units; the sum with the cue is
    at most the cue's cap; an assumption
    """


class Harm(Section):
    """[harm]: the limits beyond which a hazard has done harm."""

    # Above the cue's threshold, so that an operator who waits for the cue has time to act.
    excursion_mm: _Limit = 10.0
    """unintended motion of the true tip above which there is harm, mm; also the limit of motion
    hazards, like [outcomes] limit_mm of a campaign. Set it above the cue's threshold, or an
    operator who waits for the cue acts too late
    """
    depth_mm: _Limit = 5.0
    """depth added in the tissue above which there is harm, mm"""


class _Task(Section):
    tolerance_mm: float = Field(2.0, gt=0.0, le=100.0)
    """distance at which a goal counts as reached, mm"""
    seed: _Seed = 0
    """seed of the task, in addition to the session's seed"""
    arms: Arms = Field((), max_length=2)
    """arms that do the task, in turn; default: all arms"""


class Reach(_Task):
    """[task] kind = "reach": one target after another, each to be held for a moment."""

    kind: Literal["reach"]
    targets: _Count = 12
    """number of targets"""
    extent_mm: _Extent = 12.0
    """largest distance of targets from the middle, mm"""
    height_mm: tuple[float, float] = (3.0, 18.0)
    """[least, greatest] height of targets above the tissue, mm"""
    dwell_ms: int = Field(300, ge=0, le=60_000)
    """time to hold the tip at a target, ms"""

    @field_validator("height_mm")
    @classmethod
    def _check_order(cls, heights: tuple[float, float]) -> tuple[float, float]:
        if not -10.0 <= heights[0] <= heights[1] <= 30.0:
            raise ValueError(f"got {list(heights)}, expected [least, greatest] within -10..30")
        return heights


class Level(Reach):
    """[[task.level]]: rounds of a task "reach". The operator should finish each in a given time."""

    kind: Literal["reach"] = "reach"
    """task of a round"""
    title: str = Field("", max_length=100)
    """skill that the operator learns, as the page shows it"""
    targets: int = Field(6, ge=2, le=100)
    """number of targets of a round, the same in each round"""
    within_s: _Duration
    """time for a proficient round, from its first target to its last, s"""


class Levels(Section):
    """[task] kind = "levels": the next level begins once the operator is proficient in the last."""

    kind: Literal["levels"]
    in_a_row: _Repeats = 2
    """number of rounds in a row that must be within the time"""
    level: tuple[Level, ...] = Field(min_length=1, max_length=20)
    """levels in their order"""

    @property
    def arms(self) -> Arms:
        return tuple(dict.fromkeys(arm for level in self.level for arm in level.arms))


class PegTransfer(_Task):
    """[task] kind = "peg_transfer": carry the object from one peg to another."""

    kind: Literal["peg_transfer"]
    transfers: _Count = 6
    """number of transfers"""
    pegs: Literal[2, 4, 6, 8] = 6
    """number of pegs, in two rows"""
    spacing_mm: float = Field(10.0, ge=4.0, le=12.0)
    """distance between pegs of a row, mm"""
    height_mm: float = Field(6.0, ge=1.0, le=20.0)
    """height of the pegs above the tissue, mm"""


class Path(_Task):
    """[task] kind = "path": go along a closed line."""

    kind: Literal["path"]
    shape: Literal["circle", "eight", "line"] = "circle"
    """shape of the path; a line goes there and back"""
    radius_mm: _Extent = 10.0
    """half of the path's width, mm"""
    height_mm: float = Field(6.0, ge=-10.0, le=30.0)
    """height above the tissue, mm"""
    laps: _Count = 3
    """number of laps"""


class Free(_Task):
    """[task] kind = "free": no task."""

    kind: Literal["free"]


Task = Annotated[Reach | PegTransfer | Path | Levels | Free, Field(discriminator="kind")]
TASKS = {"reach": Reach, "peg_transfer": PegTransfer, "path": Path, "levels": Levels, "free": Free}


def _parse_when(raw) -> Any:
    # Returns "instructor", or the earliest and latest time, s. One number stands for both.
    if raw == INSTRUCTOR:
        return raw
    numbers = raw if isinstance(raw, list | tuple) else (raw, raw)
    # `type` excludes True and False, which are instances of int.
    are_numbers = all(type(x) in (int, float) for x in numbers)
    if len(numbers) != 2 or not are_numbers or not 0.0 <= numbers[0] <= numbers[1] <= 3600.0:
        raise ValueError(
            f"got {format_value(raw)}, expected a time in s, [earliest, latest] or {INSTRUCTOR!r}"
        )
    return float(numbers[0]), float(numbers[1])


def _as_tuple(raw) -> Any:
    return (raw,) if isinstance(raw, str) else raw


When = Annotated[
    tuple[float, float] | Literal["instructor"],
    BeforeValidator(
        _parse_when,
        json_schema_input_type=_Seconds | tuple[_Seconds, _Seconds] | Literal["instructor"],
    ),
]


class Entry(Section):
    """[[hazard]]: hazards of the library, or your own fault, and the operator's right response."""

    name: str = Field("", pattern=r"^[A-Za-z0-9_.-]*$", max_length=60)
    """name of the entry in tables"""
    title: str = ""
    """title for people; default: the library's"""
    hazards: Annotated[
        tuple[str, ...], BeforeValidator(_as_tuple, json_schema_input_type=OneOrMore[str])
    ] = ()
    """ids and layers of the hazard library, or "all"
    """
    fault: tuple[Fault, ...] = Field((), max_length=MAX_FAULTS)
    """faults in place of `hazards`, as in [[group.fault]]"""
    arm: ArmName | None = None
    """arm of the hazard; default: drawn from the session's arms"""
    value: Number | None = None
    """value in place of the library's"""
    when: When = INSTRUCTOR
    """time since the first pedal-down, s: one, [earliest, latest] to draw from, or "instructor"
    """
    times: _Repeats = 1
    """number of hazards that are drawn of each case"""
    right_response: tuple[Response, ...] | None = Field(None, min_length=1)
    """responses that are right; default: those of the library"""
    within_s: float = Field(2.0, gt=0.0, le=600.0)
    """time for the response, s"""
    lasts_s: _Duration | None = None
    """longest time at work, s; default: its own, or 5 if it has no end"""

    @model_validator(mode="before")
    @classmethod
    def _start_now(cls, raw: Any) -> Any:
        """Give each fault start_ms 0: it starts with its hazard, so the file need not set it."""
        if isinstance(raw, dict) and isinstance(raw.get("fault"), list):
            # Anything else than a table is refused later.
            faults = [{"start_ms": 0} | f if isinstance(f, dict) else f for f in raw["fault"]]
            return raw | {"fault": faults}
        return raw

    @model_validator(mode="after")
    def _check_combinations(self) -> "Entry":
        # Refuses keys that exclude each other, and a fault window of unknown time.
        if bool(self.hazards) == bool(self.fault):
            raise ValueError(
                'expected either hazards = ["B27"] (ids or layers), or a table [[hazard.fault]]'
            )
        if any(fault.start_ms.phases for fault in self.fault):
            raise ValueError(
                "start_ms: got a phase of the operation, expected ms: the motion of a person is not"
                " known beforehand"
            )
        if self.fault and (self.arm is not None or self.value is not None):
            raise ValueError(
                "got [[hazard.fault]] and arm or value: write arm and value in [[hazard.fault]]"
            )
        right = self.right_response or ()
        if "continue" in right and len(right) > 1:
            raise ValueError('right_response: "continue" excludes other responses')
        return self


class RobotSection(Section):
    """[robot]: settings of the robot; keys as in [campaign]."""

    tools: tuple[str, ...] | None = None
    """tool of each arm; default: the software's own"""
    policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] = "soft_regulation"
    """overdrive policy of raven2"""
    level: Literal["beginner", "moderate", "advanced", "fork2015"] | None = None
    """DAC limits of the overdrive check"""
    parameter_set: parameter_sets.Name = parameter_sets.DEFAULT
    """mechanics of the robot: power_consistent, or a set that the authors published for joints 1 to
    3
    """
    noise: bool = False
    """whether encoders and torques have noise"""
    start: Start = Start()
    """joint positions at which the session begins"""


class Scenario(Section):
    """A whole scenario file."""

    name: str = Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=100)
    """short name"""
    title: str = Field("", max_length=200)
    """title on the page"""
    description: str = ""
    """what the operator does and learns"""
    arms: Arms = Field(("gold",), min_length=1, max_length=2)
    """arms, gold first"""
    software: Literal["raven2", "fork2015"] = "raven2"
    """raven2, or its fork of 2015"""
    duration_s: _Duration = 120.0
    """length of the session from the first pedal-down, s"""
    seed: _Seed = 0
    """seed of a session that is not given one"""
    scale: float = Field(0.1, gt=0.0, le=1.0)
    """teleoperation scale: tip motion per hand motion"""
    speeds: Speeds = Speeds()
    cue: Cue = Cue()
    contact: ContactSection = ContactSection()
    task: Task = Free(kind="free")
    """the operator's task"""
    hazard: "tuple[Entry, ...]" = ()
    """hazards of the session"""
    harm: Harm = Harm()
    parameters: Parameters = Field(default_factory=dict)
    """path = value, as in campaigns; a session draws one value of a list"""
    robot: RobotSection = RobotSection()

    @field_validator("arms")
    @classmethod
    def _check_arms(cls, arms: Arms) -> Arms:
        if list(arms) != [arm for arm in ARMS if arm in arms]:
            raise ValueError(f"got {list(arms)}, expected each arm once, in the order {list(ARMS)}")
        return arms

    @property
    def ticks(self) -> int:
        """Length of a session in ms."""
        return max(1, round(self.duration_s * 1000.0))

    def entry_name(self, number: int) -> str:
        """Return the name of a hazard entry, or `hazardN` with N from 1. number: from 0."""
        return self.hazard[number].name or f"hazard{number + 1}"

    def resolved(self) -> dict[str, object]:
        """Return the complete scenario file as JSON, including defaults."""
        return self.model_dump(mode="json", exclude_none=True)
