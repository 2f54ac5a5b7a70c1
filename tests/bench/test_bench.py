"""The benchmark measures what it says: every run distinct and computed, ratios and shares those of its numbers."""

from __future__ import annotations

import dataclasses
import json
import time

import jax
import mujoco
import numpy as np
import pytest

from ravenjax.bench import clock, operations, peak, peers, software, speed, start, suite, tables
from ravenjax.bench.clock import WorkTiming
from ravenjax.bench.operations import Operations
from ravenjax.bench.peers import Peer
from ravenjax.bench.software import SoftwareSpeed
from ravenjax.bench.speed import Batch, Speed
from ravenjax.bench.start import ShellStart
from ravenjax.bench.suite import BenchFindings, BenchMachine, Campaigns
from ravenjax.bench.workload import PATTERN_RUNS, Workload
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.robots.raven2.dynamics.mjx_dynamics import mjx
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.software.control_software import ControlSoftware

TICKS = 20


@pytest.fixture(scope="module")
def work():
    return Workload(TICKS)


def findings():
    """One second for a million ticks by simd, a thousandth of that by mjx."""
    one = WorkTiming(1.0, 2.0, 3)
    simd = Speed(
        "simd", "a CPU", 2, 3.0, 0.5, (Batch(500, 16, 1000, WorkTiming(0.6, 0.7, 3)), Batch(1000, 256, 1000, one))
    )
    mjx = Speed("mjx", "a CPU", 2, 9.0, 8.0, (Batch(10, 16, 100, one),))
    return BenchFindings(
        BenchMachine("CPU [4]", 2, "AVX-512", 16, "Linux", "cpu", 0.5, 1.5),
        (simd, mjx),
        {"cuda": "no GPU"},
        Operations({"robot.step": 1000, "": 500}, {"nominal.step": 200}),
        {"simd": 3e9},
        (Peer("mujoco.rollout", "CPU", 10, 200, 0.0, WorkTiming(0.01, 0.02, 3)),),
        Peer("published 3-joint Euler model", "CPU, 1 core", 1, 1000, 0.1, WorkTiming(0.0055, 0.006, 3)),
        Campaigns("simd", 1000, {100: 3.0, 1100: 4.0}),
        SoftwareSpeed(2000, 200, WorkTiming(0.02, 0.03, 3), WorkTiming(0.01, 0.02, 3), WorkTiming(0.2, 0.3, 3)),
        (ShellStart("ravenjax run quick, nothing cached", 4.9, 6.5, 512.0),),
    )


def test_ratios_and_shares_follow_from_the_numbers():
    found = findings()
    assert found.ratios() == {"simd": {"engine mjx": 1000.0, "mujoco.rollout": 5.0}}
    assert found.peak_share("simd") == 0.5
    assert found.peak_share("mjx") is None
    assert found.campaigns.growth == pytest.approx((2.9, 1e-3))
    assert found.engine("simd").growth == pytest.approx((0.2, 0.8e-3))
    assert found.engine("mjx").growth is None


def test_json_and_tables_tell_everything():
    found = findings()
    again = json.loads(json.dumps(found.as_json()))
    assert again["ratios"]["simd"]["mujoco.rollout"] == 5.0
    assert again["engines"][0]["batches"][1]["ticks_per_s"] == 1e6
    assert again["machine"]["load_after"] == 1.5
    assert again["software"]["ticks_per_s"] == {"step": 1e5, "run": 2e5, "interpreted": 1e3}
    page = tables.markdown(found, "ravenjax bench")
    for text in (
        "CPU [4]",
        "no GPU",
        "0.5 before, 1.5 after",
        "50 %",
        "simd / engine mjx | 1,000",
        "compiled, a call each | 100,000 | 10 | 100",
        "5.5 | 0.50 | yes",
        "nothing cached | 4.90 | 6.50 | 512 MB",
    ):
        assert text in page
    for _, columns, rows in tables.tables(found):
        assert rows and all(len(row) == len(columns) for row in rows)


def test_the_published_model_is_stepped():
    found = peers.published_model(50, 1, 0.01)
    assert (found.robots, found.steps) == (1, 50) and found.steps_per_s > 1000


