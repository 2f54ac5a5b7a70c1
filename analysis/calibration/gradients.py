"""Tests whether derivatives of the tick help `ravenjax calibrate`. Prints Markdown.

    python analysis/calibration/gradients.py [SECONDS] [xla]

The slopes of one virtual log by all estimated parameters are computed in three ways. The fit uses
differences of replays to both sides on engine `simd`. The second way is forward-mode derivatives of
the same tick (`jax.jvp`) on the same engine, with one lane per parameter. The third, optional, is
`jax.jvp` of the replay by XLA. In these replays encoders and DACs do not round to whole counts.
With rounding a derivative is 0 and a small difference is random, as the last column shows.
"""

import dataclasses
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import virtual_log

from ravenjax.analyses.calibration import fit, parameters, replays
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.parameters import Unknown
from ravenjax.analyses.calibration.position_loop import LoopParams
from ravenjax.analyses.calibration.replays import ReplayParams, ReplaySetup
from ravenjax.document.html import markdown_table
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, TickProgram
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.plant import robot

FULL = "loop."


# --- the tick with its derivative, as a `ravenjax.engines.interface.Loop` ---


@record
class TangentParams:
    """A replay and the direction in which it is differentiated."""

    replay: ReplayParams
    along: ReplayParams


@record
class TangentState:
    """The replay's state and its derivative."""

    replay: Any
    change: tuple[Scalar, ...]  # derivatives of the state's real numbers, in order


def _is_real(leaf: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(leaf), jnp.floating)


def _reals(tree: Any) -> tuple[tuple[Scalar, ...], Callable[[tuple[Scalar, ...]], Any]]:
    """Return the real numbers of a record, and a function that replaces them."""
    leaves, form = jax.tree.flatten(tree)
    reals = tuple(jnp.asarray(leaf, "float32") for leaf in leaves if _is_real(leaf))

    def back(values: tuple[Scalar, ...]) -> Any:
        rest = iter(values)
        return jax.tree.unflatten(form, [next(rest) if _is_real(leaf) else leaf for leaf in leaves])

    return reals, back


def init(setup: ReplaySetup, params: TangentParams) -> TangentState:
    """Return the initial state, as `replays.init` does."""
    values, back = _reals(params.replay)
    along, _ = _reals(params.along)
    state, change = jax.jvp(lambda *v: _reals(replays.init(setup, back(v)))[0], values, along)
    _, whole = _reals(replays.init(setup, params.replay))
    return TangentState(whole(state), change)


def advance(
    setup: ReplaySetup,
    params: TangentParams,
    faults: Any,
    state: TangentState,
    now: Any,
    motion: Any,
    golden: Any,
) -> tuple[TangentState, tuple[Scalar, ...], tuple[()]]:
    """Compute one cycle, as `replays.advance` does. The output is derivatives of the joints."""
    values, back = _reals(params.replay)
    along, _ = _reals(params.along)
    reals, state_back = _reals(state.replay)

    def step(values: Any, reals: Any) -> Any:
        after, series, _ = replays.advance(
            setup, back(values), faults, state_back(reals), now, motion, golden
        )
        return _reals(after)[0], series

    (_, _), (change, series) = jax.jvp(step, (values, reals), (along, state.change))
    after, _, _ = replays.advance(setup, params.replay, faults, state.replay, now, motion, golden)
    return TangentState(after, change), tuple(series), ()


def series_length(setup: ReplaySetup) -> int:
    """Return the number of joints."""
    return replays.series_length(setup)


def outcomes(setup: ReplaySetup, params: TangentParams, state: TangentState) -> dict[str, Any]:
    """Return only the number of ticks that ran."""
    return replays.outcomes(setup, params.replay, state.replay)


# --- three ways to a slope ---


def derivatives(
    setup: ReplaySetup, base: LoopParams, wanted: list[Unknown], steps: np.ndarray, log: JointLog
) -> Callable[[], np.ndarray]:
    """Return jax.jvp of the tick on engine `simd`: [k, T, 7]."""
    here, there = (parameters.values_by_path(base, wanted, (steps + d)[None]) for d in (0.0, 1e-4))
    replay = ReplayParams(base, Vec(np.float32(x) for x in log.start))
    still = jax.tree.map(lambda x: 0.0 if isinstance(x, float) else x * 0, replay)
    varied = {
        f"replay.{FULL}{path}": np.full(len(wanted), value[0]) for path, value in here.items()
    }
    for k, one in enumerate(wanted):
        for path in parameters.values_by_path(base, [one], np.zeros((1, 1))):
            rate = np.zeros(len(wanted))
            rate[k] = (there[path][0] - here[path][0]) / 1e-4
            varied[f"along.{FULL}{path}"] = rate
    program = TickProgram(
        "__main__", setup, TangentParams(replay, still), tuple(varied), len(log.desired)
    )
    kernel = selection.select_engine("simd", setup.precision).compile(program, 2 * len(wanted))
    motion = tuple(np.ascontiguousarray(column, np.float32) for column in log.desired.T)
    lanes = np.minimum(np.arange(kernel.size(len(wanted))), len(wanted) - 1)
    block = Block(
        {path: values[lanes].astype(np.float32) for path, values in varied.items()}, (), None
    )
    return lambda: np.moveaxis(kernel.run(block, motion).reference, -1, 0)[: len(wanted)]


