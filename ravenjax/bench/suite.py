"""The whole benchmark in one run, part by part, within a time."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ravenjax.bench import apart, clock, devices, machine, parts, placement
from ravenjax.bench.apart import Answer
from ravenjax.bench.campaigns import Campaigns
from ravenjax.bench.effort import Allotment
from ravenjax.bench.fault_times import FaultTimes
from ravenjax.bench.machine import BenchMachine
from ravenjax.bench.operations import Operations
from ravenjax.bench.parts import BenchPart
from ravenjax.bench.peers import Peer
from ravenjax.bench.scaling import Scaling
from ravenjax.bench.software import SoftwareSpeed
from ravenjax.bench.speed import PRINTING, Speed
from ravenjax.bench.start import ShellStart
from ravenjax.campaign import compile_cache

LATE_S = 12.0
"""s that the last part may be late before it is ended."""
_KEEPING = ("cores", "devices", "fault_times")
"""Parts that may take from each other what is traced and compiled: they time none of it."""


@dataclasses.dataclass(frozen=True)
class PartClock:
    """What it took to measure a part."""

    name: str
    seconds: float  # s, of which
    measuring_s: float  # s it was to measure
    peak_mb: float  # MB, resident, of its process
    others: float  # cores that other processes of the machine kept busy meanwhile; nan: not told


@dataclasses.dataclass(frozen=True)
class BenchFindings:
    """Everything that one benchmark found; None, or not there, is what was left out or failed:
    `absent` says why.
    """

    machine: BenchMachine | None
    load_before: (
        float  # processes running, mean over the minute before the benchmark; nan: not told
    )
    load_after: float
    clocks: tuple[PartClock, ...] = ()
    absent: Mapping[str, str] = dataclasses.field(
        default_factory=dict
    )  # part -> why there is nothing of it
    engines: tuple[Speed, ...] = ()
    operations: Operations | None = None
    peak: Mapping[str, float] = dataclasses.field(
        default_factory=dict
    )  # printing engine -> operations/s of its device
    peers: tuple[Peer, ...] = ()
    published_model: Peer | None = None  # its three joints alone
    campaigns: Campaigns | None = None
    software: SoftwareSpeed | None = None
    starts: tuple[ShellStart, ...] = ()  # whole commands from the shell
    cores: Scaling | None = None
    devices: Scaling | None = None
    fault_times: FaultTimes | None = None

    def engine(self, name: str) -> Speed | None:
        """The speed of an engine, if it was timed."""
        return next((one for one in self.engines if one.engine == name), None)

    def peak_share(self, name: str) -> float | None:
        """Operations a second of an engine's lanes, as a share of its device's peak."""
        one = self.engine(name)
        if one is None or name not in self.peak or self.operations is None:
            return None
        return one.best.ticks_per_s * self.operations.per_lane / self.peak[name]

    def ratios(self) -> dict[str, dict[str, float]]:
        """Full ticks/s of each printing engine over every other's ticks/s or steps/s, each at
        its best.
        """
        others = {f"engine {one.engine}": one.best.ticks_per_s for one in self.engines}
        others |= {peer.name: peer.steps_per_s for peer in self.peers}
        return {
            one.engine: {
                name: one.best.ticks_per_s / rate
                for name, rate in others.items()
                if name != f"engine {one.engine}"
            }
            for one in self.engines
            if one.engine in PRINTING
        }

    @property
    def is_empty(self) -> bool:
        """Whether no part has a result."""
        return all(one.name in self.absent for one in self.clocks)

    @property
    def seconds(self) -> float:
        """s of all parts."""
        return sum(one.seconds for one in self.clocks)

    def as_json(self) -> dict[str, Any]:
        """All numbers, those that follow from others included."""
        plain = dataclasses.asdict(self)
        if self.machine is not None:
            plain["machine"] |= {"load_before": self.load_before, "load_after": self.load_after}
        for record, one in zip(plain["engines"], self.engines, strict=True):
            record["growth_s_and_s_per_run"] = one.growth
            record["peak_share"] = self.peak_share(one.engine)
            for batch, measured in zip(record["batches"], one.batches, strict=True):
                batch["ticks_per_s"] = measured.ticks_per_s
        for record, peer in zip(plain["peers"], self.peers, strict=True):
            record["steps_per_s"] = peer.steps_per_s
        if self.operations is not None:
            plain["operations"] |= {
                "per_lane": self.operations.per_lane,
                "per_group": self.operations.per_group,
            }
        if self.software is not None:
            plain["software"]["ticks_per_s"] = self.software.ticks_per_s
        if self.campaigns is not None:
            plain["campaigns"]["growth_s_and_s_per_run"] = self.campaigns.growth
        if self.fault_times is not None:
            base, slope = self.fault_times.line
            plain["fault_times"] |= {"run_s": base, "run_s_per_s_after_fault": slope}
        for name, scaling in (("cores", self.cores), ("devices", self.devices)):
            if scaling is not None:
                for record, point in zip(plain[name]["points"], scaling.points, strict=True):
                    record["kernel_efficiency"], record["campaign_efficiency"] = scaling.efficiency(
                        point
                    )
        return plain | {"ratios": self.ratios(), "seconds": self.seconds}


def measure(
    total_s: float,
    quick: bool = False,
    only: Sequence[parts.Name] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> BenchFindings:
    """Measure for about `total_s` seconds; `tell` hears what comes next.

    only: these parts alone. Compiled code is neither taken from the user's cache nor left in it.
    """
    before, allotment, values = load(), Allotment(total_s), dict[str, Any]()
    absent, clocks = dict[str, str](), list[PartClock]()
    host = apart.run(machine.describe, limit_s=total_s)
    allotment.done(parts.MACHINE_COST, 0.0, host.seconds)
    if host.why:
        absent[parts.MACHINE] = host.why
    gpus = placement.visible_gpus(len(host.value.gpus)) if host.value is not None else []
    due = parts.wanted(quick, only, len(gpus))
    if not gpus:
        why = host.value.no_gpu if host.value is not None else "the machine is not known"
        absent |= {part.name: why for part in due if part.needs_gpu}
        due = [part for part in due if not part.needs_gpu]
    with tempfile.TemporaryDirectory() as folder:
        while due:
            part, *due = due
            started, others = time.perf_counter(), clock.Bystanders()
            share = allotment.share(part.cost, [one.cost for one in due])
            if share is None:
                absent[part.name] = _no_time(part, allotment)
                continue
            tell(part.what)
            answer = _answer(part, share, allotment, folder, gpus)
            spent = time.perf_counter() - started
            if answer.why:
                absent[part.name] = answer.why
            else:
                values[part.name] = answer.value
            clocks.append(PartClock(part.name, spent, share, answer.peak_mb, others.cores()))
            allotment.done(part.cost, share, spent)
    absent |= {
        part.name: "left out of a quick run"
        for part in parts.PARTS
        if quick and not only and not part.quick
    }
    return _findings(host.value, before, clocks, absent, values)


def _answer(
    part: BenchPart, share: float, allotment: Allotment, folder: str, gpus: Sequence[str]
) -> Answer:
    """Of one part, in a process of its own; it is ended where it takes far longer than it may."""
    environment = {compile_cache.VARIABLE: folder if part.name in _KEEPING else "off"}
    if part.name == parts.DEVICES:
        return _of_devices(share, allotment.left_s + LATE_S, environment, gpus)
    limit = min(allotment.left_s + LATE_S, 20.0 + 4.0 * allotment.needs(part.cost) + 2.0 * share)
    return apart.run(part.work, share, *part.arguments, limit_s=limit, environment=environment)


def _of_devices(
    share: float, limit_s: float, environment: Mapping[str, str], gpus: Sequence[str]
) -> Answer:
    """Here is only waited: each number of devices has its own process."""
    try:
        return Answer(devices.measure(share, gpus, environment, limit_s), "", 0.0, float("nan"))
    except RuntimeError as error:
        return Answer(None, str(error), 0.0, float("nan"))


def _no_time(part: BenchPart, allotment: Allotment) -> str:
    return (
        f"left out: {max(0.0, allotment.left_s):.0f} s were left, it takes"
        f" {allotment.needs(part.cost):.0f} s; more with --seconds"
    )


def _findings(
    host: BenchMachine | None,
    before: float,
    clocks: Sequence[PartClock],
    absent: Mapping[str, str],
    values: Mapping[str, Any],
) -> BenchFindings:
    """Each value where it belongs."""
    return BenchFindings(
        machine=host,
        load_before=before,
        load_after=load(),
        clocks=tuple(clocks),
        absent=absent,
        engines=tuple(value for value in values.values() if isinstance(value, Speed)),
        peak={
            name.removeprefix("peak "): value
            for name, value in values.items()
            if name.startswith("peak ")
        },
        peers=tuple(
            v for name, v in values.items() if isinstance(v, Peer) and name != "published_model"
        ),
        starts=(*values.get("starts", ()), *values.get("large_starts", ())),
        operations=values.get("operations"),
        published_model=values.get("published_model"),
        campaigns=values.get("campaigns"),
        software=values.get("software"),
        cores=values.get("cores"),
        devices=values.get("devices"),
        fault_times=values.get("fault_times"),
    )


def load() -> float:
    """Processes that run or wait to, mean over the last minute."""
    try:
        return os.getloadavg()[0]
    except OSError:  # some systems keep none
        return float("nan")
