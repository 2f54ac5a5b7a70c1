"""Bad input through the command line: one error that names file, value and what was expected;
code 2; nothing lost.
"""

import os
import re
from pathlib import Path

import pytest

from ravenjax.cli import USER_ERROR, main

CAMPAIGN = """
[campaign]
name = "small"
duration_s = 0.3
chunk = 1

[operator]
{operator}

[[group]]
name = "free"

[[group]]
name = "burst"
[[group.fault]]
site = "{site}"
channel = "shoulder"
effect = "overwrite"
value = {value}
start_ms = 220
duration_ms = {duration}
{more}
"""
PLAIN = {
    "operator": 'motion = "reach"',
    "site": "usb_out",
    "value": "[4000, 8000]",
    "duration": "20",
    "more": "",
}


@pytest.fixture
def campaign(tmp_path):
    """Writes a campaign file that differs from a good one as asked."""

    def write(**changes):
        path = tmp_path / "small.toml"
        path.write_text(CAMPAIGN.format(**{**PLAIN, **changes}))
        return path

    return write


@pytest.fixture
def refused(command_line):
    """The one error of a command line that must fail; each of `words` must be in it."""

    def refused(tokens, *words):
        code, out, err = command_line(*tokens)
        assert code == USER_ERROR, out + err
        assert err.count("error:") == 1 and "Traceback" not in out + err
        for word in words:
            assert str(word) in err, f"{word!r} is not in: {err}"
        assert "compile" not in out, "refused before anything is compiled"
        return err

    return refused


def contents(folder: Path):
    """Bytes of every file below a folder, by path."""
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A result folder of three parts and its campaign file."""
    folder = tmp_path_factory.mktemp("finished")
    path = folder / "small.toml"
    path.write_text(CAMPAIGN.format(**PLAIN))
    assert (
        main(["run", str(path), "--out", str(folder / "out"), "--engine", "simd", "--no-report"])
        == 0
    )
    return path, folder / "out"


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of it to spoil."""
    path, out = finished
    for file, data in contents(out).items():
        target = tmp_path / "out" / file.relative_to(out)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return path, tmp_path / "out"


@pytest.mark.slow
def test_a_truncated_part(copied, refused, command_line):
    path, out = copied
    parts = sorted((out / "parts").iterdir())
    assert len(parts) == 3
    whole = parts[1].read_bytes()
    parts[1].write_bytes(whole[: len(whole) // 2])
    before = contents(out)
    err = refused(
        ["report", out],
        parts[1],
        f"{len(whole) // 2} bytes",
        f"expected {len(whole)}",
        "start the same command again",
    )
    assert str(parts[0]) not in err
    assert contents(out) == before, "nothing is written over what is there"
    code, printed, err = command_line("run", path, "--out", out, "--engine", "simd", "--no-report")
    assert code == 0, err
    assert str(parts[1]) in printed and "was moved to" in printed and str(parts[0]) not in printed
    assert {p.name for p in (out / "parts").iterdir()} == {p.name for p in parts}
    assert parts[0].read_bytes() == before[parts[0]] and parts[2].read_bytes() == before[parts[2]]
    assert parts[1].read_bytes() == whole, "computed again to the byte"
    assert (out / "set-aside" / parts[1].name).read_bytes() == before[parts[1]], (
        "and what was there is kept"
    )


def test_a_trace_of_other_code_says_so(copied, command_line, monkeypatch):
    from ravenjax.store import manifest

    _, out = copied
    monkeypatch.setattr(manifest, "code_hash", lambda *_: "another")
    code, _, err = command_line("trace", out, "1", "--engine", "simd")
    assert code == 0 and f"note: {out} was computed by other code" in err


def unwritable_folders(tmp_path):
    """Folders that not even root may write to."""
    (tmp_path / "file").write_text("a regular file")
    yield tmp_path / "file" / "out"
    yield tmp_path / "file"
    if Path("/proc/self").exists():
        yield Path("/proc/ravenjax/out")


def test_an_output_folder_that_takes_no_files(campaign, refused, tmp_path):
    path = campaign()
    for out in unwritable_folders(tmp_path):
        refused(
            ["run", path, "--out", out], out, "cannot be written to", "--out", "No run was started"
        )
    assert (tmp_path / "file").read_text() == "a regular file"


def test_a_trace_that_cannot_be_written(copied, refused, tmp_path):
    _, out = copied
    (tmp_path / "file").write_text("a regular file")
    refused(
        ["trace", out, "1", "--out", tmp_path / "file" / "traces"],
        tmp_path / "file",
        "cannot be written",
    )


def test_a_disk_that_fills_up_keeps_the_parts_that_are_there(copied, command_line, monkeypatch):
    """The remedy of the message, the same command again, then computes the rest."""
    path, out = copied
    parts = sorted((out / "parts").iterdir())
    for part in parts[1:]:
        part.unlink()
    replace = os.replace

    def full(source, target):
        if re.search(r"part-000000002", str(target)):
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    code, _, err = command_line("run", path, "--out", out, "--engine", "simd", "--no-report")
    assert code == USER_ERROR and err.count("error:") == 1
    assert str(parts[2]) in err and "No space left on device" in err and "same command again" in err
    assert sorted((out / "parts").iterdir()) == parts[:2]
    monkeypatch.setattr(os, "replace", replace)
    assert command_line("run", path, "--out", out, "--engine", "simd", "--no-report")[0] == 0
    assert sorted((out / "parts").iterdir()) == parts
