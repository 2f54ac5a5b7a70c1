"""What each parameter of a campaign may be: one table of ranges, and the check of an axis against it.

A range keeps out what has no meaning (negative mass, a packet every 0 cycles), what single precision cannot hold, and
what is a slip of the unit (degrees for radians). Within it the robot may be as bad as a campaign wants it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from ravenjax.campaign.file.axis import Axis
from ravenjax.errors import shown
from ravenjax.numbers import paths
from ravenjax.robots.raven2.arms import ARMS, JOINTS

TAIL = 7.04
"""Standard deviations: `Axis.at` of a normal distribution never goes farther (quantiles from 1e-12)."""


@dataclasses.dataclass(frozen=True)
class Bound:
    """A row of the table: what one kind of number may be."""

    path: str  # as `plain` gives it: without arm, number of a set, joint or axis
    low: float
    high: float
    unit: str
    meaning: str
    whole: bool = False
    joints: tuple[str, ...] = ()  # joints that the row is of; (): every number of the path
    why: str = ""  # what the range keeps out, where the meaning does not say it

    @property
    def range(self) -> str:
        """`1..1000 cycles, whole`"""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.10g}..{self.high:.10g}{unit}" + (", whole" if self.whole else "")

    def __str__(self) -> str:
        return f"{self.range} ({self.why or self.meaning})"


def _per_joint(path: str, turn: float, slide: float, meaning: str) -> tuple[Bound, Bound]:
    """An angle of the revolute joints (rad, either way), and a travel of the insertion (m, from 0)."""
    revolute = tuple(joint for joint in JOINTS if joint != "insertion")
    return (
        Bound(path, -turn, turn, "rad", meaning, joints=revolute),
        Bound(path, 0.0, slide, "m", meaning, joints=("insertion",)),
    )


_HOUR_MS = 3_600_000  # the longest run
_TURN = 6.3  # rad; a full turn, so that degrees stand out
_TRAVEL = 1.0  # m; the instrument is 0.5 m long

BOUNDS: tuple[Bound, ...] = (
    Bound("operator.scale", 0, 1, "", "tip motion per hand motion: the teleoperation scale"),
    Bound("operator.start_position", -1e6, 1e6, "um", "tip where an absolute console starts, in frame 0"),
    Bound(
        "operator.start_quat",
        -1,
        1,
        "",
        "tip rotation where an absolute console starts, in frame 0",
        why="component of a unit quaternion",
    ),
    Bound("operator.start_grasp", -6300, 6300, "mrad", "jaw opening where an absolute console starts"),
    Bound("network.cycles_per_packet", 1, 1000, "cycles", "how long a packet of the console lasts", whole=True),
    Bound("usb.command_delay", 0, 16, "ms", "from USB write to motor", whole=True),
    Bound("control.teleoperation.grasp_gain", -100, 100, "", "jaw opening per grasp increment of a packet", whole=True),
    Bound("control.teleoperation.grasp_min_mrad", -6300, 6300, "mrad", "smallest jaw opening", whole=True),
    Bound("control.teleoperation.grasp_max_mrad", -6300, 6300, "mrad", "largest jaw opening", whole=True),
    Bound(
        "control.teleoperation.timeout_ticks",
        0,
        _HOUR_MS,
        "ms",
        "silence of the console that lifts the pedal",
        whole=True,
    ),
    Bound(
        "control.state_machine.plc_obeyed",
        0,
        1,
        "",
        "1: the software looks at the PLC's pins, 0: it does not",
        whole=True,
    ),
    Bound(
        "control.estimator.enc_offset",
        -(2**23),
        2**23 - 1,
        "counts",
        "encoder count at motor angle 0, as homing leaves it",
        whole=True,
        why="a reading of 24 bits",
    ),
    *_per_joint("control.cartesian.lower", _TURN, _TRAVEL, "lower soft limit of the joint in the control software"),
    *_per_joint("control.cartesian.upper", _TURN, _TRAVEL, "upper soft limit of the joint in the control software"),
    Bound(
        "control.motor_control.kp",
        -1e3,
        1e3,
        "N m/rad",
        "proportional gain of the motor controller",
        why="gain; negative: a mistaken sign",
    ),
    Bound(
        "control.motor_control.kd",
        -1e3,
        1e3,
        "N m s/rad",
        "derivative gain of the motor controller",
        why="gain; negative: a mistaken sign",
    ),
    Bound(
        "control.motor_control.ki",
        -1e3,
        1e3,
        "N m/(rad s)",
        "integral gain of the motor controller",
        why="gain; negative: a mistaken sign",
    ),
    Bound("control.motor_control.mvel_d", -1e4, 1e4, "rad/s", "desired motor velocity, 0 in raven2"),
    Bound(
        "control.overdrive.policy",
        0,
        2,
        "",
        "overdrive policy: 0 none, 1 soft (clips), 2 hard (stops after ten)",
        whole=True,
    ),
    Bound(
        "control.overdrive.dac_max",
        0,
        2**15,
        "counts",
        "command to which the overdrive check clips",
        whole=True,
        why="a magnitude of 16 bits",
    ),
    Bound(
        "control.overdrive.max_inst_dac",
        0,
        2**15,
        "counts",
        "command above which the overdrive check stops the robot",
        whole=True,
        why="a magnitude of 16 bits",
    ),
    Bound("plc.watchdog_ticks", 1, _HOUR_MS, "ms", "without a watchdog edge before the PLC trips", whole=True),
    Bound("plc.auto_start", 0, 1, "", "1: the start button is pressed by itself, 0: never", whole=True),
    Bound("plc.start_ticks", 0, _HOUR_MS, "ms", "of living watchdog in E-stop before start is pressed", whole=True),
    Bound(
        "plant.actuators.torque_per_count",
        0,
        1,
        "N m per count",
        "motor torque after the gearbox per DAC count, magnitude",
        why="its sign is the wiring's",
    ),
    Bound("plant.actuators.gain", 0, 100, "", "gain error of the amplifier, times the torque"),
    Bound(
        "plant.actuators.bias", -100, 100, "N m", "torque of the amplifier at any command, in positive motor direction"
    ),
    Bound("plant.actuators.inertia", 1e-7, 1, "kg m2", "of rotor and gearbox", why="a rotor has some"),
    Bound("plant.actuators.coulomb", 0, 1e3, "N m", "dry friction of the motor", why="friction opposes motion"),
    Bound(
        "plant.actuators.viscous", 0, 1e3, "N m s/rad", "viscous friction of the motor", why="friction opposes motion"
    ),
    Bound(
        "plant.actuators.reaction_scale",
        0,
        100,
        "",
        "share of the cable's torque that the motor feels; 1 as published, the gearbox ratio by statics",
    ),
    Bound("plant.brakes.holding_torque", 0, 1e4, "N m", "dry friction of a closed brake, after the gearbox"),
    Bound("plant.brakes.engage_ticks", 0, _HOUR_MS, "ms", "from brake command to grip", whole=True),
    Bound("plant.brakes.release_ticks", 0, _HOUR_MS, "ms", "from brake command to free", whole=True),
    Bound(
        "plant.cable_stiffness",
        100,
        1e8,
        "N/m",
        "stiffness of each cable",
        why="an unbroken cable holds the arm at rest; break it by a fault",
    ),
    Bound("plant.cable_damping", 0, 1e6, "N s/m", "damping of each cable", why="damping takes energy"),
    Bound("plant.link_coulomb", 0, 1e3, "N m; insertion N", "dry friction of the joint", why="friction opposes motion"),
    Bound(
        "plant.link_viscous",
        0,
        1e3,
        "N m s/rad; insertion N s/m",
        "viscous friction of the joint",
        why="friction opposes motion",
    ),
    *_per_joint("plant.stops.lower", _TURN, _TRAVEL, "lower hard stop of the joint"),
    *_per_joint("plant.stops.upper", _TURN, _TRAVEL, "upper hard stop of the joint"),
    Bound(
        "plant.stops.stiffness",
        0,
        1e8,
        "N m/rad; insertion N/m",
        "stiffness of the hard stop; 0: no stop",
        why="a stop pushes back",
    ),
    Bound("plant.friction_scale", 0, 100, "", "times all friction of motors and joints", why="friction opposes motion"),
    Bound(
        "plant.cable_stiffness_scale",
        0.05,
        100,
        "",
        "times the stiffness of every cable",
        why="an unbroken cable holds the arm; break one by a fault",
    ),
    Bound("plant.motor_constant_scale", 0, 100, "", "times torque per count of every motor"),
    Bound("plant.mass_scale", 0.01, 100, "", "times masses and inertias of the links", why="masses are positive"),
    Bound("plant.gravity", -100, 100, "m/s2", "acceleration of gravity in frame 0 of the arm"),
    Bound(
        "plant.encoder_noise",
        0,
        1e4,
        "counts rms",
        "noise of the encoders; read where campaign.noise is on",
        why="a standard deviation",
    ),
    Bound(
        "plant.torque_noise",
        0,
        100,
        "N m rms",
        "noise of the motor torques after the gearbox; read where campaign.noise is on",
        why="a standard deviation",
    ),
    Bound(
        "nominal.kp",
        0,
        1e6,
        "N m/rad; insertion N/m; jaws 1/s2",
        "stiffness with which the nominal model follows its target",
        why="the model is stable",
    ),
    Bound(
        "nominal.kd",
        0,
        1e6,
        "N m s/rad; insertion N s/m; jaws 1/s",
        "damping with which the nominal model follows its target",
        why="the model is stable",
    ),
    Bound("nominal.ki", 0, 1e6, "N/(m s)", "integral gain of the nominal model's insertion", why="the model is stable"),
    Bound(
        "nominal.kv",
        0,
        1e6,
        "N m s/rad; insertion N s/m",
        "viscous friction of the nominal model's joints",
        why="friction opposes motion",
    ),
    Bound(
        "nominal.kc",
        0,
        1e6,
        "N m; insertion N",
        "dry friction of the nominal model's joints",
        why="friction opposes motion",
    ),
    Bound(
        "nominal.mass_scale", 0.01, 100, "", "times masses and inertias of the nominal model", why="masses are positive"
    ),
    Bound(
        "nominal.resync",
        0,
        1,
        "",
        "while the pedal is up the nominal model 1: stands where the robot is, 0: stays where it was",
        whole=True,
    ),
    *_per_joint("nominal.target.lower", _TURN, _TRAVEL, "lower soft limit of the nominal model's target"),
    *_per_joint("nominal.target.upper", _TURN, _TRAVEL, "upper soft limit of the nominal model's target"),
    Bound("reaction.action", 0, 3, "", "what the operator does: 0 none, 1 release, 2 slow, 3 correct", whole=True),
    Bound("reaction.delay_ms", 0, _HOUR_MS, "ms", "from the first felt pull to the action"),
    Bound("reaction.felt_force", 0, 1e9, "device units", "weakest pull that the operator notices"),
    Bound("reaction.slow_to", 0, 1, "", "speed of slowed hands, of what it was"),
    Bound("reaction.correct_per_s", 0, 1e3, "1/s", "share of the distance that a correcting operator takes back"),
    Bound("reaction.correct_speed", 0, 10, "m/s", "fastest correction of the tip"),
    *(
        Bound(f"detectors.{joint}.{name}", 1e-9, 1e6, unit, "step within 1 ms at which the detector scores 1")
        for joint, slide in (("shoulder", "rad"), ("elbow", "rad"), ("insertion", "m"))
        for name, unit in (("mpos", "rad"), ("mvel", "rad/s"), ("jpos", slide))
    ),
    Bound(
        "detectors.armed_after", 0, _HOUR_MS, "ms", "since the run began, before which no detector looks", whole=True
    ),
)

NAMES = frozenset((*(part for row in BOUNDS for part in row.path.split(".")), *paths.components(JOINTS)))
"""Every word of a parameter's path but arms and numbers."""

