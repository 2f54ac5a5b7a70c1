"""The findings as tables of text, and as a page of Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ravenjax.bench import findings, peers, text
from ravenjax.bench.scaling import Scaling
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
- Speeds and times are those of the least disturbed of several repeats; the median, or how far repeats lie apart, stands
  beside them. Other processes slow both: *others* says how many cores they kept busy.
- *start* is tracing and making the first kernel ready, nothing cached; *ready* is the part of it that follows tracing
  (of xla and mjx: XLA's compile time alone).
- *Peak* is measured in the same run: independent fused multiply-adds in registers on all cores (or the GPU), each
  counted as one operation, as in a tick; the best of many short bursts, so other processes hardly lower it. *share of
  peak* is operations in each run x ticks/s over it, and other processes do lower that.
- Over cores and devices each gets as much work however many there are. The *bare kernel* runs blocks that were made
  before; a *whole campaign* includes planning, the golden run and the result table, in memory. Ticks of a campaign that
  are its golden run's count as computed.
- Runs by when their fault strikes have their golden run in their time, but no planning and no tables.
- Commands *from the shell* are processes of their own, imports and all. The first has an empty cache; the next find
  there what it traced and compiled, with the same values of faults and varied parameters, and with others."""  # noqa: E501


def tables(found: BenchFindings) -> Iterator[Table]:
    """Each table of which there is something."""
    others = [
        (p.name, p.device, f"{p.robots}", f"{p.compile_s:.1f} s", text.millions(p.steps_per_s))
        for p in found.peers
    ]
    ratios = [
        (f"{name} / {other}", f"{ratio:,.0f}" if ratio >= 10 else f"{ratio:.2g}")
        for name, rates in found.ratios().items()
        for other, ratio in rates.items()
    ]
    every: list[Table] = [
        ("Machine", ("what", "is"), _machine(found)),
        (
            "From the shell",
            ("command", "s", "repeats", "median", "CPU s", "memory"),
            _starts(found),
        ),
        ("Engines: full ticks a second", _ENGINE_COLUMNS, _engines(found)),
        ("Cores: M full ticks a second", _scaling_columns("cores"), _scaling(found.cores)),
        ("GPUs: M full ticks a second", _scaling_columns("GPUs"), _scaling(found.devices)),
        (_fault_title(found), _FAULT_COLUMNS, _fault_times(found)),
        (
            "Growth with the number of runs",
            ("what", "fixed", "each further run"),
            list(_growth(found)),
        ),
        (
            "Peers: rigid-body steps a second of the same arm",
            ("what", "on", "robots", "compile", "M steps/s"),
            others,
        ),
        (
            "Target A2: one Euler step of the published three-joint model, one robot, one core",
            ("what", "us a step", "of the published time", "inside the band"),
            _a2(found),
        ),
        ("Ratios, each at its best", ("full ticks/s over", "times"), ratios),
        ("Control software alone: both arms, one core", _ALONE_COLUMNS, _alone(found)),
        ("Operations a tick", ("stage", "in each run", "shared by runs"), _operations(found)),
        ("What was not measured", ("part", "why"), _absent(found)),
        (
            "Time that each part took",
            ("part", "s", "of it measuring", "peak memory", "others"),
            _clocks(found),
        ),
    ]
    for table in every:
        if table[2]:
            yield table


def markdown(found: BenchFindings, command: str) -> str:
    """A page with the sentences and all tables."""
    return page(
        "How fast the engines are", command, findings.sentences(found), NOTES, tables(found)
    )


def page(title: str, command: str, lines: Sequence[str], notes: str, every: Iterable[Table]) -> str:
    """Sentences, notes and tables as Markdown."""
    written = (
        f"Written by `{command}`; the machine is named below."
        if notes
        else f"Written by `{command}`."
    )
    parts = [f"# {title}", written, "\n".join(f"- {line}" for line in lines), notes]
    for name, columns, rows in every:
        cells = [
            columns,
            tuple("---" for _ in columns),
            *(tuple(c.replace("|", r"\|") for c in row) for row in rows),
        ]
        parts += [f"## {name}", "\n".join(f"| {' | '.join(row)} |" for row in cells)]
    return "\n\n".join(filter(None, parts)) + "\n"


