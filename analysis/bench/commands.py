"""Times whole commands from the shell, each in a separate process: the time that a user waits."""

import sys
import tempfile
from pathlib import Path
from typing import Any

import tomlkit

from bench import process, workload
from bench.process import ROOT, Finished
from ravenjax.campaign import compile_cache

OTHER_VALUES = ("--set", "campaign.seed=7")
"""Options that draw other values for faults and parameters of the same form."""
LARGE_RUNS, LARGE_TICKS = 1_000_000, 10_000
"""Runs of the large campaign, which take a GPU seconds, and their ticks."""


def list_commands(folder: Path, large: bool = False) -> dict[str, tuple[str, ...]]:
    """Return the words after `ravenjax` by the name of a command. Results go to `folder`. `large`:
    run the large campaign instead of `quick`.
    """
    campaign, name = "quick", "run quick"
    if large:
        (folder / "large.toml").write_text(
            tomlkit.dumps(workload.campaign_keys(LARGE_RUNS, LARGE_TICKS))
        )
        campaign, name = str(folder / "large.toml"), f"run {LARGE_RUNS:,} runs of {LARGE_TICKS} ms"
    run = ("run", campaign, "--no-report", "--out")
    listed = {
        f"{name}, nothing cached": (*run, str(folder / "0")),
        f"{name} again": (*run, str(folder / "1")),
        f"{name} with other values": (*run, str(folder / "2"), *OTHER_VALUES),
    }
    return listed if large else listed | {"campaigns": ("campaigns",), "--help": ("--help",)}


def run_command(folder: Path, *tokens: str, root: Path = ROOT) -> Finished:
    """Run `ravenjax` of the package in `root` with these words. Cache and bytecode are kept."""
    kept = {compile_cache.VARIABLE: str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, "-m", "ravenjax.cli", *tokens]
    try:
        return process.run_command(command, kept, folder=folder, root=root)
    except RuntimeError as error:
        raise RuntimeError(f"ravenjax {' '.join(tokens)}: {error}") from None


def measure(seconds: float, large: bool = False) -> list[dict[str, Any]]:
    """Time these commands in rounds, each with a separate cache, as many as fit into `seconds`."""
    runs: dict[str, list[Finished]] = {}

    def run_all() -> None:
        with tempfile.TemporaryDirectory() as folder:
            for what, tokens in list_commands(Path(folder), large).items():
                runs.setdefault(what, []).append(run_command(Path(folder), *tokens))

    workload.repeat(run_all, seconds)
    return [
        {
            "command": f"ravenjax {what}",
            "best_s": min(run.seconds for run in each),
            "seconds": [run.seconds for run in each],
            "cpu_s": min(run.cpu_s for run in each),
            "peak_mb": max(run.peak_mb for run in each),
        }
        for what, each in runs.items()
    ]
