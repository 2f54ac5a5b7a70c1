"""Runs a campaign of an arm from an MJCF file on every engine that this machine has, beside
`mujoco.rollout` of the same model. Prints a Markdown table.

    python analysis/engines/arm_beside.py [--runs 10000] [--seconds 2] [--engines simd cuda mjx]

The campaign is arm_beside.toml: faults of a KUKA LBR iiwa 14 at every site. Columns:

- equal verdicts: runs with the verdict of engine simd
- apart: largest difference from simd of a run's largest distance from its golden run
- first, again: seconds of the whole campaign, with planning, compilation and the result table
- full ticks: rate of the engine's kernel alone, in which every lane runs from the beginning

A full tick has packets, checks, controller, faults, arm, nominal model and monitor. A step of
`mujoco.rollout` has the arm and its servos only. Constraints are off, so that MuJoCo needs no
solver. The best of all numbers of robots, and of robots in a task, is printed.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import ravenjax as rj
from bench import peers, workload
from ravenjax.campaign import compile_cache, plan
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, Kernel
from ravenjax.errors import UserError
from ravenjax.numbers.setup import CAMPAIGN

FILE = Path(__file__).with_suffix(".toml")
GROUPS = 5
TIMED_S = 10.0
"""Seconds for the timing of a kernel, if one pass takes less."""


def load(runs: int, seconds: float) -> rj.CampaignConfig:
    """Return the campaign with at least this many runs of this many seconds."""
    drawn = [f"group.{k}.runs={-(-runs // GROUPS)}" for k in range(GROUPS)]
    return rj.load_campaign(FILE, [f"campaign.duration_s={seconds}", *drawn])


def kernel_rate(config: Any, name: str) -> float:
    """Return full ticks a second of an engine's kernel."""
    ready = plan.make_plan(config)
    engine = selection.select_engine(name, CAMPAIGN)
    kernel = engine.compile(ready.program, ready.runs)
    blocks = list(_blocks(ready, kernel))
    kernel.prepare(blocks[0], ready.columns)

    def work() -> None:
        with ThreadPoolExecutor(engine.threads) as pool:
            list(pool.map(lambda block: kernel.run(block, ready.columns), blocks))

    work()
    return ready.runs * ready.program.ticks / min(workload.repeat(work, TIMED_S))


def _blocks(ready: plan.Plan, kernel: Kernel) -> Iterator[Block]:
    size = kernel.size(1)
    golden = kernel.run(Block(*ready.lanes([0], size, harmless=True), None), ready.columns)
    reference = golden.reference[:, :, :1]
    for first in range(0, ready.runs, kernel.lanes):
        rows = np.arange(first, min(first + kernel.lanes, ready.runs))
        lanes = kernel.size(len(rows))
        yield Block(*ready.lanes(rows, lanes), reference, np.zeros(lanes, int))


def main() -> int:
    """Print the table. The exit status is the number of engines that failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=2.0, help="of a run, at least 1.6")
    parser.add_argument("--engines", nargs="+", default=["simd", "cuda", "xla", "mjx"])
    options = parser.parse_args()
    # JAX would otherwise take the memory of a GPU that engine cuda uses in the same process.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    compile_cache.enable_cache()
    config = load(options.runs, options.seconds)
    arm: Any = config.robot
    model = mujoco.MjModel.from_xml_path(str(arm.files[0]))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    tried = peers.measure_rollout(40.0, (1024, 10_000), model, model.key_qpos[0])
    best = max(tried, key=lambda row: row["steps_per_s"])
    setting = f"{best['device']}, {best['robots']} robots"
    peer = ["`mujoco.rollout`", setting, *["–"] * 5, f"{best['steps_per_s'] / 1e6:.3g} M steps/s"]
    print(" | ".join(peer), file=sys.stderr, flush=True)
    tables: dict[str, Any] = {}
    rows, failed = [], 0
    for name in dict.fromkeys(["simd", *options.engines]):
        try:
            device = selection.select_engine(name, CAMPAIGN).device
            times = []
            for _ in range(2):
                begin = time.perf_counter()
                tables[name] = rj.run(config, engine=name)
                times.append(f"{time.perf_counter() - begin:.1f}")
            rate = kernel_rate(config, name)
        # An engine that does not exist here, or fails, leaves the others to be measured.
        except Exception as error:
            failed += not isinstance(error, UserError)
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            continue
        simd, own = tables["simd"], tables[name]
        equal = (simd["verdict"].to_numpy() == own["verdict"].to_numpy()).sum()
        apart = (simd["peak_golden_deviation_mm"] - own["peak_golden_deviation_mm"]).abs().max()
        cells = [f"`{name}`", device, f"{len(own):,}", f"{equal:,}", f"{apart:.2g} mm", *times]
        rows.append([*cells, f"{rate / 1e6:.3g} M full ticks/s"])
        print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    print(
        "| engine | device | runs | equal verdicts | apart | first, s | again, s | rate |\n"
        + "|---" * 8
        + "|"
    )
    for cells in (*rows, peer):
        print(f"| {' | '.join(cells)} |")
    print(f"\nVerdicts of simd: {tables['simd']['verdict'].value_counts().to_dict()}")
    return failed


if __name__ == "__main__":
    sys.exit(main())