_ENGINE_COLUMNS = (
    "engine",
    "runs",
    "lanes of a block",
    "M ticks/s",
    "median",
    "start",
    "ready",
    "share of peak",
)
_ALONE_COLUMNS = ("how", "ticks/s", "us a tick", "times interpreted")
_FAULT_COLUMNS = ("fault at", "observed for", "a run takes", "repeats", "of a whole run")


def _a2(found: BenchFindings) -> list[tuple[str, ...]]:
    if found.published_model is None:
        return []
    published, ours = peers.PUBLISHED_EULER_S, 1.0 / found.published_model.steps_per_s
    verdict = "yes" if ours <= published else "NO"
    return [
        ("the authors' C++, DSN 2016, Figure 8", f"{published * 1e6:.3g}", "", ""),
        (
            "the same equations compiled by XLA",
            f"{ours * 1e6:.3g}",
            f"{ours / published:.2f}",
            verdict,
        ),
    ]


def _machine(found: BenchFindings) -> list[tuple[str, str]]:
    rows = []
    if (m := found.machine) is not None:
        threads = m.cores - m.real_cores
        rows = [
            ("CPU", f"{m.cpu}, {m.vectors} ({m.width} float32)"),
            (
                "cores used",
                text.several(m.real_cores, "real core")
                + (f" and {text.several(threads, 'hyper-thread')}" if threads else "")
                + (f" on {m.nodes} NUMA nodes" if m.nodes > 1 else "")
                + (
                    f"; its control group gives it the time of {m.quota:.3g}"
                    if m.quota < m.cores
                    else ""
                ),
            ),
            ("caches", ", ".join(m.caches) or text.UNKNOWN),
            ("memory", f"{m.memory_gb:.0f} GB" if m.memory_gb == m.memory_gb else text.UNKNOWN),
            ("GPUs", "; ".join(m.gpus) or "none"),
            ("system", m.system),
            ("packages", ", ".join(f"{name} {version}" for name, version in m.versions.items())),
            ("code", m.code[:12]),
        ]
    rows += [
        (
            "load average",
            f"{found.load_before:.1f} before, {found.load_after:.1f} after (its own work included)",
        )
    ]
    rows += [
        (f"peak, engine {name}", f"{rate / 1e9:,.0f} G operations/s, measured")
        for name, rate in found.peak.items()
    ]
    return rows + [
        (f"engine {one.engine}", f"{one.device}, {text.several(one.threads, 'block')} side by side")
        for one in found.engines
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
                    text.millions(batch.ticks_per_s),
                    text.millions(batch.ticks_per_s * batch.timing.best_s / batch.timing.median_s),
                    f"{speed.start_s:.1f} s" if first else "",
                    f"{speed.ready_s:.2f} s" if first else "",
                    text.percent(share) if best and share is not None else "",
                )
            )
    return rows


def _alone(found: BenchFindings) -> list[tuple[str, ...]]:
    if found.software is None:
        return []
    rates = found.software.ticks_per_s
    names = {
        "step": "compiled, a call each",
        "run": "compiled, many in a call",
        "interpreted": "interpreted",
    }
    return [
        (names[way], f"{rate:,.0f}", f"{1e6 / rate:.3g}", f"{rate / rates['interpreted']:.3g}")
        for way, rate in rates.items()
    ]


def _operations(found: BenchFindings) -> list[tuple[str, ...]]:
    if found.operations is None:
        return []
    lane, shared = found.operations.lane, found.operations.shared
    names = sorted({*lane, *shared}, key=lambda name: -lane.get(name, 0) - shared.get(name, 0))
    largest, others = names[:STAGES_SHOWN], names[STAGES_SHOWN:]
    rows = [(name, f"{lane.get(name, 0)}", f"{shared.get(name, 0)}") for name in largest]
    if others:
        of_lane, of_group = (sum(part.get(name, 0) for name in others) for part in (lane, shared))
        rows.append((f"{len(others)} others", f"{of_lane}", f"{of_group}"))
    return [*rows, ("all", f"{found.operations.per_lane}", f"{found.operations.per_group}")]