def by_scan(
    setup: ReplaySetup, base: LoopParams, wanted: list[Unknown], steps: np.ndarray, log: JointLog
) -> Callable[[], np.ndarray]:
    """Return jax.jvp of a scan of the tick, compiled by XLA for one parameter: [T, 7] of the first
    parameter.
    """
    motion = tuple(jnp.asarray(column, "float32") for column in log.desired.T)

    def joints(steps: Any) -> Any:
        params = ReplayParams(
            parameters.apply_steps(base, wanted, steps), Vec(jnp.float32(x) for x in log.start)
        )
        reals, back = _reals(replays.init(setup, params))

        def tick(state: Any, now: Any) -> Any:
            after, series, _ = replays.advance(setup, params, (), state, now, motion, None)
            return after, jnp.stack(series)

        return jax.lax.scan(tick, back(reals), jnp.arange(len(log.desired), dtype=jnp.int32))[1]

    run = jax.jit(lambda at, along: jax.jvp(joints, (at,), (along,))[1])
    at = jnp.asarray(steps, "float32")
    return lambda: np.asarray(run(at, jnp.eye(len(steps), dtype="float32")[0]))


def timed(run: Callable[[], np.ndarray], repeats: int = 3) -> tuple[np.ndarray, float, float]:
    """Return the result, and seconds of processor time: of the first call beyond a later one, and
    of a later call.
    """
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
    return result, times[0] - min(times), min(times)


def agreement(slopes: np.ndarray, other: np.ndarray) -> str:
    """Return the least and the median cosine between slopes [k, T, 7] in the encoder's counts."""
    a, b = ((x / fit.MIN_NOISE).reshape(len(x), -1) for x in (slopes, other))
    cosines = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return f"{np.median(cosines):.3f} ({cosines.min():.2f})"


def main(seconds: float = 7.0, xla: bool = False) -> None:
    """Time the three ways and compare."""
    wanted = list(parameters.select_unknowns(range(7)))
    count = len(wanted)
    base = parameters.prior_robot(robot.params(virtual_log.SETUP, "gold"), wanted)
    hidden = np.random.default_rng(0).standard_normal(count)
    logged = virtual_log.recorded(base, wanted, hidden, virtual_log.swept(round(seconds * 1e3)))
    log = logged.log._replace(cycles=np.arange(len(logged.log.desired)))
    setup = replays.setup_of(logged.setup, "gold", logged.controller, wanted)
    smooth = dataclasses.replace(setup, whole_counts=False)
    probes = np.vstack([np.eye(count), -np.eye(count)])

    def differences(setup: ReplaySetup, size: float) -> Callable[[], np.ndarray]:
        predict = replays.make_predictor(setup, base, wanted, log)

        def run() -> np.ndarray:
            joints = predict(hidden + size * probes)
            return (joints[:count] - joints[count:]) / (2.0 * size)

        return run

    exact, compiling, each = timed(derivatives(smooth, base, wanted, hidden, log))
    rows = [("derivatives of the tick, simd", f"{count}", f"{compiling:.1f}", f"{each:.2f}", "")]
    for name, one, size in (
        ("differences of 0.1, simd", smooth, 0.1),
        ("the same in whole numbers", setup, 0.1),
        ("differences of 0.001 in whole numbers", setup, 0.001),
    ):
        slopes, compiling, each = timed(differences(one, size))
        rows.append(
            (name, f"{2 * count}", f"{compiling:.1f}", f"{each:.2f}", agreement(exact, slopes))
        )
    columns = (
        "slopes",
        "replays",
        "compiling, s",
        "each time, s",
        "cosine with the first: median (least)",
    )
    print(markdown_table(columns, rows), flush=True)
    if xla:  # for a single parameter, because compiling takes minutes
        slope, compiling, each = timed(by_scan(smooth, base, wanted, hidden, log))
        row = (
            "derivative of the scan, xla",
            "1",
            f"{compiling:.1f}",
            f"{each:.2f}",
            agreement(exact[:1], slope[None]),
        )
        print(markdown_table(columns, [row]))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:2]), xla="xla" in sys.argv)
