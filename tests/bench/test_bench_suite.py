"""All parts in one run: what one of them breaks is a line, what does not fit is named, each can
be asked for.
"""

import json
import time
from pathlib import Path
from typing import get_args

import bench_work
import pytest

from bench import process, suite
from bench.suite import Part
from ravenjax.cli import machine as commands
from ravenjax.cli import main


@pytest.fixture
def some(monkeypatch):
    """Measures the parts that it is given."""
    monkeypatch.setenv("PYTHONPATH", str(Path(bench_work.__file__).parent))
    monkeypatch.setattr(suite.machine, "describe", bench_work.describe)

    def of(total_s, *listed, **more):
        monkeypatch.setattr(suite, "list_parts", lambda gpus: listed)
        found = suite.measure(total_s, **more)
        return found, {row["part"]: row["why"] for row in found["absent"]}

    return of


def test_a_part_that_breaks_spoils_no_other(some):
    found, absent = some(
        60.0,
        Part("a", "cores", bench_work.ends_without_an_answer, 0.1, 1.0),
        Part("b", "cores", bench_work.raises, 0.1, 1.0),
        Part("c", "devices", bench_work.answers, 0.1, 1.0, ("x", 2)),
    )
    assert absent["a"].startswith("exit code 9") and "out of memory" in absent["b"]
    assert found["devices"] == [{"seconds": 1.0, "arguments": ["x", 2]}]
    assert "cores" not in found and [row["part"] for row in found["clocks"]] == ["a", "b", "c"]
    assert found["clocks"][2]["peak_mb"] > 5.0


def test_a_part_that_hangs_is_ended_in_time(some, monkeypatch):
    monkeypatch.setattr(suite, "LATE_S", 0.5)
    began = time.perf_counter()
    found, absent = some(
        3.0,
        Part("a", "cores", bench_work.sleeps, 0.1, 1.0),
        Part("b", "devices", bench_work.answers, 0.1, 1.0),
    )
    assert time.perf_counter() - began < 30.0 and "not finished within" in absent["a"]
    assert "--seconds" in absent["b"] and "devices" not in found


def test_a_signal_is_named():
    command = ["/bin/sh", "-c", "echo last words >&2; kill -9 $$"]
    with pytest.raises(RuntimeError, match="ended by SIGKILL: last words"):
        process.run_command(command, {})


def test_quick_runs_say_what_they_leave_out(some):
    listed = (
        Part("a", "devices", bench_work.answers, 0.1, 1.0),
        Part("b", "shell", bench_work.answers, 0.1, 1.0, quick=True),
    )
    found, absent = some(60.0, *listed, quick=True)
    assert absent == {"a": "left out of a quick run"} and "shell" in found
    found, absent = some(60.0, *listed, quick=True, only=["devices"])
    assert absent == {} and "devices" in found and "shell" not in found


def test_ratios_are_those_of_the_best():
    found = {
        "engines": [
            {"engine": "simd", "ticks_per_s": 5e6},
            {"engine": "simd", "ticks_per_s": 1e7},
            {"engine": "mjx", "ticks_per_s": 1e4},
        ],
        "peers": [{"peer": "mujoco.rollout", "steps_per_s": 2e6}],
    }
    ratios = {(r["engine"], r["over"]): r["times"] for r in suite.compute_ratios(found)}
    assert ratios == {("simd", "mjx"): 1000.0, ("simd", "mujoco.rollout"): 5.0}


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in get_args(commands.TableName) if n != "devices"])
def test_a_part_asked_for_alone(name, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(suite, "share_time", lambda left_s, parts: 0.5)
    # Engine mjx compiles for minutes; tests of the engines cover it.
    listed = [part for part in suite.list_parts(8) if part.name != "engine mjx"]
    monkeypatch.setattr(suite, "list_parts", lambda gpus: listed)
    page = tmp_path / "page.md"
    command = ["bench", "--only", name, "--seconds", "900", "--json", "--markdown", str(page)]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    gpus = next(row["is"] for row in found["machine"] if row["what"] == "gpus")
    due = [part for part in suite.list_parts(len(gpus)) if part.table == name]
    lacking = {part.name for part in due if part.gpus > len(gpus)}
    assert {row["part"] for row in found["absent"]} == lacking and found[name]
    assert {row["part"] for row in found["clocks"]} == {part.name for part in due} - lacking
    assert f"## {suite.TITLES[name]}" in page.read_text()
