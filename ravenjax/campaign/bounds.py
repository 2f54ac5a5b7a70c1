"""What each parameter of a campaign may be: one table of ranges, and the check of an axis against it.

A range keeps out what has no meaning (negative mass, a packet every 0 cycles), what single precision cannot hold, and
what is a slip of the unit (degrees for radians). Within it the robot may be as bad as a campaign wants it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from ravenjax import paths
from ravenjax.campaign.axis import Axis
from ravenjax.errors import shown
from ravenjax.types import JOINTS

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

    @property
    def range(self) -> str:
        """`1..1000 cycles, whole`"""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.10g}..{self.high:.10g}{unit}" + (", whole" if self.whole else "")

    def __str__(self) -> str:
        return f"{self.range} ({self.meaning})"


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
    Bound("operator.scale", 0, 1, "", "tip motion per hand motion"),
    Bound("operator.start_position", -1e6, 1e6, "um", "where an absolute console starts, in frame 0"),
    Bound("operator.start_quat", -1, 1, "", "component of a unit quaternion"),
    Bound("operator.start_grasp", -6300, 6300, "mrad", "jaw opening where an absolute console starts"),
    Bound("network.cycles_per_packet", 1, 1000, "cycles", "from one packet to the next", whole=True),
    Bound("usb.command_delay", 0, 16, "ms", "from USB write to motor", whole=True),
    Bound("control.teleoperation.grasp_gain", -100, 100, "", "mrad of opening per mrad of a packet", whole=True),
    Bound("control.teleoperation.grasp_min_mrad", -6300, 6300, "mrad", "smallest jaw opening", whole=True),
    Bound("control.teleoperation.grasp_max_mrad", -6300, 6300, "mrad", "largest jaw opening", whole=True),
    Bound("control.teleoperation.timeout_ticks", 0, _HOUR_MS, "ms", "silence that lifts the pedal", whole=True),
    Bound("control.state_machine.plc_obeyed", 0, 1, "", "1: the PLC's pins are looked at", whole=True),
    Bound("control.estimator.enc_offset", -(2**23), 2**23 - 1, "counts", "a reading of 24 bits", whole=True),
    *_per_joint("control.cartesian.lower", _TURN, _TRAVEL, "soft limit of the joint"),
    *_per_joint("control.cartesian.upper", _TURN, _TRAVEL, "soft limit of the joint"),
    Bound("control.motor_control.kp", -1e3, 1e3, "N m/rad", "gain; negative: a mistaken sign"),
    Bound("control.motor_control.kd", -1e3, 1e3, "N m s/rad", "gain; negative: a mistaken sign"),
    Bound("control.motor_control.ki", -1e3, 1e3, "N m/(rad s)", "gain; negative: a mistaken sign"),
    Bound("control.motor_control.mvel_d", -1e4, 1e4, "rad/s", "desired motor velocity"),
    Bound("control.overdrive.policy", 0, 2, "", "0 none, 1 soft, 2 hard", whole=True),
    Bound("control.overdrive.dac_max", 0, 2**15, "counts", "a magnitude of 16 bits", whole=True),
    Bound("control.overdrive.max_inst_dac", 0, 2**15, "counts", "a magnitude of 16 bits", whole=True),
    Bound("plc.watchdog_ticks", 1, _HOUR_MS, "ms", "without an edge before the trip", whole=True),
    Bound("plc.auto_start", 0, 1, "", "1: the start button is pressed by itself", whole=True),
    Bound("plc.start_ticks", 0, _HOUR_MS, "ms", "in E-STOP before it is pressed", whole=True),
    Bound("plant.actuators.torque_per_count", 0, 1, "N m per count", "magnitude; its sign is the wiring's"),
    Bound("plant.actuators.gain", 0, 100, "", "times the amplifier's gain"),
    Bound("plant.actuators.bias", -100, 100, "N m", "torque at any command"),
    Bound("plant.actuators.inertia", 1e-7, 1, "kg m2", "a rotor has some"),
    Bound("plant.actuators.coulomb", 0, 1e3, "N m", "dry friction opposes motion"),
    Bound("plant.actuators.viscous", 0, 1e3, "N m s/rad", "friction opposes motion"),
    Bound("plant.actuators.reaction_scale", 0, 100, "", "share of the cable's torque that the motor feels"),
    Bound("plant.brakes.holding_torque", 0, 1e4, "N m", "dry friction of a brake"),
    Bound("plant.brakes.engage_ticks", 0, _HOUR_MS, "ms", "from command to grip", whole=True),
    Bound("plant.brakes.release_ticks", 0, _HOUR_MS, "ms", "from command to free", whole=True),
    Bound("plant.cable_stiffness", 100, 1e8, "N/m", "an unbroken cable holds the arm at rest; break it by a fault"),
    Bound("plant.cable_damping", 0, 1e6, "N s/m", "damping takes energy"),
    Bound("plant.link_coulomb", 0, 1e3, "N m; insertion N", "dry friction opposes motion"),
    Bound("plant.link_viscous", 0, 1e3, "N m s/rad; insertion N s/m", "friction opposes motion"),
    *_per_joint("plant.stops.lower", _TURN, _TRAVEL, "hard stop of the joint"),
    *_per_joint("plant.stops.upper", _TURN, _TRAVEL, "hard stop of the joint"),
    Bound("plant.stops.stiffness", 0, 1e8, "N m/rad; insertion N/m", "a stop pushes back; 0: no stop"),
    Bound("plant.friction_scale", 0, 100, "", "times all friction, which opposes motion"),
    Bound("plant.cable_stiffness_scale", 0.05, 100, "", "times the stiffness of every cable; break one by a fault"),
    Bound("plant.motor_constant_scale", 0, 100, "", "times torque per count"),
    Bound("plant.mass_scale", 0.01, 100, "", "times masses and inertias of the links, which are positive"),
    Bound("plant.gravity", -100, 100, "m/s2", "component in frame 0"),
    Bound("plant.encoder_noise", 0, 1e4, "counts rms", "a standard deviation"),
    Bound("plant.torque_noise", 0, 100, "N m rms", "a standard deviation"),
    Bound("nominal.kp", 0, 1e6, "N m/rad; insertion N/m; jaws 1/s2", "the model is stable"),
    Bound("nominal.kd", 0, 1e6, "N m s/rad; insertion N s/m; jaws 1/s", "the model is stable"),
    Bound("nominal.ki", 0, 1e6, "N/(m s)", "the model is stable"),
    Bound("nominal.kv", 0, 1e6, "N m s/rad; insertion N s/m", "friction opposes motion"),
    Bound("nominal.kc", 0, 1e6, "N m; insertion N", "dry friction opposes motion"),
    Bound("nominal.mass_scale", 0.01, 100, "", "times masses and inertias of the model, which are positive"),
    Bound("nominal.resync", 0, 1, "", "1: the model goes where the robot is while the pedal is up", whole=True),
    *_per_joint("nominal.target.lower", _TURN, _TRAVEL, "soft limit of the joint"),
    *_per_joint("nominal.target.upper", _TURN, _TRAVEL, "soft limit of the joint"),
    Bound("haptics.cues.threshold_m", 0, 1, "m", "a distance; [haptics] threshold_mm is in mm"),
    Bound("haptics.cues.kp", 0, 1e9, "device units per m", "the cue pulls"),
    Bound("haptics.cues.kd", 0, 1e9, "device units per m/s", "the cue damps"),
    Bound("haptics.cues.cap", 0, 1e9, "device units", "largest force"),
    Bound("reaction.action", 0, 3, "", "0 none, 1 release, 2 slow, 3 correct", whole=True),
    Bound("reaction.delay_ms", 0, _HOUR_MS, "ms", "from the first felt pull to the action"),
    Bound("reaction.felt_force", 0, 1e9, "device units", "a weaker pull is not noticed"),
    Bound("reaction.slow_to", 0, 1, "", "speed of slowed hands, of what it was"),
    Bound("reaction.correct_per_s", 0, 1e3, "1/s", "share of the distance that is corrected"),
    Bound("reaction.correct_speed", 0, 10, "m/s", "of the tip, at most"),
    *(
        Bound(f"detectors.{joint}.{name}", 1e-9, 1e6, unit, "step of 1 ms that a score of 1 stands for")
        for joint, slide in (("shoulder", "rad"), ("elbow", "rad"), ("insertion", "m"))
        for name, unit in (("mpos", "rad"), ("mvel", "rad/s"), ("jpos", slide))
    ),
    Bound("detectors.armed_after", 0, _HOUR_MS, "ms", "before it no detector looks", whole=True),
    Bound("detectors.levels", 0, 1e9, "of the detector", "alarm above it"),
    Bound("monitor.moved", 0, 1, "m", "a distance"),
    Bound("monitor.jump_step", 0, 1, "m", "a distance"),
    Bound("monitor.large_jump", 0, 1, "m", "a distance"),
    Bound("monitor.diverged", 0, 1, "m", "a distance"),
    Bound("monitor.idle_share", 0, 1, "", "a share of the twin's step"),
    Bound("monitor.idle_step", 0, 1, "m", "a distance"),
)

RESERVED = {
    "plant.noise_key": "it is derived from each run's id, so that no two runs draw the same noise; "
    "set campaign.noise = true, and campaign.seed or repeats for other draws",
}
"""Parameters that a campaign must leave alone, and why."""


def plain(path: str) -> str:
    """A parameter's path without arm, number of a set, joint or axis."""
    parts = [part for part in paths.shorten(path).split(".") if not part.isdecimal()]
    return ".".join(parts[:-1] if parts[-1:] and parts[-1] in paths.COMPONENTS else parts)


def of(path: str) -> list[Bound]:
    """The rows that hold for `path`: one for a single number, more where it names a whole vector of unlike ones."""
    kind, last = plain(path), path.rpartition(".")[2]
    return [row for row in BOUNDS if row.path == kind and (last in row.joints or not row.joints or last not in JOINTS)]


def complaints(path: str, axis: Axis) -> Iterator[str]:
    """What is wrong with the values that a parameter would take; nothing for a path that the table does not know."""
    if plain(path) in RESERVED:
        yield f"cannot be set: {RESERVED[plain(path)]}"
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
