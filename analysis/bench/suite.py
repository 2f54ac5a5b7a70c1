"""Runs the whole benchmark within a time limit, each part in a separate process. If time is short,
the last parts are omitted.
"""

import functools
import math
import os
import shlex
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench import commands, engines, machine, peers, process, scaling
from ravenjax.campaign import compile_cache
from ravenjax.errors import UserError

FULL_S, QUICK_S, LEAST_S = 160.0, 35.0, 5.0
"""s: default time of the whole benchmark, of a quick one, and least time."""
LATE_S, VISIBLE = 12.0, "CUDA_VISIBLE_DEVICES"
"""LATE_S: s that the last part may exceed its time before it is ended."""


class Part(NamedTuple):
    """One part of the benchmark, measured in a separate process."""

    name: str
    table: str  # table of its rows; `--only` takes this name
    work: Callable[..., list[dict[str, Any]]]  # maps (seconds to measure, then `arguments`) to rows
    fixed_s: float  # s on two idle cores before it measures: imports, tracing, compiling
    longest_s: float  # s to measure; more time would not improve the result
    arguments: tuple[Any, ...] = ()
    quick: bool = False  # also part of a quick run
    gpus: int = 0  # number of GPUs that it needs
    cached: bool = False  # uses compiled code of earlier parts, because it does not time it


def list_parts(gpus: int) -> list[Part]:
    """Return all parts, in the order in which they are measured, for a machine with `gpus` GPUs."""
    engine = engines.measure
    return [
        Part("engine cuda", "engines", engine, 8, 20, ("cuda",), True, gpus=1),
        Part("engine simd", "engines", engine, 4, 12, ("simd",), True),
        Part("commands", "shell", commands.measure, 9, 30, (), True),
        Part("large commands", "shell", commands.measure, 16, 40, (True,), gpus=1),
        Part("cores", "cores", scaling.measure_cores, 5, 30, cached=True),
        *(
            Part(f"{n} GPUs", "devices", scaling.measure_gpus, 10, 20, (n,), gpus=n, cached=True)
            for n in scaling.count_up(max(gpus, 1))
        ),
        Part("mujoco.rollout", "peers", peers.measure_rollout, 3, 8, (), True),
        Part("published model", "peers", peers.measure_published_model, 3, 2, (), True),
        Part("jax.vmap(mjx.step)", "peers", peers.measure_mjx_step, 30, 10),
        Part("MuJoCo Warp", "peers", peers.measure_mjx_step, 150, 10, ("warp",), gpus=1),
        Part("engine xla", "engines", engine, 30, 8, ("xla",)),
        Part("engine mjx", "engines", engine, 60, 8, ("mjx",)),
    ]


def measure(
    total_s: float,
    quick: bool = False,
    only: Sequence[str] = (),
    tell: Callable[[str], None] = lambda _: None,
    price: float | None = None,
) -> dict[str, list[dict[str, Any]]]:
    """Return rows by table, measured for about `total_s` seconds without the user's cache.

    `only`: limits the run to these tables. `tell` is called with the next part. `price`: of the
    machine, dollars an hour.
    """
    end, load = time.perf_counter() + total_s, os.getloadavg()[0]
    host, _ = process.call(machine.describe, environment={}, limit_s=total_s + LATE_S)
    visible = os.environ.get(VISIBLE) or ",".join(map(str, range(len(host["gpus"]))))
    gpus = visible.split(",")[: len(host["gpus"])]
    parts = [part for part in list_parts(len(gpus)) if not only or part.table in only]
    found: dict[str, list[dict[str, Any]]] = {}
    absent, clocks = list[dict[str, Any]](), list[dict[str, Any]]()
    due = [p for p in parts if p.gpus <= len(gpus) and (p.quick or only or not quick)]
    for part in parts:
        if part not in due:
            why = host["no_gpu"] if part.gpus > len(gpus) else "left out of a quick run"
            absent.append({"part": part.name, "why": why})
    with tempfile.TemporaryDirectory() as folder:
        for number, part in enumerate(due):
            began = time.perf_counter()
            left_s = end - began
            if left_s < part.fixed_s:
                why = f"left out: {max(left_s, 0.0):.0f} s were left; more with --seconds"
                absent.append({"part": part.name, "why": why})
                continue
            tell(part.name)
            clock = {"part": part.name, "measuring_s": share_time(left_s, due[number:])}
            environment = {compile_cache.VARIABLE: folder if part.cached else "off"}
            if part.table == "devices":
                environment[VISIBLE] = ",".join(gpus[: part.gpus])
            try:
                arguments, limit_s = (clock["measuring_s"], *part.arguments), left_s + LATE_S
                rows, clock["peak_mb"] = process.call(
                    part.work, *arguments, environment=environment, limit_s=limit_s
                )
                found.setdefault(part.table, []).extend(rows)
            except RuntimeError as error:
                absent.append({"part": part.name, "why": str(error)})
            clocks.append(clock | {"s": time.perf_counter() - began})
    if price is not None:
        for row in found.get("engines", []):
            # Runs of 10 s.
            row["cents_per_million_runs"] = 100 * price / 3600 * 1e10 / row["ticks_per_s"]
    host |= {"load_before": load, "load_after": os.getloadavg()[0]}
    machine_rows = [{"what": what, "is": value} for what, value in host.items()]
    follows = {"ratios": compute_ratios(found), "absent": absent, "clocks": clocks}
    return {"machine": machine_rows} | found | follows


