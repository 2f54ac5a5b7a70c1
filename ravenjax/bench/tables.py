"""The findings as tables of text, and as a page of Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from ravenjax.bench import peers
from ravenjax.bench.suite import BenchFindings

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, columns, rows."""
STAGES_SHOWN = 12

NOTES = """\
- A *full tick* is one millisecond of one arm with everything in it: console, network, control software, one fault slot,
  motors, cables, links, nominal model, monitor, cue. A *step* of a peer is its rigid-body dynamics alone, with limits
  and contacts off.
- Batches run as campaigns run them: blocks side by side on all cores this process may use, the golden run
  computed before. No two runs are alike. What runs share is computed once for all of them, as in a campaign.
- Speeds are those of the least disturbed of several repeats; the median stands beside them. Other processes slow
  both: the load average says how many ran.
- *start* is tracing and making the first kernel ready, nothing cached; *ready* is the part of it that follows tracing
  (of xla and mjx: XLA's compile time alone).
- *Peak* is measured in the same run: independent fused multiply-adds in registers on all cores (or the GPU), each
  counted as one operation, as in a tick; the best of many short bursts, so other processes hardly lower it. *share of
  peak* is operations in each run x ticks/s over it, and other processes do lower that.
- A whole campaign includes planning, tracing, compiling, running and the result table, all in memory.
- Commands *from the shell* are processes of their own, imports and all. The first has an empty cache; the next find
  there what it traced and compiled, with the same values of faults and varied parameters, and with others."""


def tables(found: BenchFindings) -> Iterator[Table]:
    """Each table."""
    yield "Machine", ("what", "is"), _machine(found)
    yield "Engines: full ticks a second", _ENGINE_COLUMNS, _engines(found)
    others = [(p.name, p.device, f"{p.robots}", f"{p.compile_s:.1f} s", _millions(p.steps_per_s)) for p in found.peers]
    yield "Peers: rigid-body steps a second of the same arm", ("what", "on", "robots", "compile", "M steps/s"), others
    yield "Target A2: one Euler step of the published three-joint model, one robot, one core", _A2_COLUMNS, _a2(found)
    ratios = [
        (f"{name} / {other}", f"{ratio:,.0f}" if ratio >= 10 else f"{ratio:.2g}")
        for name, others in found.ratios().items()
        for other, ratio in others.items()
    ]
    yield "Ratios, each at its best", ("full ticks/s over", "times"), ratios
    yield (
        "Control software alone: both arms, one core",
        ("how", "ticks/s", "us a tick", "times interpreted"),
        _alone(found),
    )
    yield "Operations a tick", ("stage", "in each run", "shared by runs"), _operations(found)
    yield "From the shell", ("command", "s", "CPU s", "peak memory"), _starts(found)
    yield "Growth with the number of runs", ("what", "fixed", "each further run"), list(_growth(found))


def markdown(found: BenchFindings, command: str) -> str:
    """A page with all tables."""
    parts = ["# How fast the engines are", f"Written by `{command}`; the machine is named below.", NOTES]
    for title, columns, rows in tables(found):
        lines = [columns, tuple("---" for _ in columns), *rows]
        parts += [f"## {title}", "\n".join(f"| {' | '.join(line)} |" for line in lines)]
    return "\n\n".join(parts) + "\n"


_ENGINE_COLUMNS = ("engine", "runs", "lanes of a block", "M ticks/s", "median", "start", "ready", "share of peak")


_A2_COLUMNS = ("what", "us a step", "of the published time", "inside the band")


def _a2(found: BenchFindings) -> list[tuple[str, ...]]:
    published, ours = peers.PUBLISHED_EULER_S, 1.0 / found.published_model.steps_per_s
    verdict = "yes" if ours <= published else "NO"
    return [
        ("the authors' C++, DSN 2016, Figure 8", f"{published * 1e6:.3g}", "", ""),
        ("the same equations compiled by XLA", f"{ours * 1e6:.3g}", f"{ours / published:.2f}", verdict),
    ]


