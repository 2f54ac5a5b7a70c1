"""Computes a run of the Raven-II: its start, its ticks, and its outcomes.

This module implements the protocol `ravenjax.engines.interface.Loop`.
"""

from operator import attrgetter
from typing import Any

from ravenjax import resources
from ravenjax.faults import fault
from ravenjax.faults.injection import injects_faults
from ravenjax.numbers import Scalar, Vec, first_tick, jnp, replace, run_eagerly, where
from ravenjax.numbers.setup import cast_to_real, for_each_arm, widen_numbers
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.loop import control, observers, user_files
from ravenjax.robots.raven2.loop.injector import RavenInjector
from ravenjax.robots.raven2.loop.optional import find_stages
from ravenjax.robots.raven2.loop.records import (
    Input,
    NetworkParams,
    Start,
    TickParams,
    TickSignals,
    TickState,
    UsbParams,
)
from ravenjax.robots.raven2.loop.tick import advance_tick, motor_angles, separate_boards
from ravenjax.robots.raven2.plant import nominal, parameter_sets
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import PerArm, RavenSetup, map_arms
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import check, haptics, monitor
from ravenjax.stages.monitor import reference_from as reference_from
from ravenjax.stages.monitor import series_length as series_length
from ravenjax.vocabulary.checks import OWN
from ravenjax.vocabulary.reactions import RELEASE


def params(
    setup: RavenSetup,
    start_jpos: tuple[tuple[float, ...], ...],
    parameter_set: str = parameter_sets.DEFAULT,
) -> TickParams:
    """Return all parameters with their default values, for a run that starts at `start_jpos`.
    start_jpos: 7 joints per arm, rad and m. parameter_set: mechanics, one of `parameter_sets.Name`.
    """
    return TickParams(
        operator=operator.params(setup, start_jpos),
        network=NetworkParams(),
        usb=UsbParams(),
        control=control.params(setup),
        plc=plc.PlcParams(),
        plant=map_arms(setup, plant.params, for_each_arm(setup, parameter_set)),
        nominal=for_each_arm(setup, nominal.params(setup, parameter_set)),
        haptics=haptics.params(setup),
        stages={name: stage.params(setup) for name, stage in find_stages(setup).items()},
        # The default threshold of users' checks is 1.
        checks=user_files.check_params(setup, (1.0,) * len(setup.checks)),
        monitor=monitor.MonitorParams(),
        start=tuple(Vec(jpos) for jpos in start_jpos),
    )


def init(setup: RavenSetup, params: TickParams) -> TickState:
    """Return the state of a homed robot at rest at `params.start`, before the first tick."""
    runlevel = run_levels.PEDAL_UP if setup.software == "raven2" else run_levels.PEDAL_DOWN
    jpos = cast_to_real(setup, params.start)
    plants = map_arms(setup, plant.init, params.plant, jpos)
    robots = map_arms(setup, plant.observe_robot, params.plant, plants)
    tips = plant.true_tips(setup, params.plant, plants, robots)
    observers_state = observers.init(setup, jpos, tips)
    zero = jnp.int32(0)
    # The start of a run is a constant of the campaign, so it is computed now and not in the tick.
    with run_eagerly():
        software = control.init(setup, params.start, runlevel)
    stages = find_stages(setup)
    hands_may_move = injects_faults(setup, "hand") or any(
        stage.moves_hands for stage in stages.values()
    )
    start = Start(setup, params, jpos, tips, runlevel)
    return TickState(
        faults=fault.init(setup),
        control=software,
        boards=usb.UsbOut(for_each_arm(setup, Vec.full(7, zero)), for_each_arm(setup, zero)),
        commands=(for_each_arm(setup, Vec.full(7, zero)),) * setup.command_delay,
        plc=plc.init(setup, runlevel, separate_boards(setup)),
        plant=plants,
        enc_val=tuple(out.enc_val for out in robots),
        motors=motor_angles(setup, robots),
        **vars(observers_state),
        hands=operator.hands_on_plan(setup) if hands_may_move else operator.NO_OFFSETS,
        files=user_files.init(setup, params.checks, params.control.own),
        stages={name: stage.init(start) for name, stage in stages.items()},
        pedal_ticks=jnp.int32(-1),
        pedal_down_ticks=zero,
        packet=jnp.int32(-1),
        delivered=jnp.int32(-1),
    )


def outcomes(setup: RavenSetup, params: TickParams, state: TickState) -> dict[str, Scalar]:
    """Return the outcomes of the run so far: columns of the result table before the verdict."""
    out = fault.outcomes(state.faults) | check.outcomes(check_histories(setup, state))
    out |= haptics.outcomes(setup, state.haptics)
    machine = state.control.state_machine
    level = jnp.where(machine.soft_estopped != 0, run_levels.E_STOP, machine.runlevel)
    # A fault may write a number that is not a run level. The column is then -1.
    out["end_runlevel"] = jnp.where((level >= 0) & (level < len(run_levels.NAMES)), level, -1)
    out["pedal_down_ms"] = state.pedal_down_ticks
    for name, stage in find_stages(setup).items():
        out |= stage.outcomes(setup, state.stages[name])
    return out | monitor.outcomes(setup, state.monitor)


