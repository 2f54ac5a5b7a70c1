"""Measures the cost of a user-defined detector: `python analysis/engines/own_detector.py [ROUNDS]`.

It counts operations of the generated tick in each run, and measures processor time of engine simd
on one core. In each round every variant runs the same 128 runs of 1 s once, in another order. A
variant's share is the median over rounds of its time divided by that of the tick without a
detector, with a bootstrapped 95 % interval.
"""

import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tick_operations as operations

sys.path.append(str(Path(__file__).resolve().parents[1]))

from bench.workload import PATTERN_RUNS, Workload, campaign
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine

TICKS, ROUNDS = 1000, 60
FRAME = "def step(params, state, view):\n    return state, view.tip_error * 1e3\n"
BOARDS = """
from ravenjax.parts import Vec, jnp

def init(params):
    return Vec.full(3, 0)

def step(params, state, view):
    command, score = Vec(view.boards_cmd[:3]), 0.0
    for now, before in zip(command, state):
        score = jnp.maximum(score, jnp.abs(now - before) / 3000.0)
    return command, score
"""
JOINTS = """
from ravenjax.parts import jnp

def step(params, state, view):
    scores = []
    for x, v in zip(view.jpos, view.mvel):
        for k in range(5):
            x = jnp.maximum((x - v) * (0.5 + 0.001 * k), x)
        scores.append(x)
    score = scores[0]
    for one in scores[1:]:
        score = jnp.maximum(score, one)
    return state, score
"""
CHAIN = """
from ravenjax.parts import jnp

def step(params, state, view):
    x = view.tip_error * 1e3
    for k in range(33):
        x = jnp.maximum((x - view.jpos[k % 7]) * (0.5 + 0.001 * k), x)
    return state, x
"""
VARIANTS = {
    "no detector": "",
    "the frame alone": FRAME,
    "boards.py": BOARDS,
    "100 operations, by joint": JOINTS,
    "100 operations, each waiting for the one before": CHAIN,
}


class Prepared(NamedTuple):
    """A compiled variant."""

    operations: int  # in each run
    kernel: Any
    block: Any
    motion: tuple[np.ndarray, ...]


def prepared(text: str, folder: Path) -> Prepared:
    """Return the benchmark's tick with a detector of that text; "": without one."""
    work = Workload(TICKS)
    if text:
        file = folder / f"detector{len(list(folder.iterdir()))}.py"
        file.write_text(text, encoding="utf-8")
        raw = campaign(PATTERN_RUNS, TICKS).model_dump(
            mode="json", exclude_none=True, exclude_defaults=True
        )
        watched = loading.from_dict(
            raw | {"detector": [{"name": "own", "file": str(file), "threshold": [1.0]}]}
        )
        work.__dict__["plan"] = plan.make_plan(watched)  # replaces the cached property
    kernel = SimdEngine().compile(work.plan.program, PATTERN_RUNS)
    kernel.prepare(work.golden_runs(kernel.lanes), work.plan.columns)
    reference = kernel.run(work.golden_runs(kernel.size(1)), work.plan.columns).reference[:, :, 0]
    block = work.block(0, kernel.lanes, kernel.size(kernel.lanes), reference)
    return Prepared(operations.count(work).per_lane, kernel, block, work.plan.columns)


def timed(variants: dict[str, Prepared], rounds: int) -> dict[str, np.ndarray]:
    """Return the processor time of each variant in each round, s [rounds]."""
    times: dict[str, list[float]] = {name: [] for name in variants}
    order, rng = list(variants.items()), random.Random(1)
    for _ in range(rounds):
        rng.shuffle(order)
        for name, one in order:
            begin = time.thread_time()
            one.kernel.run(one.block, one.motion)
            times[name].append(time.thread_time() - begin)
    return {name: np.array(values) for name, values in times.items()}


def main() -> None:
    """Measure and print."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    with tempfile.TemporaryDirectory() as folder:
        variants = {name: prepared(text, Path(folder)) for name, text in VARIANTS.items()}
        times = timed(variants, rounds)
    rng, plain, base = np.random.default_rng(0), variants.pop("no detector"), times["no detector"]
    print(f"no detector: {plain.operations} operations; {rounds} rounds")
    for name, one in variants.items():
        more = one.operations - plain.operations
        ratios = times[name] / base
        low, high = np.percentile(
            np.median(rng.choice(ratios, (4000, rounds)), axis=1), [2.5, 97.5]
        )
        shares = [f"{100 * (ratio - 1):+.1f}" for ratio in (np.median(ratios), low, high)]
        print(
            f"{name}: {more:+d} operations, {100 * more / plain.operations:+.1f} %; "
            f"time {shares[0]} % ({shares[1]} to {shares[2]})"
        )


if __name__ == "__main__":
    main()