def _machine(found: BenchFindings) -> list[tuple[str, str]]:
    m = found.machine
    rows = [
        ("CPU", f"{m.cpu}, {m.cores} cores used, {m.vectors} ({m.width} float32)"),
        ("system", m.system),
        ("JAX runs on", m.jax_device),
        ("load average", f"{m.load_before:.1f} before, {m.load_after:.1f} after (the benchmark's own work included)"),
    ]
    rows += [
        (f"peak, engine {name}", f"{rate / 1e9:,.0f} G operations/s, measured") for name, rate in found.peak.items()
    ]
    rows += [
        (f"engine {speed.engine}", f"{speed.device}, {speed.threads} blocks side by side") for speed in found.engines
    ]
    return rows + [
        (f"engine {name}" if name.isidentifier() else name, f"not timed: {why}") for name, why in found.absent.items()
    ]


def _engines(found: BenchFindings) -> list[tuple[str, ...]]:
    rows = []
    for speed in found.engines:
        share = found.peak_share(speed.engine)
        for batch in speed.batches:
            first, best = batch is speed.batches[0], batch is speed.best
            rows.append(
                (
                    speed.engine,
                    f"{batch.runs}",
                    f"{batch.lanes}",
                    _millions(batch.ticks_per_s),
                    _millions(batch.ticks_per_s * batch.timing.best_s / batch.timing.median_s),
                    f"{speed.start_s:.1f} s" if first else "",
                    f"{speed.ready_s:.2f} s" if first else "",
                    f"{100 * share:.0f} %" if best and share is not None else "",
                )
            )
    return rows


def _alone(found: BenchFindings) -> list[tuple[str, ...]]:
    rates = found.software.ticks_per_s
    names = {"step": "compiled, a call each", "run": "compiled, many in a call", "interpreted": "interpreted"}
    return [
        (names[way], f"{rate:,.0f}", f"{1e6 / rate:.3g}", f"{rate / rates['interpreted']:.3g}")
        for way, rate in rates.items()
    ]


def _operations(found: BenchFindings) -> list[tuple[str, ...]]:
    lane, shared = found.operations.lane, found.operations.shared
    names = sorted({*lane, *shared}, key=lambda name: -lane.get(name, 0) - shared.get(name, 0))
    largest, others = names[:STAGES_SHOWN], names[STAGES_SHOWN:]
    rows = [(name, f"{lane.get(name, 0)}", f"{shared.get(name, 0)}") for name in largest]
    if others:
        of_lane, of_group = (sum(part.get(name, 0) for name in others) for part in (lane, shared))
        rows.append((f"{len(others)} others", f"{of_lane}", f"{of_group}"))
    return [*rows, ("all", f"{found.operations.per_lane}", f"{found.operations.per_group}")]


def _starts(found: BenchFindings) -> list[tuple[str, ...]]:
    return [(one.what, f"{one.seconds:.2f}", f"{one.cpu_s:.2f}", f"{one.peak_mb:.0f} MB") for one in found.starts]


def _growth(found: BenchFindings) -> Iterator[tuple[str, ...]]:
    for speed in found.engines:
        if speed.growth is not None:
            fixed, marginal = speed.growth
            what = f"engine {speed.engine}, runs of {speed.best.ticks} ticks"
            yield what, f"{speed.start_s + max(0.0, fixed):.2f} s", f"{1e6 * marginal:.1f} us"
    whole = found.campaigns
    fixed, marginal = whole.growth
    sizes = ", ".join(f"{runs}: {seconds:.2f} s" for runs, seconds in whole.seconds.items())
    yield f"whole campaign, {whole.engine}, {whole.ticks} ticks ({sizes})", f"{fixed:.2f} s", f"{1e6 * marginal:.0f} us"


def _millions(rate: float) -> str:
    return f"{rate / 1e6:,.0f}" if rate >= 1e8 else f"{rate / 1e6:.3g}"
