"""Estimates motor positions and velocities from encoder counts, and joints from motors.

raven2: state_estimate.cpp, fwd_cable_coupling.cpp. raven2 differentiates the raw counts. The fork
of raven2 from 2015 first filters them by a third-order Butterworth low-pass of 120 Hz.
"""

import numpy as np

from ravenjax.numbers import describe_fields, narrow_numbers, widen_numbers
from ravenjax.numbers.vec import Scalar, Vec, record, where
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.setup import ArmName, RavenSetup

RAD_PER_COUNT = 2.0 * stored.PI * (1.0 / transmission.ENCODER_COUNTS)

LOW_PASS_INPUT = (0.02864, 0.08591, 0.08591, 0.02864)
LOW_PASS_OUTPUT = (1.5189, -0.9600, 0.2120)
"""Butterworth low-pass, 120 Hz at 1 kHz: coefficients on x[k]..x[k-3] and on y[k-1]..y[k-3].

Source: raven2 state_estimate.cpp.
"""


@describe_fields
@record
class EstimatorParams:
    enc_offset: Vec  # 7, int32


@record
class EstimatorState:
    started: Scalar  # int32 flag; the first sample fills the history
    inputs: tuple[Vec, ...]  # unfiltered motor angles, rad, newest first; raven2: 1, fork: 3
    outputs: tuple[Vec, ...]  # filtered motor angles, rad, newest first; raven2: 0, fork: 3


def params() -> EstimatorParams:
    """Return the parameters of encoders whose count is 0 at motor angle 0."""
    return EstimatorParams(Vec.full(7, np.int32(0)))


def init(setup: RavenSetup) -> EstimatorState:
    """Return the state before the first sample."""
    zero = Vec.full(7, np.dtype(setup.precision.narrow).type(0.0))
    inputs, outputs = (1, 0) if setup.software == "raven2" else (3, 3)
    return EstimatorState(np.int32(0), (zero,) * inputs, (zero,) * outputs)


def step(
    setup: RavenSetup,
    arm: ArmName,
    tool: str,
    params: EstimatorParams,
    state: EstimatorState,
    enc_val: Vec,
) -> tuple[EstimatorState, Vec, Vec]:
    """Return the state after one sample of one arm, mpos (7, rad) and mvel (7, rad/s)."""
    counts = narrow_numbers(setup, enc_val) * transmission.encoder_signs(arm, tool, setup.software)
    offset = narrow_numbers(setup, params.enc_offset)
    angle = narrow_numbers(setup, RAD_PER_COUNT * widen_numbers(setup, counts - offset))
    started = state.started != 0
    # The first sample fills the histories.
    histories = [where(started, old, angle) for old in (*state.inputs, *state.outputs)]
    if setup.software == "raven2":
        (previous,) = histories
        state = EstimatorState(state.started | 1, (angle,), ())
        return state, angle, (angle - previous) / stored.PERIOD
    position = angle * LOW_PASS_INPUT[0]
    for gain, history in zip((*LOW_PASS_INPUT[1:], *LOW_PASS_OUTPUT), histories, strict=True):
        position = position + history * gain
    # histories: three inputs, then three outputs, each newest first. The oldest are dropped.
    velocity = (position - histories[3]) / stored.PERIOD
    inputs, outputs = (angle, *histories[:2]), (position, *histories[3:5])
    return EstimatorState(state.started | 1, inputs, outputs), position, velocity


def joint_positions(setup: RavenSetup, arm: ArmName, tool: str, mpos: Vec) -> Vec:
    """Return joint positions (rad, m) from motor positions (rad).

    As in raven2, products with a reciprocal ratio, and sums, have the wide type (double). Products
    of a coupling constant and a joint have the narrow type (float). Each joint is rounded once.
    """
    inverse_ratio = stored.TR.map(lambda ratio: 1.0 / ratio)
    jaw_per_wrist = stored.wrist_coupling(tool)
    signs = transmission.coupling_signs(arm, tool, setup.software)
    motor = widen_numbers(setup, mpos)
    insertion_motion = motor[2] / stored.GB_RATIO

    def rounded(value: Scalar) -> Scalar:
        return narrow_numbers(setup, value)

    def tool_joint(i: int) -> Scalar:
        # A sum needs one operation less than a product with the sign. `signs` has tool motors only.
        return inverse_ratio[i] * (
            motor[i] - insertion_motion if signs[i - 3] > 0 else motor[i] + insertion_motion
        )

    shoulder = rounded(inverse_ratio[0] * motor[0])
    elbow = rounded(inverse_ratio[1] * motor[1] - widen_numbers(setup, stored.C01 * shoulder))
    insertion = rounded(
        inverse_ratio[2] * motor[2]
        - widen_numbers(setup, stored.C02 * shoulder)
        - widen_numbers(setup, stored.C12 * elbow)
    )
    roll, wrist = rounded(tool_joint(3)), rounded(tool_joint(4))
    grasp1, grasp2 = tool_joint(5), tool_joint(6)
    if jaw_per_wrist:
        bend = widen_numbers(setup, jaw_per_wrist * wrist)
        grasp1, grasp2 = grasp1 - bend, grasp2 + bend
    return Vec((shoulder, elbow, insertion, roll, wrist, rounded(grasp1), rounded(grasp2)))


def joint_velocities(setup: RavenSetup, mvel: Vec) -> Vec:
    """Return joint velocities (rad/s, m/s); as in the original without coupling, 0 for tools."""
    zero = narrow_numbers(setup, 0.0)
    return Vec((*(mvel[i] / stored.TR[i] for i in range(3)), *(zero,) * 4))
