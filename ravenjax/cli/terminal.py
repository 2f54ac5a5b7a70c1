"""Shows a campaign's progress, tables and machine information in the terminal."""

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from ravenjax.campaign.inspection.estimate import format_estimate
from ravenjax.cli.console import print_text, render_template

if TYPE_CHECKING:
    from ravenjax.campaign.progress import Status

LINE_PERIOD_S = 5.0
"""Time between two lines of progress if the output is not a terminal, s."""


class Watch:
    """Shows progress: a bar in a terminal, else a line every few seconds. A context manager."""

    def __init__(self, console: Console):
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[text]}"),
            console=console,
        )
        self._task = self._bar.add_task("waiting", total=1.0, text="")
        self._line_time_s, self._phase = 0.0, ""
        self._engine, self._printed_notes = "", 0

    def __enter__(self) -> "Watch":
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._bar.stop()

    def __call__(self, status: "Status") -> None:
        """Show the state of the campaign; print its engine and its notes once."""
        if not self._engine:
            self._engine = status.engine
            print_text(f"engine: {status.engine}", self._console)
        for note in status.notes[self._printed_notes :]:
            print_text(f"note: {note}", self._console)
        self._printed_notes = len(status.notes)
        text = render_template("progress.j2", status=status, estimate=format_estimate)
        if self._console.is_terminal:
            self._bar.update(
                self._task, completed=status.progress, description=status.phase, text=text
            )
            return
        now_s = time.monotonic()
        if status.phase != self._phase or now_s - self._line_time_s >= LINE_PERIOD_S:
            self._line_time_s, self._phase = now_s, status.phase
            print_text(f"{status.phase}: {text}", self._console)


def describe_machine() -> Iterator[tuple[str, str]]:
    """Yield (name, description) of each property of this machine and its software."""
    from ravenjax.engines import selection
    from ravenjax.store import manifest

    yield "python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    for package, version in manifest.package_versions().items():
        if package != "python":
            yield package, version
    yield "cpu", f"{os.cpu_count()} threads, {selection.select_engine('simd').device}"
    page_gib = os.sysconf("SC_PAGE_SIZE") / 2**30
    total_gib = page_gib * os.sysconf("SC_PHYS_PAGES")
    free_gib = page_gib * os.sysconf("SC_AVPHYS_PAGES")
    yield "memory", f"{total_gib:.1f} GiB, {free_gib:.1f} GiB free"
    yield "output", "terminal" if sys.stdout.isatty() else "no terminal"


def run_checks(tests: dict[str, Callable[[], str]]) -> Iterator[tuple[str, str, str]]:
    """Yield (name, "ok" or "FAILED", detail) of each test. A test returns its detail or raises."""
    for name, test in tests.items():
        try:
            yield name, "ok", test()
        # A broken installation may raise anything, and the next test is still useful.
        except Exception as error:
            yield name, "FAILED", f"{type(error).__name__}: {error}"


def share_rows(counts: Mapping[str, int], total: int) -> list[tuple[str, ...]]:
    """Return table rows (name, count, share of `total` in %), largest count first. counts: number
    of faults or runs by name. The name "" stands for runs without a name and has no row.
    """
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))

    def format_share(count: int) -> str:
        # A share below 0.05 % would be rounded to 0.0 %.
        return f"{100 * count / total:.1f} %" if 2000 * count >= total else "< 0.1 %"

    return [(name, str(count), format_share(count)) for name, count in ordered if name]
