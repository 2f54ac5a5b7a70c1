"""Times whole commands from the shell, each in a separate process: the time that a user waits."""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomlkit

from bench import process, workload
from bench.process import ROOT, Finished
from ravenjax.campaign import compile_cache

OTHER_VALUES = ("--set", "campaign.seed=7")
"""Options that draw other values for faults and parameters of the same form."""
NOTHING, AGAIN, OTHERS = ", nothing cached", " again", " with other values"
"""State of the cache for the form: neither traced nor compiled before; run with the same values;
run with other values.
"""


def list_commands(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return a map from the name of a command to the words after `ravenjax`. Results go to
    `folder`.
    """
    run = ("run", "quick", "--no-report", "--out")
    return {
        f"run quick{NOTHING}": (*run, str(folder / "0")),
        f"run quick{AGAIN}": (*run, str(folder / "1")),
        f"run quick{OTHERS}": (*run, str(folder / "2"), *OTHER_VALUES),
        "campaigns": ("campaigns",),
        "--help": ("--help",),
    }


def list_large_commands(
    folder: Path, runs: int = 1_000_000, ticks: int = 10_000
) -> dict[str, tuple[str, ...]]:
    """Return the commands for a campaign of a million ten-second runs, which takes a GPU
    seconds.
    """
    file = folder / "large.toml"
    file.write_text(tomlkit.dumps(workload.campaign_keys(runs, ticks)))
    run, what = ("run", str(file), "--no-report", "--out"), f"run of {runs:,} runs of {ticks} ms"
    return {
        f"{what}{NOTHING}": (*run, str(folder / "large0")),
        f"{what}{OTHERS}": (*run, str(folder / "large1"), *OTHER_VALUES),
    }


def run_command(folder: Path, *tokens: str, root: Path = ROOT) -> Finished:
    """Run `ravenjax` of the package in `root` with these words. Its cache is in `folder`."""
    cache = {compile_cache.VARIABLE: str(folder / "cache")}
    command = [sys.executable, "-m", "ravenjax.cli", *tokens]
    try:
        return process.run_command(command, cache, folder=folder, root=root)
    except RuntimeError as error:
        raise RuntimeError(f"ravenjax {' '.join(tokens)}: {error}") from None


def measure(seconds: float) -> list[dict[str, Any]]:
    """Time `ravenjax run` with an empty cache, again, and with other values of the same form; and
    the command that lists campaigns.

    The commands run in rounds, each with a separate cache, as many as fit into `seconds`.
    """
    return _measure(seconds, list_commands)


def measure_large(seconds: float) -> list[dict[str, Any]]:
    """Time the large campaign with an empty cache, and with other values."""
    return _measure(seconds, list_large_commands)


def _measure(
    seconds: float, list_commands: Callable[[Path], dict[str, tuple[str, ...]]]
) -> list[dict[str, Any]]:
    runs: dict[str, list[Finished]] = {}

    def run_all() -> None:
        with tempfile.TemporaryDirectory() as folder:
            for what, tokens in list_commands(Path(folder)).items():
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
