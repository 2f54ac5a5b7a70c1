"""Times MuJoCo's own ways to step the same arm: rigid bodies only, without motors, cables, control
software, faults or cue.

Joint limits and contacts are off, so that neither needs the constraint solver. This is the least
work that they can do.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import copy
import functools
import time
from collections.abc import Callable, Sequence
from typing import Any

import joblib
import mujoco
import numpy as np

from bench import workload
from ravenjax.robots.raven2.dynamics import arm_model

STEP_S = 1e-3
"""s, step of the simulation: that of the tick."""
PUBLISHED = "published model, target A2: at most 11 us"
"""The authors' C++ takes 11 us for an Euler step on one core; DSN 2016, Figure 8."""


def make_arm() -> mujoco.MjModel:
    """Return a model of the gold arm alone."""
    model = copy.copy(arm_model.one_arm("gold"))
    model.opt.timestep = STEP_S
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def measure_rollout(
    seconds: float, batches: Sequence[int] = (256, 1024, 4096, 16384), steps: int = 100
) -> list[dict[str, Any]]:
    """Time C MuJoCo's `mujoco.rollout` with one thread per CPU, by number of robots."""
    from mujoco import rollout

    threads = joblib.cpu_count()
    model, kind = make_arm(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data = [mujoco.MjData(model) for _ in range(threads)]
    rows: list[dict[str, Any]] = []
    with rollout.Rollout(nthread=threads) as pool:
        for robots in batches:
            initial = np.zeros((robots, mujoco.mj_stateSize(model, kind)))
            mujoco.mj_getState(model, data[0], initial[0], kind)
            initial[:] = initial[0]
            work = functools.partial(pool.rollout, model, data, initial, nstep=steps)
            setting = {"robots": robots, "steps": steps, "device": f"{threads} threads"}
            rows += _measure("mujoco.rollout", setting, robots * steps, work, seconds, len(batches))
    return rows


def measure_published_model(seconds: float, steps: int = 20_000) -> list[dict[str, Any]]:
    """Time the published three-joint model of one robot, explicit Euler at 1 ms as published, in
    float64, on one core.
    """
    import jax

    from validation import authors

    with jax.enable_x64(True), jax.default_device(jax.devices("cpu")[0]):
        return _measure_jax(PUBLISHED, 1, steps, *authors.list_steps(steps), seconds)


def measure_mjx_step(
    seconds: float, implementation: str = "jax", batches: Sequence[int] = (), steps: int = 100
) -> list[dict[str, Any]]:
    """Time `jax.vmap(mjx.step)` by number of robots, with the loop over steps inside `jit`.

    `implementation`: `jax`, or MuJoCo Warp (`warp`), which needs the package warp-lang.
    """
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    on_cpu = jax.default_backend() == "cpu"
    batches = batches or ((1024,) if on_cpu else tuple(4**n for n in range(5, 10)))
    arm = make_arm()
    model = mjx.put_model(arm, impl=implementation)
    first = mjx.make_data(arm, impl=implementation)

    def advance(data: mjx.Data) -> mjx.Data:
        return jax.lax.fori_loop(
            0, steps, lambda _, now: jax.vmap(mjx.step, in_axes=(None, 0))(model, now), data
        )

    name = {"jax": "jax.vmap(mjx.step)", "warp": "jax.vmap(mjx.step), MuJoCo Warp"}[implementation]
    rows: list[dict[str, Any]] = []
    for robots in batches:
        start = jax.vmap(lambda number: first.replace(qvel=first.qvel + 1e-6 * number))(
            jnp.arange(robots)
        )
        rows += _measure_jax(name, robots, steps, advance, start, seconds, len(batches))
    return rows


def _measure_jax(
    name: str,
    robots: int,
    steps: int,
    advance: Callable[[Any], Any],
    start: Any,
    seconds: float,
    settings: int = 1,
) -> list[dict[str, Any]]:
    import jax

    lowered = jax.jit(advance).lower(start)
    began = time.perf_counter()
    compiled = lowered.compile()
    setting = {
        "robots": robots,
        "steps": steps,
        "device": str(jax.config.jax_default_device or jax.devices()[0]),
        "compile_s": time.perf_counter() - began,
        # XLA counts the loop body once.
        "operations_per_step": float((compiled.cost_analysis() or {}).get("flops", 0.0)) / robots,
    }
    run = functools.partial(compiled, start)
    work = lambda: jax.block_until_ready(run())  # noqa: E731
    return _measure(name, setting, robots * steps, work, seconds, settings)


def _measure(
    name: str,
    setting: dict[str, Any],
    steps: int,
    work: Callable[[], object],
    seconds: float,
    settings: int = 1,
) -> list[dict[str, Any]]:
    """Time one of `settings` settings. `steps`: of all robots in one call of `work`."""
    work()
    times = workload.repeat(work, seconds / settings)
    rates = {"steps_per_s": steps / min(times), "us_per_step": 1e6 * min(times) / steps}
    return [{"peer": name} | setting | rates | {"seconds": times}]