def measured_tips(setup: RavenSetup, signals: control.ControlSignals) -> PerArm[Vec]:
    """Return the measured tip of each arm, whole um."""
    return tuple(cast_to_real(setup, arm.pos.position_um) for arm in signals.arms)


def reference_series(setup: RavenSetup, signals: TickSignals) -> tuple[Scalar, ...]:
    """Return the tips of a tick of a golden run, with which its faulty runs are compared."""
    return monitor.reference_series(signals.tip, measured_tips(setup, signals.control))


def advance(
    setup, params: TickParams, faults: fault.Faults, state: TickState, now, motion, golden
) -> tuple[TickState, tuple[Scalar, ...], TickSignals]:
    """Compute tick `now`; return the new state, the `reference_series`, and all signals.
    golden: `reference_series` of the golden run in this tick.
    """
    inputs = Input(now, motion, reference_from(setup, golden))
    state, signals = advance_tick(setup, params, faults, state, inputs)
    return state, reference_series(setup, signals), signals


def check_histories(setup: RavenSetup, state: TickState) -> dict[str, check.CheckHistory]:
    """Return the history of each check over all arms, by the check's name in result columns."""
    user_checks = zip(setup.checks, state.files.histories, strict=True)
    out = {f"{OWN}{use.name}": history for use, history in user_checks}
    # `_CHECKS`: name -> path of a stage's state in `TickState`, and the history's field in it
    for name, (stage, field) in _CHECKS.items():
        stage_state = attrgetter(stage)(state)
        # The state of a stage is a tuple if the stage treats each arm separately.
        arms = stage_state if isinstance(stage_state, tuple) else (stage_state,)
        out[name] = check.worst_of_arms([getattr(arm, field) for arm in arms])
    return out


_CHECKS = resources.read_tables(__file__, "checks.toml")


def name_signals(setup: RavenSetup, signals: TickSignals) -> dict[str, Any]:
    """Return every signal by its name. Rotations of tips are added as quaternions (x, y, z, w), and
    as the nine numbers of the matrix, row by row.
    """
    out = dict(vars(signals))
    for name in ("pos", "pos_d"):  # measured and desired tip
        matrices = [getattr(arm, name).rotation for arm in signals.control.arms]
        out[f"{name}_quaternion"] = [quat_from_matrix(widen_numbers(setup, m)) for m in matrices]
        out[f"{name}_matrix"] = [[x for row in m for x in row] for m in matrices]
    return out


make_injector = RavenInjector
"""Makes the injector of a tick, as the protocol `ravenjax.engines.interface.Loop` requires."""

ACTIONS = ("pedal", "estop", "stop", "hold")
"""Names of the actions that `ravenjax deadline` tries; see `stages.acted`."""


def last_command(state: TickState) -> PerArm[Vec]:
    """Return the command on the boards, int32 counts."""
    return state.boards.current_cmd


def act(
    params: TickParams, state: TickState, tick, is_taken, begins, good_command: PerArm[Vec]
) -> tuple[TickParams, TickState]:
    """Return parameters and state of this tick with one of these actions:

    - `pedal`: the operator lifts the foot, as `console.reaction` does at a cue. The foot stays up.
    - `estop`: the PLC goes to E-stop and cannot be started again, as while the button is pressed.
    - `stop`: the overdrive check trips in this tick, whatever the command is.
    - `hold`: while the PLC is in pedal-down, the motors get the last good command.

    is_taken: {action: bool, whether the action has been taken, in this tick or before}. begins:
    bool, the action is taken in this tick. good_command: command of the boards before the fault.
    """
    operator_params, operator_state = params.stages["reaction"], state.stages["reaction"]
    lifts_foot = is_taken["pedal"]
    holds = is_taken["hold"] & (state.plc.runlevel == run_levels.PEDAL_DOWN)
    # The operator acts as if a cue were felt in this tick.
    felt = first_tick(tick, lifts_foot, operator_state.felt)
    # With a delay of one tick, set below, the motors follow the last tick's command, replaced here.
    last_tick, *earlier = state.commands
    state = replace(
        state,
        commands=(where(holds, good_command, last_tick), *earlier),
        stages={**state.stages, "reaction": replace(operator_state, felt=felt)},
    )
    # The limit -1 makes the overdrive check trip at every command, and the PLC's watchdog trip at
    # every time since the pin's last edge.
    overdrive_params, watchdog = params.control.overdrive, params.plc.watchdog_ticks
    limit = jnp.where(is_taken["stop"] & begins, -1, overdrive_params.max_inst_dac)
    operator_params = replace(
        operator_params,
        action=jnp.where(lifts_foot, RELEASE, operator_params.action),
        delay_ms=jnp.where(lifts_foot, 0.0, operator_params.delay_ms),
    )
    params = replace(
        params,
        stages={**params.stages, "reaction": operator_params},
        control=replace(params.control, overdrive=replace(overdrive_params, max_inst_dac=limit)),
        plc=replace(params.plc, watchdog_ticks=jnp.where(is_taken["estop"], -1, watchdog)),
        usb=replace(params.usb, command_delay=jnp.where(holds, 1, params.usb.command_delay)),
    )
    return params, state
