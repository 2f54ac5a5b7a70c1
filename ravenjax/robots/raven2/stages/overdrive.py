"""Overdrive detection: the only check on the DAC commands (raven2: overdrive_detect.cpp).

The check goes through arms and joints in order, except for the joint grasp2, and compares the size
of each command with two limits. A command above the instant limit (`MAX_INST_DAC`) becomes 0, and
the soft E-stop is raised. The other joints' commands are still written in that cycle. The limit of
each joint (`LEVELS`) is lower than the instant limit. In raven2, a policy decides what happens to a
command between these two limits in the run levels 1 to 3:

- no_regulation: nothing.
- soft_regulation: the command is clipped to the joint's limit.
- hard_regulation: one counter for all joints and arms counts the command. If the counter was above
  `HARD_SAMPLES` before, the command becomes 0, the soft E-stop is raised, and the counter restarts.
  A command above the instant limit resets the counter.

The fork of 2015 has no policies: it clips at every run level.
"""

from functools import reduce
from operator import or_

import numpy as np

from ravenjax import resources
from ravenjax.numbers import cast_to_real, describe_fields, jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace
from ravenjax.robots.raven2.setup import PerArm, RavenSetup
from ravenjax.stages import check

SOFT_REGULATION, HARD_REGULATION = 1, 2
POLICIES = ("no_regulation", "soft_regulation", "hard_regulation")
"""Names of the policies, by number; raven2: defines.h."""

LEVELS: dict[str, list[int]] = resources.read_tables(__file__, "overdrive.toml")
"""DAC counts per joint, by safety level; raven2 and the 2015 fork: defines.h, init.cpp."""

MAX_INST_DAC = {"raven2": 20000, "fork2015": 12000}
"""Instant limit in DAC counts; raven2: defines.h."""

HARD_SAMPLES = 10
"""A sample over the limit trips if the counter is above this; raven2: overdrive_detect.cpp."""

CHECKED_JOINTS = 6


@describe_fields
@record
class OverdriveParams:
    policy: Scalar  # int32; unused by the 2015 fork
    dac_max: Vec  # 7, int32; the limit of grasp2 is unused, as in the original
    max_inst_dac: Scalar  # int32


@record
class OverdriveState:
    counter: Scalar  # int32, samples over the limit, one counter for all joints and arms
    instant: check.CheckHistory  # margin: counts below the instant limit
    # trips in a tick that clips a command; margin: counts below the joint limit
    clip: check.CheckHistory
    hard: check.CheckHistory  # trips by the shared counter; margin: samples left


def params(
    setup: RavenSetup, level: str | None = None, policy: int = SOFT_REGULATION
) -> OverdriveParams:
    """Return the limits of a safety level; None: "moderate" for raven2, "fork2015" for the fork."""
    level = level or ("moderate" if setup.software == "raven2" else "fork2015")
    limits = Vec(np.int32(limit) for limit in LEVELS[level])
    return OverdriveParams(np.int32(policy), limits, np.int32(MAX_INST_DAC[setup.software]))


def init(setup: RavenSetup) -> OverdriveState:
    """Return the state before the first tick."""
    return OverdriveState(np.int32(0), *(check.init(setup),) * 3)


def step(
    setup: RavenSetup,
    params: OverdriveParams,
    state: OverdriveState,
    tick: Scalar,
    runlevel: Scalar,
    current_cmd: PerArm[Vec],
) -> tuple[OverdriveState, PerArm[Vec], Scalar]:
    """Return the state, the commands to write, and whether to raise the soft E-stop."""
    fork = setup.software == "fork2015"
    # The fork clips at every run level, so the condition is true for all numbers.
    regulated = (runlevel == runlevel) if fork else (runlevel >= 1)
    soft = regulated if fork else regulated & (params.policy == SOFT_REGULATION)
    hard = None if fork else regulated & (params.policy == HARD_REGULATION)
    counter = state.counter
    instants, clips, trips, magnitudes, margins, checked = [], [], [], [], [], []
    for commands in current_cmd:
        joints = []
        for command, limit in zip(
            commands[:CHECKED_JOINTS], params.dac_max[:CHECKED_JOINTS], strict=True
        ):
            magnitude = jnp.abs(command)
            instant = magnitude > params.max_inst_dac
            over = (magnitude > limit) & ~instant
            clip = over & soft
            zeroed = instant
            if hard is not None:
                counter, trip = _count_sample(counter, instant, over & regulated, hard)
                zeroed = zeroed | trip
                trips.append(trip)
            clipped = jnp.where(clip, jnp.where(command > 0, limit, -limit), command)
            joints.append(jnp.where(zeroed, 0, clipped))
            instants.append(instant)
            clips.append(clip)
            magnitudes.append(magnitude)
            margins.append(limit - magnitude)
        checked.append(Vec((*joints, *commands[CHECKED_JOINTS:])))
    instant_trip, margin = reduce(or_, instants), cast_to_real(setup, reduce(jnp.minimum, margins))
    instant_margin = cast_to_real(setup, params.max_inst_dac - reduce(jnp.maximum, magnitudes))
    state = OverdriveState(
        counter,
        check.update_check(state.instant, tick, instant_trip, instant_margin),
        check.update_check(
            state.clip, tick, reduce(or_, clips), jnp.where(regulated, margin, np.inf)
        ),
        state.hard,
    )
    if hard is None:
        return state, tuple(checked), instant_trip
    hard_trip = reduce(or_, trips)
    samples_left = jnp.where(hard, cast_to_real(setup, HARD_SAMPLES + 1 - counter), np.inf)
    state = replace(state, hard=check.update_check(state.hard, tick, hard_trip, samples_left))
    return state, tuple(checked), instant_trip | hard_trip


def _count_sample(
    counter: Scalar, instant: Scalar, over: Scalar, hard: Scalar
) -> tuple[Scalar, Scalar]:
    """Return the shared counter after the sample of one joint, and whether the sample trips.
    instant, over: bool, the command is above the instant limit, or only above the joint's limit.
    hard: bool, the policy is hard_regulation. Without it, a sample over the limit resets the count.
    """
    counts = over & hard
    trip = counts & (counter > HARD_SAMPLES)
    # A sample that trips is also the first of the next count, so it sets the counter to 1.
    resets = instant | trip | (over & ~hard)
    return jnp.where(resets, 0, counter) + as_int(counts), trip
