"""The benchmark measures what it says: every run distinct and computed."""

import jax
import mujoco
import numpy as np
import pytest
from mujoco import mjx

from bench import commands, engines, peers
from bench.workload import PATTERN_RUNS, Workload
from ravenjax.engines.cpu.engine import SimdEngine

TICKS = 20


@pytest.fixture(scope="module")
def work():
    return Workload(TICKS)


def test_no_two_runs_are_alike(work):
    runs = 3 * PATTERN_RUNS
    block = work.block(5, runs, runs, np.zeros((TICKS, 6), np.float32))
    rows = np.stack(
        [np.asarray(leaf, np.float64) for leaf in jax.tree.leaves(block.faults)], axis=1
    )
    assert len(np.unique(rows, axis=0)) == runs


@pytest.mark.slow
def test_an_engine_computes_every_tick_of_every_run(work):
    """Counted by the engine's own progress, the untimed first time included."""
    done = []
    kernel = SimdEngine().compile(work.plan.program, 100)

    class Watched:
        name, device, threads = "watched", "here", 1

        def compile(self, program, runs):
            return self

        lanes, size, prepare = kernel.lanes, kernel.size, kernel.prepare

        def run(self, block, motion, progress=None):
            if block.reference is None:
                return kernel.run(block, motion)
            return kernel.run(block, motion, done.append)

    (row,) = engines.measure_batches(Watched(), work, (100,), 60.0)
    blocks, times = -(-100 // kernel.lanes), 1 + len(row["seconds"])
    assert times == 10
    assert times * 100 * TICKS <= sum(done) <= times * blocks * kernel.lanes * TICKS
    assert row["ticks_per_s"] * min(row["seconds"]) == pytest.approx(100 * TICKS)


@pytest.mark.slow
def test_peers_step_the_arm():
    """MuJoCo's step and MJX's agree on the model that both are timed on, as far as float32 goes."""
    model = peers.make_arm()
    data = mujoco.MjData(model)
    there = jax.jit(mjx.step)(mjx.put_model(model), mjx.make_data(model))
    mujoco.mj_step(model, data)
    assert model.nv == 7 and np.abs(data.qvel).max() > 1e-4
    assert np.abs(np.asarray(there.qvel) - data.qvel).max() < 1e-4 * np.abs(data.qvel).max()


def test_a_command_is_timed_in_a_process_of_its_own(tmp_path):
    done = commands.run_command(tmp_path, "--help")
    assert done.cpu_s > 0.0 and done.seconds > 0.0
    assert 5.0 < done.peak_mb < 500.0
    with pytest.raises(RuntimeError, match="no_such_campaign"):
        commands.run_command(tmp_path, "run", "no_such_campaign")