def _absent(found: BenchFindings) -> list[tuple[str, str]]:
    """Parts with the same reason in one row."""
    reasons = dict.fromkeys(found.absent.values())
    return [
        (", ".join(name for name, why in found.absent.items() if why == reason), reason)
        for reason in reasons
    ]


def _starts(found: BenchFindings) -> list[tuple[str, ...]]:
    return [
        (
            one.what,
            f"{one.seconds.smallest:.2f}",
            text.repeats(one.seconds),
            f"{one.seconds.median:.2f}",
            f"{one.cpu_s:.2f}",
            text.megabytes(one.peak_mb),
        )
        for one in found.starts
    ]


def _scaling_columns(what: str) -> tuple[str, ...]:
    return (
        what,
        "bare kernel",
        "of linear",
        "whole campaign",
        "of linear",
        "repeats of both",
        "runs",
    )


def _scaling(found: Scaling | None) -> list[tuple[str, ...]]:
    rows = []
    for point in found.points if found is not None else ():
        assert found is not None
        of_kernel, of_campaign = found.efficiency(point)
        rows.append(
            (
                f"{point.count}" + (", hyper-threads too" if point.shared else ""),
                text.millions(point.kernel.largest),
                text.percent(of_kernel),
                text.millions(point.campaign.largest),
                text.percent(of_campaign),
                f"{text.repeats(point.kernel)}; {text.repeats(point.campaign)}",
                f"{point.runs}",
            )
        )
    return rows


def _fault_title(found: BenchFindings) -> str:
    times = found.fault_times
    if times is None:
        return ""
    length = text.seconds(times.ticks / 1e3)
    return (
        f"Runs of {length} by when their fault strikes, engine {times.engine},"
        f" {text.several(times.runs, 'run')} each"
    )


def _fault_times(found: BenchFindings) -> list[tuple[str, ...]]:
    times = found.fault_times
    return [
        (
            f"{one.start_ms} ms",
            "the whole run" if one.observe_ms is None else f"{one.observe_ms} ms",
            text.seconds(one.run_s.smallest),
            text.repeats(one.run_s),
            text.percent(one.run_s.smallest / times.whole_s),
        )
        for one in (times.times if times is not None else ())
        if times is not None
    ]


def _clocks(found: BenchFindings) -> list[tuple[str, ...]]:
    rows = [
        (
            one.name,
            f"{one.seconds:.1f}",
            f"{one.measuring_s:.1f}",
            text.megabytes(one.peak_mb),
            f"{one.others:.1f} cores" if one.others == one.others else text.UNKNOWN,
        )
        for one in found.clocks
    ]
    return [*rows, ("all", f"{found.seconds:.1f}", "", "", "")] if rows else []


def _growth(found: BenchFindings) -> Iterator[tuple[str, ...]]:
    for speed in found.engines:
        if speed.growth is not None:
            fixed, marginal = speed.growth
            what = f"engine {speed.engine}, runs of {speed.best.ticks} ticks"
            yield what, f"{speed.start_s + max(0.0, fixed):.2f} s", f"{1e6 * marginal:.1f} us"
    if (whole := found.campaigns) is not None and len(whole.seconds) > 1:
        fixed, marginal = whole.growth
        sizes = ", ".join(
            f"{runs}: {text.seconds(seconds)}" for runs, seconds in whole.seconds.items()
        )
        what = (
            f"whole campaign, {whole.engine}, {whole.ticks} ticks ({sizes}; the first"
            f" {text.seconds(whole.first_s)})"
        )
        yield what, f"{fixed:.2f} s", f"{1e6 * marginal:.0f} us"
