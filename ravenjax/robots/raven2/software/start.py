"""Where the control software starts: a state that stands at given encoder counts.

Homing is not simulated. The state at a pose is the one that the original has when it stood there in
E-stop: measured pose, desired pose and accumulators are one, so that the first pedal-down asks for
what is there. One number is set that the original might have otherwise: the accumulated jaw
opening, which it resets only where it is more than 45 deg off (raven2: local_io.cpp). After homing
in that place the two agree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.engines.cpu.memory import buffer
from ravenjax.engines.cpu.transition import Memory
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.code import TransitionCode
from ravenjax.robots.raven2.software.rows import InputRows
from ravenjax.robots.raven2.stages.estimator import RAD_PER_COUNT


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
    code: TransitionCode,
    params: control.ControlParams,
    state: control.ControlState,
    encoders: np.ndarray,
) -> control.ControlState:
    """`state`, but at rest where the encoders [arms, 7] say."""
    stopped = replace(
        state, state_machine=replace(state.state_machine, runlevel=np.int32(run_levels.E_STOP))
    )
    rows = InputRows(setup)
    rows.enter(None)
    rows.enc_val[0], rows.read_ok[0] = encoders, 1
    kinds = code.kinds
    memory = Memory(
        kinds["params"].row(params),
        kinds["state"].row(stopped),
        rows.bytes,
        buffer(1, kinds["signals"].layout.bytes),
    )
    code.machine.bind("cycle", memory)()
    after: control.ControlState = kinds["state"].read(memory.state)
    signals: control.ControlSignals = kinds["signals"].read(memory.leaving[0])
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
