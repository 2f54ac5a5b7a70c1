"""Simulates a campaign on 1 to 100 machines with the measured costs of costs.json, and writes
tables and a figure.

    python analysis/scale/machines.py

This is a discrete-event model of executor `ray`. One coordinator (a single-threaded Python process)
sends each chunk's rows. Workers compute the rows and make the part. The data return over the
coordinator's network link, and four writers store them. Each step is a queue with a number of
servers, and a chunk passes all steps in order. At most two chunks per worker are in progress, as in
the executor. For shards the times are added: each shard makes the plan, and the shards are merged
at the end.
"""

import heapq
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
MACHINES = (1, 2, 5, 10, 20, 50, 100)
CHUNKS = (1024, 4096, 16_384, 50_688, 202_752)
TICKS = 3000
"""Ticks of a run; 1 ms each."""
RUNS = 100_000_000
"""Runs of the largest campaign."""
LINK = 1.25e9
"""B/s of the coordinator's network, in each direction: 10 Gbit/s."""
WRITERS = 4
NETWORK_PUT = 0.03
"""s that a network file system needs in addition for a write that is flushed and renamed."""


@dataclass(frozen=True)
class Machine:
    """A kind of machine."""

    name: str
    seats: int  # tasks that run side by side
    ticks_per_s: float  # ticks per second of a seat
    # Runs that a seat computes at once: four blocks of 64 lanes, or a full GPU. Fewer runs take as
    # long.
    wave: int


@dataclass(frozen=True)
class Step:
    """The cost of one chunk at one queue."""

    queue: str
    seconds: float


class Queue:
    """A first-come, first-served queue with a number of servers."""

    def __init__(self, servers: int) -> None:
        self.free, self.busy = [0.0] * servers, 0.0

    def serve(self, now: float, seconds: float) -> float:
        """Return the time at which a job that arrives now is done."""
        done = max(now, self.free[0]) + seconds
        heapq.heapreplace(self.free, done)
        self.busy += seconds
        return done


def at(costs: dict[str, Any], name: str, chunk: int) -> float:
    """Return the cost of a chunk of `chunk` rows, by linear interpolation between measured costs.

    A smaller chunk costs no more than a larger one. If a measurement shows otherwise, another
    process disturbed it.
    """
    rows = [row["rows"] for row in costs["chunks"]]
    values = [row[name] for row in costs["chunks"]]
    return float(np.interp(chunk, rows, np.minimum.accumulate(values[::-1])[::-1]))


def kinds(costs: dict[str, Any]) -> tuple[Machine, Machine]:
    """Return the kinds of machines: 64 cores in tasks of four; eight H200 (analysis/engines/gpu.md:
    4 369 M ticks/s each, in waves of 50 688).
    """
    core = 1 / min(row["compute_s_per_tick"] for row in costs["chunks"])
    return Machine("64 cores", 16, 4 * core, 256), Machine("8 GPUs", 8, 4.369e9, 50_688)


