"""Start state of the control software at given encoder counts.

Homing is not simulated. The state at a pose is that of the original after an E-stop in that pose:
measured pose, desired pose and accumulators are equal. The first pedal-down therefore commands the
present pose. One number may differ from the original's: the accumulated jaw opening, which the
original resets only if it is more than 45 deg off (raven2: local_io.cpp). After homing in that pose
the two agree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.estimator import RAD_PER_COUNT


def encoders_at(
    setup: RavenSetup, params: control.ControlParams, jpos: Sequence[Sequence[float]]
) -> list[list[int]]:
    """Return the counts [arms, 7] nearest to joints [arms, 7], rad and m."""

    counts = []
    for arm, tool, estimator, joints in zip(
        setup.arms, setup.tools, params.estimator, jpos, strict=True
    ):
        motors = transmission.motor_from_joint(arm, tool, Vec(joints), software=setup.software)
        signs = transmission.encoder_signs(arm, tool, setup.software)
        counts.append(
            [
                round(float(sign) * (float(motor) / float(RAD_PER_COUNT) + int(offset)))
                for motor, sign, offset in zip(motors, signs, estimator.enc_offset, strict=True)
            ]
        )
    return counts


def in_e_stop(state: control.ControlState) -> control.ControlState:
    """Return the same state in E-stop."""
    machine = replace(state.state_machine, runlevel=np.int32(run_levels.E_STOP))
    return replace(state, state_machine=machine)


def standing(
    state: control.ControlState, after: control.ControlState, signals: control.ControlSignals
) -> control.ControlState:
    """Return `state` with the arms at rest where they were measured in one cycle in E-stop.

    after, signals: state and signals after that cycle.
    """
    places = [arm.pos for arm in after.cartesian]
    return replace(
        state,
        usb=after.usb,
        cartesian=tuple(
            replace(arm, pos=place, pos_d=place, jpos_d=measured.jpos)
            for arm, place, measured in zip(state.cartesian, places, signals.arms, strict=True)
        ),
        teleoperation=replace(
            state.teleoperation,
            arms=tuple(
                replace(arm, pose=place)
                for arm, place in zip(after.teleoperation.arms, places, strict=True)
            ),
        ),
        motor_control=tuple(
            replace(arm, mpos_d=measured.mpos)
            for arm, measured in zip(state.motor_control, signals.arms, strict=True)
        ),
    )
