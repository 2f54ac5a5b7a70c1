"""Static types of `tables`; a test holds them up to date.

Written by `ravenjax reference --types ravenjax/notebook/tables.pyi`.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias

from numpy.typing import NDArray

from ravenjax.notebook.axes import Form
from ravenjax.notebook.file_table import FileTable

Site: TypeAlias = Literal[
    "hand",
    "console",
    "network",
    "packet",
    "packet_header",
    "encoder",
    "usb_in",
    "usb_status",
    "runlevel",
    "mpos",
    "mvel",
    "jpos",
    "jvel",
    "pos",
    "ori",
    "pos_d",
    "ori_d",
    "jpos_d",
    "mpos_d",
    "tau_d",
    "current_cmd",
    "usb_out",
    "pins_out",
    "plc",
    "buttons",
    "torque_scale",
    "cable_scale",
    "friction_scale",
    "external_torque",
    "brake",
]
Effect: TypeAlias = Literal[
    "overwrite",
    "offset",
    "latch_offset",
    "scale",
    "drift",
    "stuck",
    "bit_flip",
    "periodic",
    "random",
    "toggle",
    "drop",
    "duplicate",
    "delay",
]
Motion: TypeAlias = Literal[
    "suture",
    "peg_transfer",
    "palpate",
    "circle",
    "reach",
    "still",
    "clutched",
]
Fusion: TypeAlias = Literal[
    "all",
    "two",
    "any",
    "mpos",
    "mvel",
    "jpos",
]
Rates: TypeAlias = Literal[
    "evades",
    "evades_built_in",
    "unintended_motion",
    "loss_of_motion",
    "false_report",
    "hazard",
    "stopped",
    "flagged",
    "limited",
    "silent",
    "told",
    "cue",
    "jump",
    "cable_overload",
    "activated",
    "diverged",
]
Design: TypeAlias = Literal[
    "grid",
    "zip",
    "list",
    "random",
    "lhs",
    "sobol",
]
Hazards: TypeAlias = Literal[
    "all",
    "L1",
    "L2",
    "L3",
    "L4",
    "L5",
    "L6",
    "L7",
    "L8",
    "L9",
    "L10",
    "C13",
    "C14",
    "C15",
    "C16",
    "C18",
    "C19",
    "C01",
    "C02",
    "C03",
    "C05",
    "C06",
    "C07",
    "C08",
    "C09",
    "C10",
    "C11",
    "C12",
    "K01",
    "K02",
    "K03",
    "K21",
    "K04",
    "K05",
    "K06",
    "K22",
    "K07",
    "K10",
    "K11",
    "K12",
    "K13",
    "K14",
    "K15",
    "K16",
    "K17",
    "K18",
    "K19",
    "K20",
    "K23",
    "B01",
    "B02",
    "B03",
    "B04",
    "B05",
    "B06",
    "B23",
    "B29",
    "B07",
    "B08",
    "B10",
    "B11",
    "B24",
    "B25",
    "B26",
    "B27",
    "B28",
    "B30",
    "B12",
    "B13",
    "B14",
    "B15",
    "B16",
    "B17",
    "B18",
    "B19",
    "B20",
    "B31",
    "B32",
    "N01",
    "N02",
    "N03",
    "N04",
    "N05",
    "N07",
    "M01",
    "M02",
    "M08",
]
Tools: TypeAlias = Literal[
    "r_grasper",
    "r_sq_grasper",
    "large_needle",
    "micro_forceps",
    "bipolar_forceps",
    "cardiere_forceps",
    "mopocu_scissor",
    "potts_scissor",
    "r_grasper_A",
    "r_grasper_B",
]
ParameterSet: TypeAlias = Literal[
    "power_consistent",
    "traj3",
    "A",
    "B",
    "C",
    "D",
    "E",
    "matlab_main",
    "matlab_global",
]

class Start(FileTable):
    """A table [operator.start] of a campaign.

    shoulder_deg: shoulder, between its hard stops
    elbow_deg: elbow, between its hard stops
    insertion_m: insertion; less draws the instrument back
    tool_roll_deg: roll of the instrument
    wrist_deg: wrist of the instrument
    """
    def __init__(
        self,
        *,
        shoulder_deg: float | None = None,
        elbow_deg: float | None = None,
        insertion_m: float | None = None,
        tool_roll_deg: float | None = None,
        wrist_deg: float | None = None,
    ) -> None: ...
    @property
    def shoulder_deg(self) -> Any: ...
    @property
    def elbow_deg(self) -> Any: ...
    @property
    def insertion_m(self) -> Any: ...
    @property
    def tool_roll_deg(self) -> Any: ...
    @property
    def wrist_deg(self) -> Any: ...

class Fault(FileTable):
    """A table [[group.fault]] of a campaign.

    site: where: a fault site, see `ravenjax faults`
    arm: gold or green; may be left out with one arm
    channel: joint, axis or field of the site; "*": each of them; may be left out where it has one
    effect: what becomes of the number, see Effects
    value: in the channel's unit; scale: a factor; bit_flip: index of the bit; delay: packets; stuck, drop and
        duplicate take none
    trigger: what start_ms counts from: time, packet or pedal
    start_ms: onset: ms, packets or ms since pedal-down, as the trigger says; or a place in a phase of the
        operation, see Phases
    duration_ms: length of the window, ms or packets; "end": until the run ends
    every_ms: the window opens again after each, 0: never
    period_ms: period of effect periodic, ms
    wraps: a value beyond 16 bits is meant, and stored as the word holds it; without it such a value is refused,
        but at usb_out where campaign.dac_words is set
    """  # noqa: E501
    def __init__(
        self,
        *,
        site: Site,
        effect: Effect | Sequence[Effect] | Form,
        start_ms: int | Sequence[int | Form] | NDArray[Any] | Form,
        arm: Literal["gold", "green"] | Sequence[Literal["gold", "green"]] | Form | None = None,
        channel: str | Sequence[str] | Form | None = None,
        value: float | bool | Sequence[float | bool] | NDArray[Any] | Form | None = None,
        trigger: Literal["time", "packet", "pedal"]
        | Sequence[Literal["time", "packet", "pedal"]]
        | Form
        | None = None,
        duration_ms: int
        | Literal["end"]
        | Sequence[int | Literal["end"]]
        | NDArray[Any]
        | Form
        | None = None,
        every_ms: int | Sequence[int] | NDArray[Any] | Form | None = None,
        period_ms: int | Sequence[int] | NDArray[Any] | Form | None = None,
        wraps: bool | None = None,
    ) -> None: ...
    @property
    def site(self) -> Any: ...
    @property
    def arm(self) -> Any: ...
    @property
    def channel(self) -> Any: ...
    @property
    def effect(self) -> Any: ...
    @property
    def value(self) -> Any: ...
    @property
    def trigger(self) -> Any: ...
    @property
    def start_ms(self) -> Any: ...
    @property
    def duration_ms(self) -> Any: ...
    @property
    def every_ms(self) -> Any: ...
    @property
    def period_ms(self) -> Any: ...
    @property
    def wraps(self) -> Any: ...

class Run(FileTable):
    """A table [[group.run]] of a campaign.

    fault: per slot, the keys to replace
    parameters: path = value
    """
    def __init__(
        self,
        *,
        fault: Sequence[Mapping[str, Any]] | None = None,
        parameters: Mapping[str, Any] | None = None,
    ) -> None: ...
    @property
    def fault(self) -> Any: ...
    @property
    def parameters(self) -> Any: ...

class Operator(FileTable):
    """A table [operator] of a campaign.

    motion: a generated motion: suture, peg_transfer, palpate, circle, reach, still, clutched
    file: a recorded motion (Parquet, CSV, MCAP, ROS bag), from this file's folder; a Python file (.py) is
        `hands`
    hands: a Python file with an operator of your own, from this file's folder: what hands make of motion or
        file, which is their plan; its parameters are operator.own.hands...
    hands_sha256: of hands and what it takes from its folder; another content is refused. Left out, any is taken
    scale: teleoperation scale; varied as operator.scale. At the scale written here a recorded tip moves as
        recorded; a generated motion is planned for 0.1
    seed: seed of the generated motion
    window_s: [begin, end] within a recorded motion, s
    rate_hz: rows a second of a recorded motion, evenly spaced: where it has no times, or those of arrival
    cutoff_hz: low-pass of a recorded motion, Hz; without it none: tremor stays
    max_gap_s: longest gap of a recorded motion that is bridged by interpolation, s
    spikes: a recorded tip that jumps: refuse; remove: interpolate where it comes back; replay: as it is
    console: whose packets a recorded stream holds: a profile's name, a .toml file, or auto, found from them
    at_end: a recorded motion that ends before the run: refuse; hold: hands rest; reverse: back and forth
    start: [operator.start]: joints in which a generated motion begins; what is left out is as after homing.
    slow_down: how much slower than recorded it is replayed
    """  # noqa: E501
    def __init__(
        self,
        *,
        motion: Motion | None = None,
        file: str | PathLike[str] | None = None,
        hands: str | PathLike[str] | None = None,
        hands_sha256: str | None = None,
        scale: float | None = None,
        seed: int | None = None,
        window_s: Sequence[float] | NDArray[Any] | None = None,
        rate_hz: float | None = None,
        cutoff_hz: float | None = None,
        max_gap_s: float | None = None,
        spikes: Literal["refuse", "remove", "replay"] | None = None,
        console: str | None = None,
        at_end: Literal["refuse", "hold", "reverse"] | None = None,
        start: Start | None = None,
        slow_down: float | None = None,
    ) -> None: ...
    @property
    def motion(self) -> Any: ...
    @property
    def file(self) -> Any: ...
    @property
    def hands(self) -> Any: ...
    @property
    def hands_sha256(self) -> Any: ...
    @property
    def scale(self) -> Any: ...
    @property
    def seed(self) -> Any: ...
    @property
    def window_s(self) -> Any: ...
    @property
    def rate_hz(self) -> Any: ...
    @property
    def cutoff_hz(self) -> Any: ...
    @property
    def max_gap_s(self) -> Any: ...
    @property
    def spikes(self) -> Any: ...
    @property
    def console(self) -> Any: ...
    @property
    def at_end(self) -> Any: ...
    @property
    def start(self) -> Any: ...
    @property
    def slow_down(self) -> Any: ...

class Limits(FileTable):
    """A table [limits] of a campaign.

    shoulder_deg: [min, max] of the shoulder
    elbow_deg: [min, max] of the elbow
    insertion_m: [min, max] of the insertion
    tool_roll_deg: [min, max] of the instrument's roll
    wrist_deg: [min, max] of the instrument's wrist
    """
    def __init__(
        self,
        *,
        shoulder_deg: Sequence[float] | NDArray[Any] | None = None,
        elbow_deg: Sequence[float] | NDArray[Any] | None = None,
        insertion_m: Sequence[float] | NDArray[Any] | None = None,
        tool_roll_deg: Sequence[float] | NDArray[Any] | None = None,
        wrist_deg: Sequence[float] | NDArray[Any] | None = None,
    ) -> None: ...
    @property
    def shoulder_deg(self) -> Any: ...
    @property
    def elbow_deg(self) -> Any: ...
    @property
    def insertion_m(self) -> Any: ...
    @property
    def tool_roll_deg(self) -> Any: ...
    @property
    def wrist_deg(self) -> Any: ...

class Reaction(FileTable):
    """A table [reaction] of a campaign.

    action: lift the pedal, slow down, or correct by eye; varied as reaction.action, 0 to 3
    delay_ms: from the first felt pull to the action, ms
    felt_force: a weaker pull is not noticed, device units
    slow_to: speed of slowed hands, of what it was
    correct_per_s: share of the distance corrected, 1/s
    correct_mm_s: fastest correction of the tip, mm/s
    """
    def __init__(
        self,
        *,
        action: Literal["none", "release", "slow", "correct"] | None = None,
        delay_ms: float | None = None,
        felt_force: float | None = None,
        slow_to: float | None = None,
        correct_per_s: float | None = None,
        correct_mm_s: float | None = None,
    ) -> None: ...
    @property
    def action(self) -> Any: ...
    @property
    def delay_ms(self) -> Any: ...
    @property
    def felt_force(self) -> Any: ...
    @property
    def slow_to(self) -> Any: ...
    @property
    def correct_per_s(self) -> Any: ...
    @property
    def correct_mm_s(self) -> Any: ...

class OwnStages(FileTable):
    """A table [controller] of a campaign.

    motor_control: a file whose step gives (state, tau_d): desired torques from desired motor positions
    dac: a file whose step gives (state, current_cmd): DAC counts from desired torques
    sha256: stage = of that file and what it takes from its folder; another content is refused. Left out, any is
        taken
    """  # noqa: E501
    def __init__(
        self,
        *,
        motor_control: str | PathLike[str] | None = None,
        dac: str | PathLike[str] | None = None,
        sha256: Mapping[str, Any] | None = None,
    ) -> None: ...
    @property
    def motor_control(self) -> Any: ...
    @property
    def dac(self) -> Any: ...
    @property
    def sha256(self) -> Any: ...

class Hand(FileTable):
    """A table [hand] of a campaign.

    grip: how firmly it holds the console: 0 relaxed, 1 firm
    newtons_per_unit: force per device unit of the cue, N; no source says it, assumed
    """
    def __init__(
        self,
        *,
        grip: float | None = None,
        newtons_per_unit: float | None = None,
    ) -> None: ...
    @property
    def grip(self) -> Any: ...
    @property
    def newtons_per_unit(self) -> Any: ...

class Haptics(FileTable):
    """A table [haptics] of a campaign.

    threshold_mm: tip distance above which the cue pulls, mm
    kp_per_mm: spring, device units per mm
    kd_per_mm_s: damper, device units per mm/s
    cap: largest force, device units
    combine: grid: every combination; zip: side by side
    """
    def __init__(
        self,
        *,
        threshold_mm: float | Sequence[float] | NDArray[Any] | None = None,
        kp_per_mm: float | Sequence[float] | NDArray[Any] | None = None,
        kd_per_mm_s: float | Sequence[float] | NDArray[Any] | None = None,
        cap: float | Sequence[float] | NDArray[Any] | None = None,
        combine: Literal["grid", "zip"] | None = None,
    ) -> None: ...
    @property
    def threshold_mm(self) -> Any: ...
    @property
    def kp_per_mm(self) -> Any: ...
    @property
    def kd_per_mm_s(self) -> Any: ...
    @property
    def cap(self) -> Any: ...
    @property
    def combine(self) -> Any: ...

class Detector(FileTable):
    """A table [[detector]] of a campaign.

    name: what it is called in tables
    kind: steps: of motor position, motor velocity and joint position over their thresholds, model-based;
        derivative_sum: of link and motor derivatives; tip_error: distance from the nominal model, mm;
        overdrive: command over its clip limit
    file: in place of kind: a Python file with a detector of your own, from this file's folder
    sha256: of that file and what it takes from its folder; another content is refused. Left out, any is taken
    acts: of a file: watch; or stop: an alarm at its first threshold presses the E-stop a millisecond later
    fusion: of steps: which of the three must be over; all, two, any, or one of them alone
    consecutive: milliseconds in a row above the threshold that make an alarm, 1 to 8
    threshold: alarm above it; all evaluated in the same run
    """  # noqa: E501
    def __init__(
        self,
        *,
        name: str,
        kind: Literal["steps", "derivative_sum", "tip_error", "overdrive"] | None = None,
        file: str | PathLike[str] | None = None,
        sha256: str | None = None,
        acts: Literal["watch", "stop"] | None = None,
        fusion: Fusion | Sequence[Fusion] | None = None,
        consecutive: int | Sequence[int] | NDArray[Any] | None = None,
        threshold: float | Sequence[float] | NDArray[Any] | None = None,
    ) -> None: ...
    @property
    def name(self) -> Any: ...
    @property
    def kind(self) -> Any: ...
    @property
    def file(self) -> Any: ...
    @property
    def sha256(self) -> Any: ...
    @property
    def acts(self) -> Any: ...
    @property
    def fusion(self) -> Any: ...
    @property
    def consecutive(self) -> Any: ...
    @property
    def threshold(self) -> Any: ...

class OwnCheck(FileTable):
    """A table [check] of a campaign.

    name: what it is called in tables, where its columns are check_own_NAME_..
    file: a Python file with the check, from this file's folder
    sha256: of that file and what it takes from its folder; another content is refused. Left out, any is taken
    at: seam where it stands
    acts: what it does when it trips, by the robot's own means; stop: stops the robot; flag: tells a person;
        limit: limits, tells nobody; watch: watches, does nothing
    threshold: it trips above it; varied as checks.threshold.NAME
    consecutive: milliseconds in a row above the threshold in which it trips from then on
    """  # noqa: E501
    def __init__(
        self,
        *,
        name: str,
        file: str | PathLike[str],
        at: str,
        sha256: str | None = None,
        acts: Literal["stop", "flag", "limit", "watch"] | None = None,
        threshold: float | None = None,
        consecutive: int | None = None,
    ) -> None: ...
    @property
    def name(self) -> Any: ...
    @property
    def file(self) -> Any: ...
    @property
    def sha256(self) -> Any: ...
    @property
    def at(self) -> Any: ...
    @property
    def acts(self) -> Any: ...
    @property
    def threshold(self) -> Any: ...
    @property
    def consecutive(self) -> Any: ...

class Outcomes(FileTable):
    """A table [outcomes] of a campaign.

    jump: code: measured tip steps > jump_step_mm on two packets in a row, the golden run's not; text: true tip
        > large_jump_mm within 2 ms
    cue: number of the haptic set, from 0
    jump_step_mm: of rule code: step of the measured tip per packet, mm
    large_jump_mm: of rule text: motion of the true tip within 2 ms, mm
    limit_mm: a motion, or an error of the report, of more than this is a hazard, mm
    """  # noqa: E501
    def __init__(
        self,
        *,
        jump: Literal["code", "text"] | None = None,
        cue: int | None = None,
        jump_step_mm: float | None = None,
        large_jump_mm: float | None = None,
        limit_mm: float | None = None,
    ) -> None: ...
    @property
    def jump(self) -> Any: ...
    @property
    def cue(self) -> Any: ...
    @property
    def jump_step_mm(self) -> Any: ...
    @property
    def large_jump_mm(self) -> Any: ...
    @property
    def limit_mm(self) -> Any: ...

class Stop(FileTable):
    """A table [stop] of a campaign.

    half_width: stop once each rate is known within +- this fraction
    rates: which rates: evades, evades_built_in, unintended_motion, loss_of_motion, false_report, hazard,
        stopped, flagged, limited, silent, told, cue, jump, cable_overload, activated, diverged
    of: groups: the rates of each group; whole: those of the whole table
    looks: shares of each group after which one looks, increasing; no more than the last is computed
    confidence: with which all intervals of all looks hold
    allocation: proportional: as many of each group; neyman: after the first look where it narrows most
    """  # noqa: E501
    def __init__(
        self,
        *,
        half_width: float,
        rates: Sequence[Rates] | None = None,
        of: Literal["groups", "whole"] | None = None,
        looks: Sequence[float] | NDArray[Any] | None = None,
        confidence: float | None = None,
        allocation: Literal["proportional", "neyman"] | None = None,
    ) -> None: ...
    @property
    def half_width(self) -> Any: ...
    @property
    def rates(self) -> Any: ...
    @property
    def of(self) -> Any: ...
    @property
    def looks(self) -> Any: ...
    @property
    def confidence(self) -> Any: ...
    @property
    def allocation(self) -> Any: ...

class Group(FileTable):
    """A table [[group]] of a campaign.

    name: names the group in tables and report
    design: how lists and distributions become runs
    runs: how many are drawn; of designs random, lhs, sobol, and only there
    repeats: each run so many times, with seeds of its own
    fault: faults that strike in the same run; none: fault-free runs
    run: the runs of design list
    parameters: as [parameters], for this group alone
    cross: as [cross], for this group alone
    hazards: of a group that names hazards: ids (C09) and layers (L7) of the library, or "all": every hazard
        that can be run
    arm: of a group that names hazards: arm that is struck, or a list of arms struck in turn; left out with both
        arms: that of the source, both in one run where the source strikes both, else each in turn
    value: of a group that names hazards: in place of the library's, for hazards that strike one channel
    start_ms: of a group that names hazards: in place of the library's onsets
    duration_ms: of a group that names hazards: in place of the library's lengths of the window
    """  # noqa: E501
    def __init__(
        self,
        *,
        name: str,
        design: Design | None = None,
        runs: int | None = None,
        repeats: int | None = None,
        fault: Sequence[Fault] | None = None,
        run: Sequence[Run] | None = None,
        parameters: Mapping[str, Any] | None = None,
        cross: Mapping[str, Any] | None = None,
        hazards: Hazards | Sequence[Hazards] | None = None,
        arm: Literal["gold", "green"] | Sequence[Literal["gold", "green"]] | Form | None = None,
        value: float | bool | Sequence[float | bool] | NDArray[Any] | Form | None = None,
        start_ms: int | Sequence[int | Form] | NDArray[Any] | Form | None = None,
        duration_ms: int
        | Literal["end"]
        | Sequence[int | Literal["end"]]
        | NDArray[Any]
        | Form
        | None = None,
    ) -> None: ...
    @property
    def name(self) -> Any: ...
    @property
    def design(self) -> Any: ...
    @property
    def runs(self) -> Any: ...
    @property
    def repeats(self) -> Any: ...
    @property
    def fault(self) -> Any: ...
    @property
    def run(self) -> Any: ...
    @property
    def parameters(self) -> Any: ...
    @property
    def cross(self) -> Any: ...
    @property
    def hazards(self) -> Any: ...
    @property
    def arm(self) -> Any: ...
    @property
    def value(self) -> Any: ...
    @property
    def start_ms(self) -> Any: ...
    @property
    def duration_ms(self) -> Any: ...

class CampaignTable(FileTable):
    """A whole campaign file: the keys of [campaign], and its other tables.

    robot: kind of robot, or the Python module of one's own that declares ROBOT
    name: short name; also names the default output folder
    description: what the campaign asks
    seed: seed of designs, noise and random effects
    duration_s: length of each run, s
    observe_ms: end a run so long after its last fault ended, outcomes are those until then; left out, each goes
        on for duration_s, as any does with a fault of no certain end: that lasts, or counts time in pedal-down
        where a fault may move the pedal
    arms: arms, gold first
    noise: draw noise of the sizes plant.encoder_noise and plant.torque_noise, anew each run
    limit: compute only the first so many runs; a start with more, or with all, goes on
    chunk: rows per Parquet part; default: by the number of runs
    software: control software: present raven2, or the 2015 fork
    build: what the software was built for; dyn_sim, of fork2015: motors 1-3 read from the model without
        encoders and filter, ideal tool joints, packets that end with a software E-stop; dyn_sim_tools: the
        same, but tool joints measured as on the robot, which nobody published
    dac_words: how a DAC command that a fault wrote behind the checks is stored in the 16 bits of a USB word;
        left out, it wraps, and a fault's value beyond 16 bits is refused
    tools: one tool per arm; default: the software's own
    console: what a packet carries: increments of the hand's motion, or positions
    packets: how many control cycles a packet of the console lasts, drawn anew each run: every_cycle: one;
        measured: as on a recorded robot, two in 93 of 100; bursts: as a recorded console sends, one to three,
        and 6 to 11 in 18 of 100; or the shares of packets that last 1, 2, 3, .. cycles. The hand moves on
        meanwhile; varied as network.packets, 0 to 3
    policy: what raven2's overdrive check does with a command above the limit of its level: nothing, clip it, or
        stop after ten; the fork has no policy
    level: limits of the overdrive check, counts a joint; default moderate for raven2, fork2015 for the fork
    parameter_set: mechanics of the virtual robot: power_consistent, or a set that the authors published for its
        first three joints, under their law of motor and cable
    kinematic_errors: what makes a healthy robot's report wrong (joint offsets after homing, drums, links):
        none; measured: drawn anew for each run and arm, as large as cameras saw on a real arm, an upper bound.
        Half of it: plant.kinematic_errors.scale = 0.5
    cables: what a cable does whose tension exceeds plant.cable_strength: hold all the same, or part, and carry
        nothing for the rest of the run. Either way overload is an outcome of power_consistent; tensions of the
        published sets are no real ones, and nothing breaks there
    contact: whether jaw tips press on the scene's tissue and vessel, and instruments on each other: forces on
        the robot, and outcomes; the numbers are parameters contact... Without it nothing is touched
    substeps: plant steps per 1 ms tick
    parameters: path = value, list or distribution; from = a file of robots
    cross: path = list: every run once with each value, all else alike, random numbers too; for pairs
    haptics: [haptics]: the cue's thresholds and gains, all evaluated in the same run.
    detector: observers that are scored
    check: checks of your own that stand in the loop
    outcomes: [outcomes]: which of the recorded outcomes the headline verdict uses.
    stop: when to stop; without it the whole table is computed
    group: the runs
    operator: [operator]: whose hands move.
    limits: [limits]: soft joint limits of the control software; what is left out keeps the original's.
    reaction: an operator who reacts; without it nobody does
    controller: stages of the control software that are files of your own
    hand: a hand that the cue moves; without it the cue is a signal
    """  # noqa: E501
    def __init__(
        self,
        *,
        name: str,
        group: Sequence[Group],
        robot: str | None = None,
        description: str | None = None,
        seed: int | None = None,
        duration_s: float | None = None,
        observe_ms: int | None = None,
        arms: Sequence[Literal["gold", "green"]] | None = None,
        noise: bool | None = None,
        limit: int | None = None,
        chunk: int | None = None,
        software: Literal["raven2", "fork2015"] | None = None,
        build: Literal["robot", "dyn_sim", "dyn_sim_tools"] | None = None,
        dac_words: Literal["wrap", "saturate", "unwrapped"] | None = None,
        tools: Sequence[Tools] | None = None,
        console: Literal["increments", "absolute"] | None = None,
        packets: Literal["every_cycle", "measured", "bursts"]
        | Sequence[float]
        | NDArray[Any]
        | None = None,
        policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] | None = None,
        level: Literal["beginner", "moderate", "advanced", "fork2015"] | None = None,
        parameter_set: ParameterSet | None = None,
        kinematic_errors: Literal["none", "measured"] | None = None,
        cables: Literal["unbreakable", "break"] | None = None,
        contact: bool | None = None,
        substeps: int | None = None,
        parameters: Mapping[str, Any] | None = None,
        cross: Mapping[str, Any] | None = None,
        haptics: Haptics | None = None,
        detector: Sequence[Detector] | None = None,
        check: Sequence[OwnCheck] | None = None,
        outcomes: Outcomes | None = None,
        stop: Stop | None = None,
        operator: Operator | None = None,
        limits: Limits | None = None,
        reaction: Reaction | None = None,
        controller: OwnStages | None = None,
        hand: Hand | None = None,
    ) -> None: ...
    @property
    def robot(self) -> Any: ...
    @property
    def name(self) -> Any: ...
    @property
    def description(self) -> Any: ...
    @property
    def seed(self) -> Any: ...
    @property
    def duration_s(self) -> Any: ...
    @property
    def observe_ms(self) -> Any: ...
    @property
    def arms(self) -> Any: ...
    @property
    def noise(self) -> Any: ...
    @property
    def limit(self) -> Any: ...
    @property
    def chunk(self) -> Any: ...
    @property
    def software(self) -> Any: ...
    @property
    def build(self) -> Any: ...
    @property
    def dac_words(self) -> Any: ...
    @property
    def tools(self) -> Any: ...
    @property
    def console(self) -> Any: ...
    @property
    def packets(self) -> Any: ...
    @property
    def policy(self) -> Any: ...
    @property
    def level(self) -> Any: ...
    @property
    def parameter_set(self) -> Any: ...
    @property
    def kinematic_errors(self) -> Any: ...
    @property
    def cables(self) -> Any: ...
    @property
    def contact(self) -> Any: ...
    @property
    def substeps(self) -> Any: ...
    @property
    def parameters(self) -> Any: ...
    @property
    def cross(self) -> Any: ...
    @property
    def haptics(self) -> Any: ...
    @property
    def detector(self) -> Any: ...
    @property
    def check(self) -> Any: ...
    @property
    def outcomes(self) -> Any: ...
    @property
    def stop(self) -> Any: ...
    @property
    def group(self) -> Any: ...
    @property
    def operator(self) -> Any: ...
    @property
    def limits(self) -> Any: ...
    @property
    def reaction(self) -> Any: ...
    @property
    def controller(self) -> Any: ...
    @property
    def hand(self) -> Any: ...