def test_the_control_software_is_timed_in_pedal_down():
    rates = software.measure(20, 5, 1, 0.01).ticks_per_s
    assert rates["interpreted"] < min(rates["step"], rates["run"])
    there = ControlSoftware(jpos=[list(HOME_JPOS)] * 2, runlevel=3)
    encoders, datagrams = software.inputs(np.array(there.state.usb.enc_val), 2000)
    signals = there.run(encoders, datagrams, software.PINS).signals
    assert set(signals.runlevel) == {3} and not signals.soft_estopped.any()
    assert len(set(signals.arms[0].current_cmd[0])) > 100 and signals.last_seq[-1] == 2000


def test_no_two_runs_are_alike(work):
    runs = 3 * PATTERN_RUNS
    block = work.block(5, runs, runs, np.zeros((TICKS, 6), np.float32))
    rows = np.stack([np.asarray(leaf, np.float64) for leaf in jax.tree.leaves(block.faults)], axis=1)
    assert len(np.unique(rows, axis=0)) == runs


def test_the_last_block_is_filled_with_its_last_run(work):
    (slot,) = work.block(10, 3, 8, np.zeros((TICKS, 6), np.float32)).faults.slots
    assert len(np.unique(slot.value[2:])) == 1
    assert len(np.unique(slot.value[:3])) == 3


@pytest.mark.slow
def test_an_engine_computes_every_tick_of_every_run(work):
    """Counted by the engine's own progress, the untimed first time included."""
    done = []
    engine = SimdEngine()
    kernel = engine.compile(work.program, 100)

    class Watched:
        name, device, threads = "watched", "here", 1

        def compile(self, program, runs):
            return self

        lanes, size, prepare = kernel.lanes, kernel.size, kernel.prepare

        def run(self, block, motion, progress=None):
            if block.reference is None:
                return kernel.run(block, motion)
            return kernel.run(block, motion, done.append)

    found = speed.measure(Watched(), work, (100,), repeats=2, enough_s=60.0)
    (batch,) = found.batches
    blocks = -(-100 // kernel.lanes)
    assert batch.timing.repeats == 2
    assert 3 * 100 * TICKS <= sum(done) <= 3 * blocks * kernel.lanes * TICKS
    assert batch.ticks_per_s * batch.timing.best_s == pytest.approx(100 * TICKS)


def test_time_is_that_of_the_work():
    ticks = iter([0.0, 9.0])
    timing = clock.timed(lambda: next(ticks), repeats=1, enough_s=1.0)
    assert timing.repeats == 1 and timing.best_s <= timing.median_s


@pytest.mark.slow
def test_operations_by_stage_add_up(work):
    found = operations.count(work)
    assert found.per_lane == sum(found.lane.values()) > 1000
    assert found.shared["nominal.step"] > 0 == found.lane.get("nominal.step", 0)


def test_peak_is_that_of_real_multiply_adds():
    """No CPU core does more than 4 vector instructions a cycle, at 8 GHz; none that runs this less than one in ten."""
    assert 1e8 < peak.cpu(1, repeats=1, rounds=200_000) < 4 * 16 * 8e9


@pytest.mark.slow
def test_peers_step_the_arm():
    """MuJoCo's step and MJX's agree on the model that both are timed on, as far as float32 goes."""
    model = peers.arm()
    data = mujoco.MjData(model)
    there = mjx.step(mjx.put_model(model), mjx.make_data(model))
    mujoco.mj_step(model, data)
    assert model.nv == 7 and np.abs(data.qvel).max() > 1e-4
    assert np.abs(np.asarray(there.qvel) - data.qvel).max() < 1e-4 * np.abs(data.qvel).max()
    found = peers.rollout(threads=2, robots=4, steps=5, repeats=1, enough_s=0.1)
    assert found.steps_per_s * found.timing.best_s == pytest.approx(20)


def test_an_engine_that_is_not_there_is_named_with_its_reason():
    assert "unknown" in speed.find("fpga")
    assert set(suite.QUICK.sizes) <= set(suite.FULL.sizes)
    assert dataclasses.asdict(suite.FULL)["repeats"] >= 3


def _sleeps() -> None:
    time.sleep(60.0)


def test_a_peer_that_does_not_finish_is_left_out():
    assert peers.apart(_sleeps, limit_s=0.5) == "not finished within 0 s"  # type: ignore[arg-type]


def test_a_command_is_timed_in_a_process_of_its_own(tmp_path):
    one = start._timed("--help", tmp_path, "--help")
    assert one.what == "ravenjax --help" and one.cpu_s > 0.0 and one.seconds > 0.0
    assert 5.0 < one.peak_mb < 500.0
    with pytest.raises(RuntimeError, match="no_such_campaign"):
        start._timed("run", tmp_path, "run", "no_such_campaign")
