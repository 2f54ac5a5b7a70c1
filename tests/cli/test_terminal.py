"""What the terminal shows of a campaign: how far it is now and then, each note once."""

from __future__ import annotations

import dataclasses
import io

from rich.console import Console

from ravenjax.campaign.progress import Status
from ravenjax.cli import terminal

STATUS = Status(
    phase="run",
    done=150,
    total=400,
    compile_s=2.0,
    run_s=10.0,
    progress=0.25,
    engine="simd on a CPU",
    earlier=100,
    parts=5,
    workers=4,
    failures={"worker killed by SIGKILL": 20, "nan": 3},
)


def test_where_there_is_no_terminal_lines_come_now_and_then_and_each_note_once():
    out = io.StringIO()
    with terminal.Watch(Console(file=out, width=300)) as watch:
        watch(dataclasses.replace(STATUS, phase="compile", notes=("part [x] was set aside",)))
        for _ in range(5):
            watch(dataclasses.replace(STATUS, notes=("part [x] was set aside", "a worker died")))
        watch(dataclasses.replace(STATUS, phase="done"))
    lines = out.getvalue().splitlines()
    assert lines[:3] == [
        "engine: simd on a CPU",
        "note: part [x] was set aside",
        "compile: " + terminal.words(dataclasses.replace(STATUS, phase="compile")),
    ]
    assert sum("a worker died" in line for line in lines) == 1
    assert sum(line.startswith("run:") for line in lines) == 1 and lines[-1].startswith("done:")