def steps(costs: dict[str, Any], kind: Machine, chunk: int, ticks: int) -> list[Step]:
    """Return the queues that a chunk passes, in turn."""
    waves = -(-chunk // kind.wave) * kind.wave
    return [
        Step("coordinator", at(costs, "share_s", chunk) + costs["ray_task_s"]),
        Step("link out", at(costs, "share_bytes", chunk) / LINK),
        Step("seats", waves * ticks / kind.ticks_per_s + at(costs, "table_s", chunk)),
        Step("link in", at(costs, "part_bytes", chunk) / LINK),
        Step(
            "coordinator",
            at(costs, "receive_s", chunk)
            + at(costs, "put_cpu_s", chunk)
            + at(costs, "record_s", chunk),
        ),
        Step("writers", at(costs, "put_s", chunk)),
    ]


def simulate(way: list[Step], seats: int, chunks: int) -> tuple[list[float], dict[str, float]]:
    """Return (when each chunk is done, sorted; share of its time that each queue is busy once all
    run).
    """
    servers = {step.queue: 1 for step in way} | {"seats": seats, "writers": WRITERS}
    queues = {name: Queue(count) for name, count in servers.items()}
    begun, done = min(2 * seats, chunks), []
    events = [(0.0, 0, number) for number in range(begun)]  # (time, step that begins, chunk)
    while events:
        now, step, number = heapq.heappop(events)
        if step == len(way):
            done.append(now)
            continue
        # A task has ended, so the next one is sent.
        if way[step].queue == "link in" and begun < chunks:
            heapq.heappush(events, (now, 0, begun))
            begun += 1
        heapq.heappush(
            events, (queues[way[step].queue].serve(now, way[step].seconds), step + 1, number)
        )
    rate = steady(done)
    busy = {
        name: min(1.0, rate * sum(s.seconds for s in way if s.queue == name) / servers[name])
        for name in queues
    }
    return done, busy


def steady(done: list[float]) -> float:
    """Return chunks per second in the middle third of a campaign."""
    first, last = len(done) // 3, 2 * len(done) // 3
    return (last - first) / (done[last] - done[first]) if done[last] > done[first] else 0.0


def table(
    costs: dict[str, Any], kind: Machine, ticks: int
) -> Iterator[tuple[int, int, float, float, str]]:
    """Return (machines, chunk, runs/s, share of their computing rate, busiest queue) for each
    number and size.
    """
    for machines in MACHINES:
        for chunk in CHUNKS:
            seats = machines * kind.seats
            done, busy = simulate(steps(costs, kind, chunk, ticks), seats, 30 * seats)
            rate = steady(done)
            could = machines * kind.seats * kind.ticks_per_s / ticks
            yield (
                machines,
                chunk,
                rate * chunk,
                rate * chunk / could,
                max(busy, key=lambda name: busy[name]),
            )


def whole(
    costs: dict[str, Any], kind: Machine, machines: int, runs: int, chunk: int, ticks: int
) -> float:
    """Return the seconds of a campaign from the first chunk that is sent to the last that is
    stored.
    """
    done, _ = simulate(steps(costs, kind, chunk, ticks), machines * kind.seats, -(-runs // chunk))
    return done[-1]


def shards(costs: dict[str, Any], kind: Machine, machines: int, chunk: int) -> dict[str, float]:
    """Return the seconds of each step of the largest campaign, split into shards."""
    mine, parts = RUNS / machines, RUNS / machines / chunk
    per_chunk = steps(costs, kind, chunk, TICKS)[2].seconds
    return {
        "plan": costs["plan_s_per_million"] * RUNS / 1e6,
        "make ready": costs["ready_s"],
        "compute": mine * TICKS / (kind.seats * kind.ticks_per_s),
        "with tables": parts * per_chunk / kind.seats,
        "write": parts * (at(costs, "put_s", chunk) + NETWORK_PUT) / WRITERS,
        "merge": (
            RUNS
            / chunk
            * (
                2 * at(costs, "part_bytes", chunk) * costs["sha256_s_per_byte"] / 4
                + NETWORK_PUT / 4
            )
        ),
    }


def markdown(costs: dict[str, Any]) -> str:
    """Return the tables in Markdown."""
    out = []
    for kind in kinds(costs):
        out += [
            f"Machines of {kind.name}, runs of {TICKS / 1000:g} s, executor `ray`: M runs/s, and"
            " the share of what the "
        ]
        out += ["machines could compute, by rows of a chunk; in brackets what is busiest.", ""]
        out += [
            "| machines | " + " | ".join(f"{chunk}" for chunk in CHUNKS) + " |",
            "|---" * (len(CHUNKS) + 1) + "|",
        ]
        cells: dict[int, list[str]] = {}
        for machines, _, rate, share, busiest in table(costs, kind, TICKS):
            cells.setdefault(machines, []).append(f"{rate / 1e6:.3g}, {share:.0%} ({busiest})")
        out += [f"| {machines} | " + " | ".join(row) + " |" for machines, row in cells.items()] + [
            ""
        ]
    out += [
        (
            "A million runs of 30 s on machines of 64 cores, s without planning and making ready,"
            " by rows of a chunk:"
        ),
        "",
    ]
    some = (128, 512, 2048, 8192, 15_625)
    out += [
        "| machines | " + " | ".join(f"{chunk}" for chunk in some) + " |",
        "|---" * (len(some) + 1) + "|",
    ]
    for machines in (1, 10, 100):
        found = (
            whole(costs, kinds(costs)[0], machines, 10**6, chunk, 10 * TICKS) for chunk in some
        )
        out += [f"| {machines} | " + " | ".join(f"{value:.3g}" for value in found) + " |"]
    out += [""]
    names = shards(costs, kinds(costs)[0], 1, 4096)
    out += [
        f"Shards: {RUNS / 1e6:.0f} M runs of {TICKS / 1000:g} s, chunks of {CHUNKS[-2]} rows:",
        "",
    ]
    out += ["| machines | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for kind in kinds(costs):
        for machines in (1, 10, 100):
            found = shards(costs, kind, machines, CHUNKS[-2]).values()
            out += [
                f"| {machines} x {kind.name} | "
                + " | ".join(f"{value:.3g} s" for value in found)
                + " |"
            ]
    return "\n".join(out) + "\n"


def draw(costs: dict[str, Any]) -> None:
    """Draw runs per second over machines, for each chunk size. The dashed line is their computing
    rate.
    """
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from ravenjax.document.figure_style import SOFT, STYLE

    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(7.5, 3.2), layout="constrained", sharex=True)
        for axis, kind in zip(axes, kinds(costs), strict=True):
            found = list(table(costs, kind, TICKS))
            for chunk, colour in zip(
                CHUNKS, ("#c8d5e3", "#8fb0cf", "#4f83b5", "#1d4e80", "#0a1f36"), strict=True
            ):
                line = [(m, runs) for m, c, runs, *_ in found if c == chunk]
                axis.loglog(
                    *zip(*line, strict=True),
                    color=colour,
                    label=f"{chunk:,} runs".replace(",", " "),
                )
            could = [m * kind.seats * kind.ticks_per_s / TICKS for m in MACHINES]
            axis.loglog(MACHINES, could, "--", color=SOFT, label="what they could compute")
            axis.set(
                title=f"machines of {kind.name}",
                xlabel="machines",
                ylabel=f"runs of {TICKS // 1000} s a second",
            )
        axes[0].legend(title="chunk", fontsize=7)
        figure.savefig(HERE / "machines.svg", metadata={"Date": None})


if __name__ == "__main__":
    measured = json.loads((HERE / "costs.json").read_text())
    draw(measured)
    print(markdown(measured))
