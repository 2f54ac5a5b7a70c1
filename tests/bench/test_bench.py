"""The benchmark measures what it says: every run distinct and computed."""

import jax
import mujoco
import numpy as np
import pytest
from mujoco import mjx

from bench import campaigns, commands, engines, peers
from bench.workload import PATTERN_RUNS, Workload
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine

TICKS = 20


@pytest.fixture(scope="module")
def work():
    return Workload(TICKS)


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RAVENJAX_CACHE", str(tmp_path / "cache"))


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
    kernel = SimdEngine().compile(work.program, 100)

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


@pytest.mark.parametrize("start", [0, 6000])
def test_faults_strike_when_they_are_said_to(start):
    ready = plan.make_plan(loading.from_dict(campaigns.fault_campaign(4, start, 200)))
    assert set(ready.acts.tolist()) == {start}
    assert len(set(ready.faults["value"].ravel().tolist())) == 4


@pytest.mark.slow
def test_campaigns_are_timed_by_size_and_by_fault_time(own_cache, monkeypatch):
    monkeypatch.setattr(campaigns.selection, "fastest_engine", lambda _: ("simd", ""))
    for name, value in {
        "SIZES": {"simd": (16, 32)},
        "TICKS": {"simd": 20},
        "FAULT_TICKS": 60,
        "OBSERVE_MS": 20,
        "STARTS_MS": (0, 30),
    }.items():
        monkeypatch.setattr(campaigns, name, value)
    assert [row["runs"] for row in campaigns.measure_sizes(0.0)] == [16, 32]
    rows = campaigns.measure_fault_times(0.0, 32)
    ways = [(row["fault_at_ms"], row["observe_ms"]) for row in rows]
    assert ways == [(0, None), (30, None), (0, 20), (30, 20)]
    assert all(row["us_per_run"] > 0.0 for row in rows)


def test_a_command_is_timed_in_a_process_of_its_own(tmp_path):
    done = commands.run_command(tmp_path, "--help")
    assert done.cpu_s > 0.0 and done.seconds > 0.0
    assert 5.0 < done.peak_mb < 500.0
    with pytest.raises(RuntimeError, match="no_such_campaign"):
        commands.run_command(tmp_path, "run", "no_such_campaign")
