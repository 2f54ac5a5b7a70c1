"""MuJoCo's own ways to step the same arm: rigid bodies alone, without motors, cables, control
software, faults or cue.

Joint limits and contacts are off, which spares both the constraint solver: the least work that they
can do.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import copy
import functools
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from bench import machine, workload
from ravenjax.robots.raven2.dynamics import arm_model

STEP_S = 1e-3
"""s, step of the simulation: that of the tick."""
PUBLISHED = "published model, target A2: at most 11 us"
"""The authors' C++ takes 11 us for an Euler step on one core; DSN 2016, Figure 8."""


def make_arm() -> mujoco.MjModel:
    """The gold arm alone."""
    model = copy.copy(arm_model.one_arm("gold"))
    model.opt.timestep = STEP_S
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def measure_rollout(seconds: float, robots: int = 1024, steps: int = 200) -> list[dict[str, Any]]:
    """C MuJoCo's `mujoco.rollout` with one thread for each CPU; for about so long."""
    from mujoco import rollout

    threads = machine.count_usable_cpus()
    model, kind = make_arm(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data = [mujoco.MjData(model) for _ in range(threads)]
    initial = np.zeros((robots, mujoco.mj_stateSize(model, kind)))
    mujoco.mj_getState(model, data[0], initial[0], kind)
    initial[:] = initial[0]
    with rollout.Rollout(nthread=threads) as pool:
        work = functools.partial(pool.rollout, model, data, initial, nstep=steps)
        return _measure("mujoco.rollout", f"{threads} threads", 0.0, robots * steps, work, seconds)


def measure_published_model(seconds: float, steps: int = 20_000) -> list[dict[str, Any]]:
    """The published three-joint model of one robot, explicit Euler at 1 ms as printed, in
    float64, on one core.
    """
    import jax
    import jax.numpy as jnp

    from ravenjax.numbers.vec import Vec
    from studies.dsn16 import authors

    def advance(start: authors.AuthorsState) -> authors.AuthorsState:
        command = Vec.full(3, jnp.float64(0.0))
        return jax.lax.fori_loop(
            0, steps, lambda _, now: authors.euler(now, command, tension_bug=True), start
        )

    with jax.enable_x64(True), jax.default_device(jax.devices("cpu")[0]):
        rest = authors.initial(
            Vec(jnp.float64(m) for m in (50.0, 100.0, 800.0)), Vec.full(3, jnp.float64(0.0))
        )
        return _measure_jax(PUBLISHED, steps, advance, rest, seconds)


def measure_mjx_step(seconds: float, robots: int = 1024, steps: int = 20) -> list[dict[str, Any]]:
    """MJX: `jax.vmap(mjx.step)`, the loop over steps inside `jit`."""
    import jax
    import jax.numpy as jnp

    from ravenjax.robots.raven2.dynamics.mjx_dynamics import mjx

    model = mjx.put_model(make_arm())
    one = mjx.make_data(model)
    many = jax.vmap(lambda number: one.replace(qvel=one.qvel + 1e-6 * number))(jnp.arange(robots))

    def advance(data: mjx.Data) -> mjx.Data:
        return jax.lax.fori_loop(
            0, steps, lambda _, now: jax.vmap(mjx.step, in_axes=(None, 0))(model, now), data
        )

    return _measure_jax("jax.vmap(mjx.step)", robots * steps, advance, many, seconds)


def _measure_jax(
    name: str, steps: int, advance: Callable[[Any], Any], start: Any, seconds: float
) -> list[dict[str, Any]]:
    import jax

    lowered = jax.jit(advance).lower(start)
    began = time.perf_counter()
    compiled = lowered.compile()
    compile_s = time.perf_counter() - began
    device = str(jax.config.jax_default_device or jax.devices()[0])
    run = functools.partial(compiled, start)
    return _measure(name, device, compile_s, steps, lambda: jax.block_until_ready(run()), seconds)


def _measure(
    name: str,
    device: str,
    compile_s: float,
    steps: int,
    work: Callable[[], object],
    seconds: float,
) -> list[dict[str, Any]]:
    """steps: of all robots, in `work` once."""
    work()
    times = workload.repeat(work, seconds)
    row = {"peer": name, "device": device, "steps_per_s": steps / min(times)}
    return [
        row | {"us_per_step": 1e6 * min(times) / steps, "seconds": times, "compile_s": compile_s}
    ]
