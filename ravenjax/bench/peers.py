"""MuJoCo's own ways to step the same arm: rigid bodies alone, without motors, cables, control
software, faults or cue.

Joint limits and contacts are off, which spares both the constraint solver: the least work that they
can do.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import copy
import dataclasses

import mujoco
import numpy as np

from ravenjax.bench import clock, machine
from ravenjax.bench.clock import WorkTiming
from ravenjax.robots.raven2.dynamics import arm_model

STEP_S = 1e-3
"""s, step of the simulation: that of the tick."""
ROBOTS, ROLLOUT_STEPS, EULER_STEPS, MJX_STEPS = 1024, 200, 20_000, 20


@dataclasses.dataclass(frozen=True)
class Peer:
    """How fast something else steps the arm."""

    name: str
    device: str
    robots: int
    steps: int  # of each robot
    compile_s: float  # s; 0: nothing is compiled
    timing: WorkTiming

    @property
    def steps_per_s(self) -> float:
        """Steps of one arm, all robots together."""
        return self.robots * self.steps / self.timing.best_s


def arm() -> mujoco.MjModel:
    """The gold arm alone."""
    model = copy.copy(arm_model.one_arm("gold"))
    model.opt.timestep = STEP_S
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def rollout(
    seconds: float, threads: int | None = None, robots: int = ROBOTS, steps: int = ROLLOUT_STEPS
) -> Peer:
    """C MuJoCo's `mujoco.rollout` with so many threads, or with one for each CPU; for about so
    long.
    """
    from mujoco import rollout as module

    threads = threads or machine.usable_cpus()
    model, kind = arm(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data = [mujoco.MjData(model) for _ in range(threads)]
    initial = np.zeros((robots, mujoco.mj_stateSize(model, kind)))
    mujoco.mj_getState(model, data[0], initial[0], kind)
    initial[:] = initial[0]
    with module.Rollout(nthread=threads) as pool:
        timing = clock.timed(
            lambda: pool.rollout(model, data, initial, nstep=steps), clock.REPEATS, seconds
        )
    return Peer("mujoco.rollout", f"CPU, {threads} threads", robots, steps, 0.0, timing)


PUBLISHED_EULER_S = 0.011e-3
"""s of one Euler step of the published model on one core, the authors' C++; DSN 2016, Figure 8."""


def published_model(seconds: float, steps: int = EULER_STEPS) -> Peer:
    """The published three-joint model of one robot, explicit Euler at 1 ms as printed, in
    float64, on one core.
    """
    import jax
    import jax.numpy as jnp

    from ravenjax.numbers.vec import Vec
    from ravenjax.robots.raven2.plant import authors

    def advance(start: authors.AuthorsState) -> authors.AuthorsState:
        command = Vec.full(3, jnp.float64(0.0))
        return jax.lax.fori_loop(
            0, steps, lambda _, now: authors.euler(now, command, tension_bug=True), start
        )

    with jax.enable_x64(True), jax.default_device(jax.devices("cpu")[0]):
        rest = authors.initial(
            Vec(jnp.float64(m) for m in (50.0, 100.0, 800.0)), Vec.full(3, jnp.float64(0.0))
        )
        with clock.xla_compiling() as compiling:
            compiled = jax.jit(advance).lower(rest).compile()
        timing = clock.timed(lambda: jax.block_until_ready(compiled(rest)), clock.REPEATS, seconds)
    return Peer("published 3-joint Euler model", "CPU, 1 core", 1, steps, sum(compiling), timing)


def mjx_step(seconds: float, robots: int = ROBOTS, steps: int = MJX_STEPS) -> Peer:
    """MJX: `jax.vmap(mjx.step)`, the loop over steps inside `jit`."""
    import jax
    import jax.numpy as jnp

    from ravenjax.robots.raven2.dynamics.mjx_dynamics import mjx

    model = mjx.put_model(arm())
    one = mjx.make_data(model)
    many = jax.vmap(lambda number: one.replace(qvel=one.qvel + 1e-6 * number))(jnp.arange(robots))

    def advance(data: mjx.Data) -> mjx.Data:
        return jax.lax.fori_loop(
            0, steps, lambda _, now: jax.vmap(mjx.step, in_axes=(None, 0))(model, now), data
        )

    with clock.xla_compiling() as compiling:
        compiled = jax.jit(advance).lower(many).compile()
    timing = clock.timed(lambda: jax.block_until_ready(compiled(many)), clock.REPEATS, seconds)
    return Peer(
        "jax.vmap(mjx.step)",
        str(jax.devices()[0].device_kind),
        robots,
        steps,
        sum(compiling),
        timing,
    )