RESERVED = {
    "plant.noise_key": "it is derived from each run's id, so that no two runs draw the same noise; "
    "set campaign.noise = true, and campaign.seed or repeats for other draws",
    "monitor.limit": "it is what the words of every report mean; write [outcomes] limit_mm",
    "monitor.jump_step": "it is what the words of every report mean; write [outcomes] jump_step_mm",
    "monitor.large_jump": "it is what the words of every report mean; write [outcomes] large_jump_mm",
    "monitor": "it belongs to the observer, not to the robot",
    "haptics.cues": "reports name each cue by it; write [haptics] threshold_mm, kp_per_mm, kd_per_mm_s and cap, whose "
    "lists are evaluated side by side in the same runs",
    "detectors.levels": "reports name each alarm by it; write level = [..] in [[detector]]",
}
"""Parameters, or all that begin so, that a campaign must leave alone; why, and what to write instead."""


def plain(path: str) -> str:
    """A parameter's path without arm, number of a set, joint or axis."""
    parts = [part for part in paths.shorten(path, ARMS).split(".") if not part.isdecimal()]
    return ".".join(parts[:-1] if parts[-1:] and parts[-1] in paths.components(JOINTS) else parts)


def of(path: str) -> list[Bound]:
    """The rows that hold for `path`: one for a single number, more where it names a whole vector of unlike ones."""
    kind, last = plain(path), path.rpartition(".")[2]
    return [row for row in BOUNDS if row.path == kind and (last in row.joints or not row.joints or last not in JOINTS)]


