"""Where the control software starts: a state that stands at given encoder counts, or one that was
saved.

Homing is not simulated. The state at a pose is the one that the original has when it stood there in
E-stop: measured pose, desired pose and accumulators are one, so that the first pedal-down asks for
what is there. One number is set that the original might have otherwise: the accumulated jaw
opening, which it resets only where it is more than 45 deg off (raven2: local_io.cpp). After homing
in that place the two agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.record_kind import RecordKind
from ravenjax.errors import UserError, shown
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software import inputs as given_inputs
from ravenjax.robots.raven2.software.code import SoftwareCode
from ravenjax.robots.raven2.software.rows import InputRows
from ravenjax.robots.raven2.stages.estimator import RAD_PER_COUNT


def one_of(**starts: Any) -> str | None:
    """Which of the ways to start is given; None: the home pose."""
    names = [name for name, value in starts.items() if value is not None]
    if len(names) > 1:
        raise UserError(
            f"{' and '.join(names)} are given, expected one of {', '.join(starts)}; leave the"
            " others out"
        )
    return names[0] if names else None


def encoders_at(
    setup: RavenSetup, params: control.ControlParams, jpos: Sequence[Sequence[float]]
) -> list[list[int]]:
    """The counts [arms, 7] nearest to joints [arms, 7], rad and m."""

    def of_arm(arm: ArmName, tool: str, offsets: Vec, joints: Sequence[float]) -> list[int]:
        motors = transmission.motor_from_joint(arm, tool, Vec(joints), software=setup.software)
        signs = transmission.encoder_signs(arm, tool, setup.software)
        numbers = zip(motors, signs, offsets, strict=True)
        return [
            round(float(sign) * (float(m) / float(RAD_PER_COUNT) + int(offset)))
            for m, sign, offset in numbers
        ]

    offsets = [estimator.enc_offset for estimator in params.estimator]
    return [of_arm(*each) for each in zip(setup.arms, setup.tools, offsets, jpos, strict=True)]


def at_encoders(
    setup: RavenSetup,
    code: SoftwareCode,
    states: RecordKind,
    fixed: np.ndarray,
    state: control.ControlState,
    encoders: Sequence[Sequence[int]],
) -> control.ControlState:
    """`state`, but at rest where the encoders [arms, 7] say."""
    stopped = replace(
        state, state_machine=replace(state.state_machine, runlevel=np.int32(run_levels.E_STOP))
    )
    rows = InputRows(setup)
    rows.silence()
    rows.enc_val[0], rows.read_ok[0] = encoders, 1
    memory = transition.Memory(
        fixed, states.row(stopped), rows.bytes, transition.rows(code.signals.layout, 1)
    )
    code.machine.bind("cycle", memory)()
    after: control.ControlState = states.read(memory.state)
    signals: control.ControlSignals = code.signals.read(memory.leaving[0])
    arms = tuple(zip(after.cartesian, after.teleoperation.arms, signals.arms, strict=True))
    return replace(
        state,
        usb=after.usb,
        cartesian=tuple(
            replace(old, pos=there.pos, pos_d=there.pos, jpos_d=measured.jpos)
            for old, (there, _, measured) in zip(state.cartesian, arms, strict=True)
        ),
        teleoperation=replace(
            state.teleoperation,
            arms=tuple(replace(accumulator, pose=there.pos) for there, accumulator, _ in arms),
        ),
        motor_control=tuple(
            replace(old, mpos_d=measured.mpos)
            for old, (*_, measured) in zip(state.motor_control, arms, strict=True)
        ),
    )


def saved(states: RecordKind, given: Any) -> control.ControlState:
    """A state that somebody kept, its numbers checked and in their own types."""
    leaves, tree = jax.tree_util.tree_flatten_with_path(given)
    if not isinstance(given, control.ControlState) or tree != states.tree:
        raise UserError(
            f"state is {shown(given)}, expected the `state` of a ControlSoftware of the same"
            " software, arms and console"
        )
    numbers = [
        _number(f"state{jax.tree_util.keystr(path)}", dtype, x)
        for (path, x), dtype in zip(leaves, states.types, strict=True)
    ]
    return jax.tree.unflatten(states.tree, numbers)


def _number(what: str, dtype: str, given: Any) -> Any:
    if not dtype.startswith("float"):
        return np.int32(given_inputs.whole(what, given, *given_inputs.INT32))
    number = isinstance(given, int | float | np.number) and not isinstance(given, bool)
    if not number:
        raise UserError(f"{what} is {shown(given)}, expected a number")
    return np.dtype(dtype).type(given)
