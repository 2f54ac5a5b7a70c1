"""The benchmark measures what it says: every run distinct and computed, ratios and shares those
of its numbers.
"""

from __future__ import annotations

import jax
import made_up_findings as made_up
import mujoco
import numpy as np
import pytest

from ravenjax.bench import (
    campaigns,
    clock,
    operations,
    peak,
    peers,
    software,
    speed,
    start,
    workload,
)
from ravenjax.bench.workload import PATTERN_RUNS, Workload
from ravenjax.campaign import loading
from ravenjax.engines import traced
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.errors import UserError
from ravenjax.robots.raven2.dynamics.mjx_dynamics import mjx
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.software.control_software import ControlSoftware

TICKS = 20


@pytest.fixture(scope="module")
def work():
    return Workload(TICKS)


def test_ratios_and_shares_follow_from_the_numbers():
    found = made_up.whole()
    assert found.ratios() == {"simd": {"engine mjx": 1000.0, "mujoco.rollout": 5.0}}
    assert found.peak_share("simd") == 0.5
    assert found.peak_share("mjx") is None
    assert found.campaigns.growth == pytest.approx((2.9, 1e-3))
    assert found.engine("simd").growth == pytest.approx((0.2, 0.8e-3))
    assert found.engine("mjx").growth is None


def test_the_published_model_is_stepped():
    found = peers.published_model(0.01, 50)
    assert (found.robots, found.steps) == (1, 50) and found.steps_per_s > 1000


def test_the_control_software_is_timed_in_pedal_down():
    rates = software.measure(0.01, 20, 5).ticks_per_s
    assert rates["interpreted"] < min(rates["step"], rates["run"])
    there = ControlSoftware(jpos=[list(HOME_JPOS)] * 2, runlevel=3)
    encoders, datagrams = software.inputs(np.array(there.state.usb.enc_val), 2000)
    signals = there.run(encoders, datagrams, software.PINS).signals
    assert set(signals.runlevel) == {3} and not signals.soft_estopped.any()
    assert len(set(signals.arms[0].current_cmd[0])) > 100 and signals.last_seq[-1] == 2000


def test_no_two_runs_are_alike(work):
    runs = 3 * PATTERN_RUNS
    block = work.block(5, runs, runs, np.zeros((TICKS, 6), np.float32))
    rows = np.stack(
        [np.asarray(leaf, np.float64) for leaf in jax.tree.leaves(block.faults)], axis=1
    )
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
    """No CPU core does more than 4 vector instructions a cycle, at 8 GHz; none that runs this
    less than one in ten.
    """
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
    found = peers.rollout(0.1, threads=2, robots=4, steps=5)
    assert found.steps_per_s * found.timing.best_s == pytest.approx(20)


def test_an_engine_that_is_not_there_is_named_with_its_reason():
    assert "unknown" in speed.find("fpga")
    with pytest.raises(UserError, match="unknown"):
        speed.of_engine(1.0, "fpga")


def test_batches_that_do_not_fit_are_left_out(work):
    engine = SimdEngine(name="watched")
    assert [b.runs for b in speed.measure(engine, work, (16, 32), 1, 0.0, 60.0).batches] == [16, 32]
    assert [b.runs for b in speed.measure(engine, work, (16, 10**9), 1, 0.0, 1.0).batches] == [16]


def test_campaigns_of_sizes_that_fit():
    found = campaigns.measure(60.0, "simd", (16, 32), 20)
    assert list(found.seconds) == [16, 32] and found.first_s > 0.0 < min(found.seconds.values())
    assert list(campaigns.measure(1.0, "simd", (16, 10**9), 20).seconds) == [16]


def test_a_command_is_timed_in_a_process_of_its_own(tmp_path):
    seconds, cpu_s, peak_mb = start.timed_command(tmp_path, "--help")
    assert cpu_s > 0.0 and seconds > 0.0
    assert 5.0 < peak_mb < 500.0
    with pytest.raises(RuntimeError, match="no_such_campaign"):
        start.timed_command(tmp_path, "run", "no_such_campaign")


def test_commands_are_timed_in_rounds_with_a_cache_of_their_own(monkeypatch):
    calls = []

    def timed_command(place, *tokens):
        calls.append((place, tokens))
        return 2.0 + len(calls), 1.0 + len(calls), 100.0 - len(calls)

    monkeypatch.setattr(start, "timed_command", timed_command)
    monkeypatch.setattr(start.scaling, "rounds", lambda work, seconds, most: (work(), work()))
    cold, again, others, listing, helping = start.measure(1.0)
    assert cold.what == "ravenjax run quick, nothing cached" and cold.seconds.values == (3.0, 8.0)
    assert (cold.cpu_s, cold.peak_mb) == (2.0, 99.0)
    assert [one.what for one in (again, others)] == [
        "ravenjax run quick again",
        "ravenjax run quick with other values",
    ]
    assert (listing.what, helping.what) == ("ravenjax campaigns", "ravenjax --help")
    places = [place for place, _ in calls]
    assert len(set(places[:5])) == len(set(places[5:])) == 1 and places[0] != places[5]
    assert [tokens[:2] for _, tokens in calls[:3]] == [("run", "quick")] * 3
    assert len({tokens[tokens.index("--out") + 1] for _, tokens in calls[:3]}) == 3


def test_the_large_campaign_is_the_one_that_is_timed_elsewhere(tmp_path):
    file = tmp_path / "large.toml"
    file.write_text(start.LARGE.format(runs=7, duration_s=2.0, last_ms=1999))
    one, other = loading.load(str(file)), workload.campaign(7, 2000)
    assert (
        one.group == other.group
        and one.operator == other.operator
        and one.campaign.duration_s == 2.0
    )


@pytest.mark.slow
def test_the_large_campaign_is_run_from_the_shell():
    cold, others = start.measure_large(0.0, 40, 0.5, "--engine", "simd")
    assert (
        cold.what == "ravenjax run of 40 runs of 0.5 s, nothing cached"
        and len(cold.seconds.values) == 1
    )
    assert others.what.endswith("with other values") and others.cpu_s > 0.0


def test_commands_are_those_of_the_package_asked_for(tmp_path, monkeypatch):
    """Whatever the folder is in which Python starts."""
    package = tmp_path / "other/ravenjax"
    (package / "cli").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "cli/__init__.py").write_text("")
    (package / "cli/__main__.py").write_text("import sys; sys.exit(len(sys.argv) - 2)\n")
    monkeypatch.chdir(start.ROOT)
    start.timed_command(tmp_path, "--help", root=tmp_path / "other")
    with pytest.raises(RuntimeError, match="exit code 1"):
        start.timed_command(tmp_path, "--help", "more", root=tmp_path / "other")


@pytest.mark.slow
def test_a_kernel_becomes_ready_in_less_than_its_start(work):
    """Which traces beside it; nothing is left of an earlier one."""
    traced.forget()
    found = speed.measure(SimdEngine(), work, (16,), 1, 0.0)
    assert 0.0 < found.ready_s < found.start_s