def reserved(path: str) -> str:
    """Why a campaign must leave a parameter alone, and what to write instead; "" for one that it may vary."""
    kind = plain(path)
    return next((why for name, why in RESERVED.items() if kind == name or kind.startswith(f"{name}.")), "")


def complaints(path: str, axis: Axis) -> Iterator[str]:
    """What is wrong with the values that a parameter would take; nothing for a path that the table does not know."""
    if why := reserved(path):
        yield f"cannot be set: {why}"
    for row in of(path):
        if row.whole and axis.drawn and not axis.listed:
            yield f"{axis.kind} draws fractions, expected {row}; write {{choice = [..]}}"
            continue
        for got, value in _extremes(axis):
            if not row.low <= value <= row.high:
                yield f"got {got}, expected {row}{_hint(row, axis)}"
                break
            if row.whole and value != int(value):
                yield f"got {got}, expected {row}"
                break


def extent(axis: Axis) -> tuple[float, float]:
    """Least and greatest number that a distribution may draw."""
    low, high = axis.values
    return (low - TAIL * high, low + TAIL * high) if axis.kind == "normal" else (low, high)


def _extremes(axis: Axis) -> Iterator[tuple[str, float]]:
    """(as it is told, value) of each listed value, or of the ends of what can be drawn."""
    if axis.listed:
        yield from ((shown(value), value) for value in axis.values)
        return
    for end, value in zip(("as low as", "as high as"), extent(axis), strict=True):
        yield f"{axis.kind} = {shown(list(axis.values))}, which may draw {end} {value:.6g}", value


def _hint(row: Bound, axis: Axis) -> str:
    if axis.kind != "normal":
        return ""
    room = min(axis.values[0] - row.low, row.high - axis.values[0]) / TAIL
    smaller = f" up to {math.floor(room * 1e4) / 1e4:g}" if room >= 1e-4 else ""
    return f"; take a standard deviation{smaller} that cannot leave it, or {{uniform = [low, high]}}"
