"""The whole benchmark in one run: machine, engines, operations, peers, campaigns."""

from __future__ import annotations

import dataclasses
import functools
import os
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax

from ravenjax.bench import clock, operations, peak, peers, software, speed, start, workload
from ravenjax.bench.operations import Operations
from ravenjax.bench.peers import Peer
from ravenjax.bench.software import SoftwareSpeed
from ravenjax.bench.speed import PRINTING, Speed
from ravenjax.bench.start import ShellStart
from ravenjax.bench.workload import Workload
from ravenjax.campaign import compile_cache, runner
from ravenjax.engines.cpu import jit


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    sizes: Mapping[str, tuple[int, ...]]  # engine -> runs of a batch
    ticks: Mapping[str, int]  # engine -> ticks of a run
    campaign_runs: tuple[int, ...]
    mjx_robots: int
    repeats: int
    enough_s: float  # s of timed work at each point


FULL = Effort(
    {"cuda": (4096, 65536, 1048576), "simd": (16, 256, 4096, 65536), "xla": (16, 256, 4096), "mjx": (16, 1024)},
    {"cuda": 10_000, "simd": 1000, "xla": 200, "mjx": 100},
    (256, 4096, 16384),
    mjx_robots=4096,
    repeats=7,
    enough_s=5.0,
)
QUICK = Effort(
    {"cuda": (65536,), "simd": (16, 4096), "mjx": (1024,)},
    {"cuda": 1000, "simd": 1000, "mjx": 50},
    (256, 1024),
    mjx_robots=1024,
    repeats=3,
    enough_s=1.0,
)
MJX_STEPS, ROLLOUT_ROBOTS, ROLLOUT_STEPS, EULER_STEPS = 20, 1024, 200, 20_000
SOFTWARE_CYCLES, INTERPRETED_CYCLES = 2000, 200


@dataclasses.dataclass(frozen=True)
class BenchMachine:
    """What it was measured on, and how busy that was."""

    cpu: str
    cores: int  # that this process may use; as many threads run
    vectors: str
    width: int  # float32 lanes of a vector
    system: str
    jax_device: str
    load_before: float  # processes running, mean over the minute before the benchmark
    load_after: float


@dataclasses.dataclass(frozen=True)
class Campaigns:
    """Seconds of whole campaigns kept in memory: planning, tracing, compiling, running, tables."""

    engine: str
    ticks: int  # of a run
    seconds: Mapping[int, float]  # runs -> s

    @property
    def growth(self) -> tuple[float, float]:
        """(s, s a run) of the line through the smallest and the largest."""
        less, more = min(self.seconds), max(self.seconds)
        marginal = (self.seconds[more] - self.seconds[less]) / (more - less)
        return self.seconds[more] - marginal * more, marginal


@dataclasses.dataclass(frozen=True)
class BenchFindings:
    """Everything that one benchmark found."""

    machine: BenchMachine
    engines: tuple[Speed, ...]
    absent: Mapping[str, str]  # engine or peer -> why it was not timed
    operations: Operations
    peak: Mapping[str, float]  # printing engine -> operations/s of the device it runs on
    peers: tuple[Peer, ...]
    published_model: Peer  # its three joints alone
    campaigns: Campaigns
    software: SoftwareSpeed
    starts: tuple[ShellStart, ...]  # whole commands from the shell

    def engine(self, name: str) -> Speed | None:
        """The speed of an engine, if it was timed."""
        return next((one for one in self.engines if one.engine == name), None)

    def peak_share(self, name: str) -> float | None:
        """Operations a second of an engine's lanes, as a share of its device's peak."""
        one = self.engine(name)
        if one is None or name not in self.peak:
            return None
        return one.best.ticks_per_s * self.operations.per_lane / self.peak[name]

    def ratios(self) -> dict[str, dict[str, float]]:
        """Full ticks/s of each printing engine over every other's ticks/s or steps/s, each at its best."""
        others = {f"engine {one.engine}": one.best.ticks_per_s for one in self.engines}
        others |= {peer.name: peer.steps_per_s for peer in self.peers}
        return {
            one.engine: {
                name: one.best.ticks_per_s / rate for name, rate in others.items() if name != f"engine {one.engine}"
            }
            for one in self.engines
            if one.engine in PRINTING
        }

    def as_json(self) -> dict[str, Any]:
        """All numbers, those that follow from others included."""
        plain = dataclasses.asdict(self)
        for record, one in zip(plain["engines"], self.engines, strict=True):
            record["growth_s_and_s_per_run"] = one.growth
            record["peak_share"] = self.peak_share(one.engine)
            for batch, measured in zip(record["batches"], one.batches, strict=True):
                batch["ticks_per_s"] = measured.ticks_per_s
        for record, peer in zip(plain["peers"], self.peers, strict=True):
            record["steps_per_s"] = peer.steps_per_s
        plain["operations"] |= {"per_lane": self.operations.per_lane, "per_group": self.operations.per_group}
        plain["software"]["ticks_per_s"] = self.software.ticks_per_s
        plain["campaigns"]["growth_s_and_s_per_run"] = self.campaigns.growth
        return plain | {"ratios": self.ratios()}


