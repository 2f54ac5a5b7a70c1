"""Computes the haptic cue: a spring-damper force towards the nominal model.

The published rule (Raven-II surgical training simulator, Eq. 5) is interpreted as follows. With e =
p_model - p_robot, d = e/|e| and v the velocities of the tips:

    |e| >  threshold:  force = min(cap, max(0, kp |e| + kd (v_model - v_robot) . d))
    |e| <= threshold:  force = 0

The printed equation has two cases, but gives a condition only for the case in which the force is
the constant 0.05. Figure 5 of the paper shows which interpretation is right. It shows single pulses
of different height (0.013 to 0.030 device units) at tip errors of 3.3 to 5 mm, nothing below 3 mm,
and one pulse flat at 0.0500. The force is thus proportional above the threshold, and 0.05 is its
upper limit. The cue only pulls towards the model, so the force is never negative.

Several (threshold, kp, kd, cap) sets are evaluated in the same run (`Setup.cues`). With an operator
who does not react, the motion is the same for all sets.
"""

from ravenjax.numbers import Setup, describe_fields, jnp
from ravenjax.numbers.algebra import dot, norm
from ravenjax.numbers.vec import Scalar, Vec, as_int, earliest_tick, first_tick, largest, record
from ravenjax.outcomes.verdict import PUBLISHED_CUE_MM

# m; below it e has no direction. It is far below one micrometre, so it affects no cue
TINY_M = 1e-12


@record
class CueParams:
    """Threshold, gains and cap of one cue."""

    threshold_m: Scalar  # m
    kp: Scalar  # device units per m
    kd: Scalar  # device units per m/s
    cap: Scalar  # device units


@describe_fields
@record
class HapticParams:
    cues: tuple[CueParams, ...]


@record
class CueState:
    """The forces of one cue so far."""

    first_tick: Scalar  # tick of the first non-zero force, -1 if none yet, int32
    peak_force: Scalar  # device units
    ticks_active: Scalar  # ticks with force > 0, int32
    impulses: Scalar  # number of separate cues: rises of the force from zero, int32
    active: Scalar  # force > 0 at the last tick, int32 0 or 1


@record
class HapticState:
    tick: Scalar  # ticks seen, int32
    cues: tuple[CueState, ...]


@record
class HapticOutput:
    error: Vec  # m, e = p_model - p_robot
    distance: Scalar  # m, |e|
    direction: Vec  # unit vector d, zero where e is
    force: Vec  # device units along `direction`, one force per cue


def params(setup: Setup) -> HapticParams:
    """Return the parameters of the published cue, `setup.cues` times.

    The threshold of 3 mm and the cap of 0.05 are published. kp is 4.5 per m, because Figure 5 shows
    about 0.0045 per mm. kd is not published. Figure 5 has a third pulse of 0.0296 at 5.0 mm, of
    which the spring contributes 0.0225. In this pulse the shoulder turns by 6.7 degrees in 150 ms.
    The tip, 0.1 m from the shoulder's axis, moves at about 80 mm/s. This gives kd = 0.09 per m/s.
    """
    cue = CueParams(threshold_m=PUBLISHED_CUE_MM / 1e3, kp=4.5, kd=0.09, cap=0.05)
    return HapticParams(cues=(cue,) * setup.cues)


def init(setup: Setup) -> HapticState:
    """Return the state before the first tick."""
    zero = jnp.int32(0)
    cue = CueState(
        first_tick=jnp.int32(-1),
        peak_force=jnp.asarray(0.0, setup.precision.real),
        ticks_active=zero,
        impulses=zero,
        active=zero,
    )
    return HapticState(tick=zero, cues=(cue,) * setup.cues)


def cue_force(cue: CueParams, distance: Scalar, closing_speed: Scalar) -> Scalar:
    """Return the force of one cue (device units) for |e| [m] and (v_model - v_robot) . d [m/s]."""
    pull = cue.kp * distance + cue.kd * closing_speed
    # A pull that is NaN, as from a joint velocity with flipped bits, gives no force
    return jnp.where((distance > cue.threshold_m) & (pull > 0.0), jnp.minimum(pull, cue.cap), 0.0)


def step(
    params: HapticParams,
    state: HapticState,
    model_position: Vec,
    model_velocity: Vec,
    robot_position: Vec,
    robot_velocity: Vec,
) -> tuple[HapticState, HapticOutput]:
    """Compute one tick of one arm: return the state after the tick, and the force of each cue.
    Positions (m) and velocities (m/s) are in frame 0 of the arm.
    """
    error = model_position - robot_position
    distance = norm(error)
    # The direction of a tiny error is zero.
    inverse_distance = jnp.where(distance > TINY_M, 1.0 / jnp.maximum(distance, TINY_M), 0.0)
    direction = error * inverse_distance
    closing_speed = dot(model_velocity - robot_velocity, direction)

    forces, cues = [], []
    for cue, before in zip(params.cues, state.cues, strict=True):
        force = cue_force(cue, distance, closing_speed)
        active = as_int(force > 0.0)
        forces.append(force)
        cues.append(
            CueState(
                first_tick=first_tick(state.tick, active == 1, before.first_tick),
                peak_force=jnp.maximum(before.peak_force, force),
                ticks_active=before.ticks_active + active,
                impulses=before.impulses + active * (1 - before.active),
                active=active,
            )
        )
    out = HapticOutput(error, distance, direction, Vec(forces))
    return HapticState(state.tick + 1, tuple(cues)), out


def outcomes(setup: Setup, arms: tuple[HapticState, ...]) -> dict[str, Scalar]:
    """Return the outcome columns of each cue: of all arms, the earliest start (ms), the largest
    force (device units), the longest time of force (ms) and the largest number of separate cues.
    """
    columns = {}
    for k in range(setup.cues):
        cues = [arm.cues[k] for arm in arms]
        columns[f"cue{k}_first_ms"] = earliest_tick([cue.first_tick for cue in cues])
        columns[f"cue{k}_peak_force"] = largest(cue.peak_force for cue in cues)
        columns[f"cue{k}_ms"] = largest(cue.ticks_active for cue in cues)
        columns[f"cue{k}_count"] = largest(cue.impulses for cue in cues)
    return columns
