"""Measures the speed of MuJoCo, MJX and MuJoCo Warp on the same arm: rigid bodies only, without
motors, cables, control software, faults or cue. Joint limits and contacts are off, so the times are
lower limits for these libraries.
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
from ravenjax.engines.xla import MJX_ON_CPU
from ravenjax.robots.raven2.dynamics import arm_model

STEP_S = 1e-3  # step of the simulation: that of the tick
PUBLISHED = "published model, target A2: at most 11 us"
"""The authors' C++ takes 11 us for an Euler step on one core; DSN 2016, Figure 8."""


def make_arm() -> mujoco.MjModel:
    """Return a model of the gold arm alone."""
    model = copy.copy(arm_model.one_arm("gold"))
    model.opt.timestep = STEP_S
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def measure_rollout(
    seconds: float,
    batches: Sequence[int] = (256, 1024, 4096, 16384),
    model: mujoco.MjModel | None = None,
    control: np.ndarray | None = None,
    steps: int = 100,
) -> list[dict[str, Any]]:
    """Time C MuJoCo's `mujoco.rollout` with one thread per CPU, each number of robots with the
    fastest size of a task. model: the gold arm if None. control: of every robot and step, [nu].
    """
    from mujoco import rollout

    threads, kind = joblib.cpu_count(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    arm = make_arm() if model is None else model
    data = [mujoco.MjData(arm) for _ in range(threads)]
    if arm.nkey:
        mujoco.mj_resetDataKeyframe(arm, data[0], 0)
    first = np.zeros(mujoco.mj_stateSize(arm, kind))
    mujoco.mj_getState(arm, data[0], first, kind)
    held, chunks = None if control is None else np.reshape(control, (1, 1, -1)), (None, 1, 16, 128)
    rows: list[dict[str, Any]] = []
    with rollout.Rollout(nthread=threads) as pool:
        for robots in batches:
            tried: list[dict[str, Any]] = []
            for chunk in chunks:
                work = functools.partial(
                    *(pool.rollout, arm, data, np.tile(first, (robots, 1)), held),
                    nstep=steps,
                    chunk_size=chunk,
                )
                device = f"{threads} threads, tasks of {chunk or 'default'}"
                setting = {"robots": robots, "steps": steps, "device": device}
                settings = len(batches) * len(chunks)
                tried += _measure(
                    "mujoco.rollout", setting, robots * steps, work, seconds, settings
                )
            rows.append(max(tried, key=lambda row: row["steps_per_s"]))
    return rows


def measure_published_model(seconds: float, steps: int = 20_000) -> list[dict[str, Any]]:
    """Time the published three-joint model (explicit Euler at 1 ms, float64) on one core."""
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
    batches = batches or ((256, 1024) if on_cpu else tuple(4**n for n in range(5, 10)))
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
        options = MJX_ON_CPU if on_cpu else None
        rows += _measure_jax(name, robots, steps, advance, start, seconds, len(batches), options)
    return rows


def _measure_jax(
    name: str,
    robots: int,
    steps: int,
    advance: Callable[[Any], Any],
    start: Any,
    seconds: float,
    settings: int = 1,
    options: dict[str, str | bool] | None = None,
) -> list[dict[str, Any]]:
    import jax

    lowered = jax.jit(advance).lower(start)
    began = time.perf_counter()
    compiled = lowered.compile(compiler_options=options)
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
