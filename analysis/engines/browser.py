"""Compares engine wasm with simd: speed in a browser and natively by threads, size of a page's
code, and agreement of verdicts.

    python analysis/engines/browser.py       # some minutes; needs chromium and playwright

Prints tables in Markdown; `wasm.md` keeps them.
"""

import base64
import contextlib
import dataclasses
import gzip
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from playwright.sync_api import sync_playwright

import ravenjax as rj
from ravenjax.analyses.explorer import program
from ravenjax.campaign import outcomes
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.plan import Plan
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel
from ravenjax.engines.interface import Engine, TickProgram

COUNTS = sorted({1, 2, len(os.sched_getaffinity(0))})
RUNS = 1024
OPEN = """async ([description, threads, faults]) => {
  const compiling = performance.now();
  await WebAssembly.compile(Uint8Array.from(atob(description.programs.outcomes.binary), (c) => c.codePointAt(0)));
  const compiled = performance.now();
  window.engine = await openEngine(description, { threads });
  await engine.outcomes(engine.question(), faults.slice(0, 64));
  window.ask = async () => {
    await engine.outcomes(engine.question(), faults);
  };
  return compiled - compiling;
}"""  # noqa: E501


class Unfused(SimdEngine):
    """Engine simd, with the CPU's fused multiply-add unused."""

    def compile(self, program: TickProgram, runs: int) -> SimdKernel:
        kernel = super().compile(program, runs)
        host = jit.host_target()
        kernel._host = dataclasses.replace(host, features=host.features - {"fma"})
        return kernel


class Narrow(SimdEngine):
    """Engine simd without fused multiply-add, with vectors as wide as WebAssembly's, on any CPU of
    this kind.
    """

    def compile(self, program: TickProgram, runs: int) -> SimdKernel:
        kernel = super().compile(program, runs)
        host = jit.host_target()
        features = {name for name in host.features if not name.startswith("avx")} - {
            "fma",
            "fma4",
            "f16c",
        }
        kernel._host = dataclasses.replace(host, features=frozenset(features))
        kernel.width = kernel.branches = kernel._host.width
        return kernel


class Seconds(NamedTuple):
    """Duration of some work: by the clock, and in processor time, which other work on the machine
    slows far less.
    """

    clock: float
    processor: float


def processor_s() -> float:
    """Return seconds of processor time that this process and its child processes have used."""
    ticks, parents = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            parents[int(path.parent.name)] = int(fields[1])
            ticks[int(path.parent.name)] = int(fields[11]) + int(fields[12])
    ours = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(ticks.get(pid, 0) for pid in ours) / os.sysconf("SC_CLK_TCK")


def timed(work: Callable[[], object]) -> Seconds:
    """Return the best of three separate timings."""
    best = Seconds(float("inf"), float("inf"))
    for _ in range(3):
        start, used = time.perf_counter(), processor_s()
        work()
        best = Seconds(
            min(best.clock, time.perf_counter() - start), min(best.processor, processor_s() - used)
        )
    return best


def faults_of(ready: Plan, runs: np.ndarray) -> list[dict[str, Any]]:
    """Return runs of a plan in the form in which a page requests them."""
    rows = ready.rows.iloc[runs]
    names = ("site", "arm", "channel", "effect", "value", "start_ms", "duration_ms")
    table = pd.DataFrame({name: rows[f"fault0_{name}"].astype(object) for name in names})
    return table.where(table.notna(), None).to_dict("records")


def some(ready: Plan, runs: np.ndarray) -> Plan:
    """Return the plan of some runs of one golden run."""
    return dataclasses.replace(
        ready,
        rows=ready.rows.take(runs),
        faults={name: values[runs] for name, values in ready.faults.items()},
        varied={path: values[runs] for path, values in ready.varied.items()},
        golden=np.zeros(len(runs), np.int32),
    )


def native(ready: Plan, engine: Engine, threads: int) -> Seconds:
    """Return the seconds of all runs, with code generated before."""
    work = Computation(ready, engine, threads=threads)
    return timed(lambda: list(work.blocks([range(ready.runs)])))


