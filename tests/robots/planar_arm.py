"""A planar arm of two joints with one check: a robot that this package does not know."""

from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np

from ravenjax.campaign.prepared import Prepared
from ravenjax.faults import fault
from ravenjax.faults.injection import Injector, channel_paths
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.setup import Setup as AnySetup
from ravenjax.numbers.setup import cast_to_real
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace, where
from ravenjax.stages import check, haptics, monitor
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import ARM, Channel, Site

JOINTS, LINK_M = ("shoulder", "elbow"), 0.3


def _site(name: str, layer: str, unit: str, where: str) -> Site:
    return Site(
        name,
        layer,
        True,
        tuple(Channel(j, (ARM, i), "float", unit) for i, j in enumerate(JOINTS)),
        where,
    )


ROBOT = Robot(
    name=__name__,
    title="planar arm",
    package=__name__,
    arms=("arm",),
    joints=JOINTS,
    linear=(),
    sites={
        "encoder": _site("encoder", "L1", "rad", "joint angles as the controller reads them"),
        "torque": _site("torque", "L2", "N m", "torques, after the check"),
    },
    layers={"L1": "encoders", "L2": "motors"},
    checks={"torque_limit": Check("torque_limit", "N m", "torque beyond its limit, stops", "stop")},
    run_levels=("stopped", "running"),
    live="the check has not stopped the arm",
)


class Setup(AnySetup):
    joints = JOINTS


@record
class Params:
    """What a campaign may vary."""

    kp: Annotated[Scalar, Quantity("N m/rad", 0, 1e3, "gain of position")]
    kd: Annotated[Scalar, Quantity("N m s/rad", 0, 1e3, "gain of velocity")]
    inertia: Annotated[Scalar, Quantity("kg m^2", 1e-3, 1e3, "inertia of each joint")]
    torque_max: Annotated[Scalar, Quantity("N m", 0, 1e3, "limit of the check")]
    haptics: haptics.HapticParams
    monitor: monitor.MonitorParams


@record
class State:
    """What is remembered from one tick to the next."""

    faults: fault.FaultState
    jpos: Vec  # rad
    jvel: Vec  # rad/s
    stopped: Scalar  # bool
    limit: check.CheckHistory
    haptics: haptics.HapticState
    monitor: monitor.MonitorState
    live: Scalar  # int32 ticks


def tip_of(jpos: Any) -> Vec:
    """Where the tip is, m."""
    a, b = jpos[0], jpos[0] + jpos[1]
    return Vec((LINK_M * (jnp.cos(a) + jnp.cos(b)), LINK_M * (jnp.sin(a) + jnp.sin(b)), 0.0 * a))


def init(setup: Setup, params: Params) -> State:
    """At rest, stretched out to the side."""
    jpos = cast_to_real(setup, Vec((0.0, 1.0)))
    zero, tip = jnp.int32(0), tip_of(jpos)
    watch = monitor.init(setup, (tip,), (tip * 1e6,))
    cue = haptics.init(setup, params.haptics)
    return State(
        fault.init(setup), jpos, jpos * 0.0, jnp.bool_(False), check.init(setup), cue, watch, zero
    )


def advance(setup, params, faults, state, now, motion, golden):
    """One millisecond: sense, control, check, move, watch."""
    clock = fault.TriggerClocks(now, now + 1, now)
    inject = Injector(
        setup,
        channel_paths(ROBOT, setup),
        faults,
        fault.open_windows(setup, faults, state.faults, clock),
        clock,
    )
    wanted = Vec(cast_to_real(setup, column[now]) for column in motion)
    (reported,) = inject("encoder", (state.jpos,))
    torque = (wanted - reported) * params.kp - state.jvel * params.kd
    largest = jnp.maximum(jnp.abs(torque[0]), jnp.abs(torque[1]))
    over = (largest > params.torque_max) & ~state.stopped
    stopped = state.stopped | over
    limit = check.update_check(state.limit, now, over, params.torque_max - largest)
    (driven,) = inject("torque", (where(stopped, torque * 0.0, torque),))
    jvel = where(stopped, state.jvel * 0.9, state.jvel) + driven * (1e-3 / params.inertia)
    jpos = state.jpos + jvel * 1e-3
    tip, seen, model = tip_of(jpos), tip_of(reported), tip_of(wanted)
    still = model * 0.0
    cue, pull = haptics.step(
        setup, params.haptics, state.haptics, haptics.HapticSignal(model, still, seen, still)
    )
    never, always = jnp.asarray(jnp.inf, setup.precision.real), jnp.bool_(True)
    still = (Vec((0, 0)),)
    watched = monitor.MonitorSignal(
        (tip,), (seen * 1e6,), (model,), (-never,), never, still, always, ~stopped, always, now
    )
    reference = monitor.Reference((Vec(golden[:3]),), (Vec(golden[3:]),))
    watch = monitor.step(setup, params.monitor, state.monitor, watched, reference)
    live = state.live + as_int(~stopped)
    new = State(inject.state, jpos, jvel, stopped, limit, cue, watch, live)
    places = {"tip": tip, "position": seen, "model_position": model}
    signals = {
        "jpos": reported,
        "tau_d": driven,
        "cue_force": pull.force,
        "runlevel": as_int(~stopped),
        **places,
    }
    return new, (*tip, *(seen * 1e6)), signals


def series_length(setup: Setup) -> int:
    """Numbers that a run is compared by."""
    return 6


def outcomes(setup: Setup, params: Params, state: State) -> dict[str, Scalar]:
    """Columns of the result table."""
    own = {"end_runlevel": as_int(~state.stopped), "pedal_down_ms": state.live}
    own |= fault.outcomes(state.faults) | check.outcomes({"torque_limit": state.limit})
    return own | haptics.outcomes(setup, (state.haptics,)) | monitor.outcomes(setup, state.monitor)


def prepare(config, varied, injection, precision) -> Prepared:
    """What a campaign asks of the arm."""
    setup = Setup(
        config.campaign.arms, precision, injection=injection, cues=len(config.haptics.cues())
    )
    cues = tuple(haptics.CueParams(c.threshold_m, c.kp, c.kd, c.cap) for c in config.haptics.cues())
    watch = replace(monitor.MonitorParams(), limit=config.outcomes.limit_mm / 1e3)
    time_s = np.arange(config.campaign.ticks) / 1e3
    columns = (
        np.sin(time_s).astype(np.float32) * 0.4,
        (1.0 + 0.3 * np.sin(2 * time_s)).astype(np.float32),
    )
    return Prepared(
        ROBOT.part("loop"),
        setup,
        Params(40.0, 2.0, 0.05, 8.0, haptics.HapticParams(cues), watch),
        columns,
    )


def series(setup: Setup, signals: dict[str, Any], golden: np.ndarray) -> dict[str, np.ndarray]:
    """Time series of a run."""
    arm = {
        name: np.stack(values, axis=-1)
        for name, values in signals.items()
        if isinstance(values, tuple)
    }
    arm["golden_tip"] = golden[:, :3]
    return {"runlevel": signals["runlevel"]} | {
        f"arm/{name}": values for name, values in arm.items()
    }
