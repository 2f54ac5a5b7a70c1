"""What the terminal shows of a campaign: one line that says all, notes once, failures by cause."""

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


def test_one_line_says_how_far_it_is():
    assert (
        terminal.words(STATUS)
        == "150 of 400 runs, 8 runs/s, 30 s left, 5 parts, 4 workers, compiled in 2.0 s, 23 failed,"
        " nan 3, worker killed by SIGKILL 20"
    )
    quiet = dataclasses.replace(STATUS, run_s=0.0, compile_s=0.0, failures={}, parts=0, workers=1)
    assert terminal.words(quiet) == "150 of 400 runs, 0 s left"


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


def test_what_evades_is_told_in_a_sentence():
    counted = {
        "silent/none/no cue": 6,
        "": 5,
        "limited/unintended motion/cue": 2,
        "silent/unintended motion/no cue": 1,
        "flagged/unintended motion/cue": 4,
        "silent/loss of motion/cue": 1,
    }
    assert (
        terminal.evading(counted, 2.5)
        == "3 of 14 runs with a fault evade the checks: no check tells anyone, and the instrument"
        " moves more than 2.5 mm by itself. The cue comes in 2 of these."
    )
    assert "1 of 1 runs with a fault evades the checks" in terminal.evading(
        {"silent/unintended motion/no cue": 1}, 3.0
    )
    assert terminal.evading({"silent/none/cue": 2}, 3.0).startswith(
        "None of 2 runs with a fault evades the checks"
    )