def measure(effort: Effort = FULL, tell: Callable[[str], None] = lambda _: None) -> BenchFindings:
    """Measure; `tell` hears what comes next. Compiled code is neither taken from a cache nor left in one."""
    cores, before = len(os.sched_getaffinity(0)), _load()
    caching = jax.config.jax_enable_compilation_cache  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        engines, absent = _engines(effort, tell)
        tell("operations and peak")
        counted = operations.count(Workload(1000))
        peaks = {one.engine: peak.cuda() if one.engine == "cuda" else peak.cpu(cores) for one in engines
                 if one.engine in PRINTING}  # fmt: skip
        tell("mujoco.rollout")
        often = effort.repeats, effort.enough_s
        others = [peers.rollout(cores, ROLLOUT_ROBOTS, ROLLOUT_STEPS, *often)]
        tell("published model")
        euler = peers.published_model(EULER_STEPS, *often)
        tell("mjx.step")
        stepped = peers.apart(peers.mjx_step, effort.mjx_robots, MJX_STEPS, *often)
        if isinstance(stepped, str):
            absent["jax.vmap(mjx.step)"] = stepped
        else:
            others.append(stepped)
        tell("control software")
        alone = software.measure(SOFTWARE_CYCLES, INTERPRETED_CYCLES, *often)
        tell("campaigns")
        whole = _campaigns(engines[0], effort.campaign_runs)
        tell("from the shell")
        starts = start.measure()
    finally:
        jax.config.update("jax_enable_compilation_cache", caching)
    return BenchFindings(
        _machine(cores, before), engines, absent, counted, peaks, tuple(others), euler, whole, alone, starts
    )


def _engines(effort: Effort, tell: Callable[[str], None]) -> tuple[tuple[Speed, ...], dict[str, str]]:
    measured, absent = [], {}
    for name in FULL.sizes:
        if name not in effort.sizes:
            absent[name] = "left out of a quick run"
            continue
        engine = speed.find(name)
        if isinstance(engine, str):
            absent[name] = engine
            continue
        tell(f"engine {name}")
        work = Workload(effort.ticks[name])
        measured.append(speed.measure(engine, work, effort.sizes[name], effort.repeats, effort.enough_s))
    return tuple(measured), absent


def _campaigns(engine: Speed, sizes: tuple[int, ...]) -> Campaigns:
    ticks = engine.best.ticks
    before = os.environ.get(compile_cache.VARIABLE)
    os.environ[compile_cache.VARIABLE] = "off"
    try:
        seconds = {runs: clock.seconds(functools.partial(_campaign, runs, ticks, engine.engine)) for runs in sizes}
    finally:
        if before is None:
            del os.environ[compile_cache.VARIABLE]
        else:
            os.environ[compile_cache.VARIABLE] = before
    return Campaigns(engine.engine, ticks, seconds)


def _campaign(runs: int, ticks: int, engine: str) -> None:
    runner.run_campaign(workload.campaign(runs, ticks), None, engine)


def _load() -> float:
    try:
        return os.getloadavg()[0]
    except OSError:  # some systems keep none
        return float("nan")


def _machine(cores: int, before: float) -> BenchMachine:
    host, device = jit.host(), jax.devices()[0]
    system = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}, JAX {jax.__version__}"
    return BenchMachine(
        f"{_cpu_name()} ({host.cpu})", cores, host.vectors, host.width, system,
        f"{device.platform} {device.device_kind}", before, _load(),
    )  # fmt: skip


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "CPU"
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "CPU")