def in_browser(
    description: dict[str, Any], faults: list[dict[str, Any]]
) -> tuple[dict[int, Seconds], float, str]:
    """Return seconds by threads, the ms in which the browser compiles, and the browser's name."""
    script = Path(program.__file__).with_name("static").joinpath("engine.js").read_text()
    end = "window.openEngine = openEngine; window.loaded = true"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page = Path(folder) / "index.html"
        page.write_text(f'<script type="module">{script}\n{end}</script>')
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        window = browser.new_page()
        window.goto(page.as_uri())
        window.wait_for_function("window.loaded")
        compiling, seconds = float("inf"), {}
        for threads in COUNTS:
            compiling = min(compiling, window.evaluate(OPEN, [description, threads, faults]))
            seconds[threads] = timed(lambda: window.evaluate("ask()"))
            window.evaluate("engine.close()")
        version = f"Chromium {browser.version}"
        browser.close()
    return seconds, compiling, version


def speed(ready: Plan, description: dict[str, Any]) -> None:
    """Compare speeds over the same complete runs: rows of quick.toml that share a golden run."""
    faulty = np.flatnonzero(
        (ready.golden == np.bincount(ready.golden).argmax()) & (ready.faults["code"][:, 0] > 0)
    )
    runs = faulty[np.linspace(0, len(faulty) - 1, RUNS).astype(int)]
    part, ticks = some(ready, runs), RUNS * ready.program.ticks
    seconds, compiling, version = in_browser(description, faults_of(ready, runs))
    engines = {
        "simd, 128-bit vectors, no fusion": Narrow(),
        f"simd, {jit.host_target().vectors}, no fusion": Unfused(),
        f"simd, {jit.host_target().vectors}": SimdEngine(),
    }
    rows = {f"wasm, {version}": seconds}
    rows |= {
        name: {count: native(part, engine, count) for count in COUNTS}
        for name, engine in engines.items()
    }
    print(
        f"{RUNS} runs of {ready.program.ticks} ms on {jit.host_target().cpu}, {os.cpu_count()}"
        " cores.\n"
    )
    heads = [
        f"{count} thread{'s' * (count > 1)}, {of}"
        for of in ("processor", "clock")
        for count in COUNTS
    ]
    print("| M ticks/s | " + " | ".join(heads) + " |\n|---|" + "---|" * len(heads))
    for name, of in rows.items():
        numbers = [of[count].processor for count in COUNTS] + [of[count].clock for count in COUNTS]
        print(
            f"| {name} | " + " | ".join(f"{ticks / number / 1e6:.2f}" for number in numbers) + " |"
        )
    print(f"\nThe browser compiles the code of outcomes in {compiling:.0f} ms.\n")
    print("| code of a page | bytes | gzip |\n|---|---|---|")
    for name, one in description["programs"].items():
        binary = base64.b64decode(one["binary"])
        print(f"| {name} | {len(binary):,} | {len(gzip.compress(binary)):,} |")


def table(config: Any, ready: Plan, engine: Engine) -> pd.DataFrame:
    """Return the result table."""
    parts = list(Computation(ready, engine).blocks([range(ready.runs)]))
    own, golden = (
        {name: np.concatenate([part[k][name] for part in parts]) for name in parts[0][k]}
        for k in range(2)
    )
    return pd.DataFrame(outcomes.result_columns(config, ready.rows, own, golden))


def agreement(config: Any, ready: Plan) -> None:
    """Return verdicts and differences of all of quick.toml."""
    unfused, fused = (table(config, ready, engine) for engine in (Unfused(), SimdEngine()))
    print(f"\n{len(fused)} runs.\n\n| simd without and with fusion | |\n|---|---|")
    names = (
        "verdict",
        "response",
        "hazard",
        "response_cause",
        "response_ms",
        "unintended_first_ms",
        "active_ticks",
    )
    for name in names:
        share = (unfused[name].to_numpy() == fused[name].to_numpy()).mean()
        print(f"| runs with equal `{name}` | {share:.2%} |")
    for name in (
        "peak_golden_deviation_mm",
        "peak_model_deviation_mm",
        "unintended_mm",
        "cue0_peak_force",
    ):
        ours, theirs = (frame[name].to_numpy(float) for frame in (unfused, fused))
        apart = np.abs(ours - theirs)
        most = apart.argmax()
        largest = f"{apart[most]:.2g} ({ours[most]:.4g} and {theirs[most]:.4g})"
        print(
            f"| `{name}`: median, 99 %, largest difference | {np.median(apart):.2g},"
            f" {np.quantile(apart, 0.99):.2g}, {largest} |"
        )


def main() -> None:
    """Print everything."""
    config = rj.load_campaign("quick", ["campaign.packets=every_cycle"])
    ready = program.question_plan(config)
    speed(ready, program.describe_program(config))
    agreement(config, ready)


if __name__ == "__main__":
    main()