def share_time(left_s: float, parts: Sequence[Part]) -> float:
    """Return the seconds that the first of the parts may measure, so that all of them fit."""
    spare = left_s - sum(part.fixed_s for part in parts)
    wanted = sum(part.longest_s for part in parts)
    return parts[0].longest_s * min(1.0, max(0.1, spare / wanted)) if wanted else 0.0


def compute_ratios(found: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return the ratios of the code-generating engines' ticks per second to all others' ticks or
    steps, each at its best.
    """
    rates: dict[str, float] = {}
    for row in found.get("peers", []):
        rates[row["peer"]] = max(row["steps_per_s"], rates.get(row["peer"], 0.0))
    for row in found.get("engines", []):
        rates[row["engine"]] = max(row["ticks_per_s"], rates.get(row["engine"], 0.0))
    return [
        {"engine": name, "over": other, "times": rates[name] / rate}
        for name in engines.PRINTING
        for other, rate in rates.items()
        if name in rates and other not in (name, peers.PUBLISHED)
    ]


TITLES = {
    "machine": "Machine",
    "shell": "From the shell",
    "engines": "Engines: full ticks a second",
    "cores": "Cores: full ticks a second",
    "devices": "GPUs: full ticks a second",
    "peers": "Peers: rigid-body steps a second of the same arm",
    "ratios": "Ratios, each at its best",
    "absent": "What was not measured",
    "clocks": "Time that each part took",
    "beside": "Two checkouts, seconds",
}


def make_tables(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, list[list[str]]]:
    """Return the lines of each table that has rows, by its title; the first names the columns."""
    tables = {}
    for name, title in TITLES.items():
        if rows := found.get(name):
            keys = list(dict.fromkeys(key for row in rows for key in row))
            cells = [[_text(row.get(key)) for key in keys] for row in rows]
            tables[title] = [[key.replace("_", " ") for key in keys], *cells]
    return tables


def write_markdown(title: str, command: str, tables: Mapping[str, list[list[str]]]) -> str:
    """Write a page of tables."""
    parts = [f"# {title}", f"Written by `{command}`."]
    for name, (heads, *rows) in tables.items():
        lines = (f"| {' | '.join(row)} |" for row in (heads, ["---"] * len(heads), *rows))
        parts += [f"## {name}", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    if isinstance(value, list) and value and isinstance(value[0], float):
        return f"{len(value)} times, {_text(min(value))} to {_text(max(value))}"
    if isinstance(value, list):
        return "; ".join(value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(one)}" for key, one in value.items())
    return str(value).replace("|", "\\|")


def bench(
    json: bool,
    quick: bool,
    markdown: Path | None,
    only: Sequence[str],
    seconds: float | None,
    price: float | None,
) -> int:
    """Run the benchmark and return the exit code of `ravenjax bench`."""
    from ravenjax.cli import console

    if markdown is not None and not markdown.absolute().parent.is_dir():
        raise UserError(f"--markdown {markdown}: expected a file in a folder that exists")
    if seconds is not None and not LEAST_S <= seconds < math.inf:
        raise UserError(f"--seconds {seconds:g}: expected at least {LEAST_S:g}")
    if price is not None and not price > 0.0:
        raise UserError(f"--price {price:g}: expected dollars an hour, more than 0")

    tell = functools.partial(console.err.print, "measuring:", markup=False, highlight=False)
    found = measure(seconds or (QUICK_S if quick else FULL_S), quick, only, tell, price)
    every = make_tables(found)
    if markdown is not None:
        command = shlex.join(["ravenjax", *sys.argv[1:]])
        markdown.write_text(write_markdown("How fast the engines are", command, every))
    if json:
        console.emit_json(found)
    else:
        for title, (columns, *rows) in every.items():
            console.print_table(title, tuple(columns), list(map(tuple, rows)))
            console.out.print()
    return int(not found.keys() & {part.table for part in list_parts(1)})
