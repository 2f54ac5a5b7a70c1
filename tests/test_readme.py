"""The README's snippets are what they say: campaigns load, command lines are understood, Python runs as it stands."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ravenjax.cli import app, main

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def blocks(language):
    """Snippets of one language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.M | re.S)


def calls(program):
    """Arguments of each call of a program in the shell snippets."""
    for block in blocks("bash"):
        for line in block.splitlines():
            for command in line.split("&&"):
                words = shlex.split(command, comments=True)
                if words and words[0].rpartition("/")[2] == program:
                    yield words[1:]


def test_every_snippet_is_looked_at():
    assert set(re.findall(r"^```(\w*)$", TEXT, re.M)) == {"", "bash", "toml", "python"}
    assert len(blocks("bash")) >= 4 and len(blocks("toml")) >= 2 and len(blocks("python")) == 1


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("block", blocks("bash"), ids=lambda block: block.split("\n")[0][:40])
def test_shell_snippets_are_shell(block):
    done = subprocess.run(["bash", "-n"], input=block, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("words", list(calls("ravenjax")), ids=" ".join)
def test_command_lines_are_understood(words):
    """Parsed without being run: commands and options exist, and so do files that are named with a folder of ours."""
    app.parse_args(words, exit_on_error=False, print_error=False)
    for word in words:
        if word.startswith(("campaigns/", "models/")):
            assert (ROOT / word).exists(), word


@pytest.mark.parametrize("words", list(calls("pip")), ids=" ".join)
def test_what_is_installed_exists(words):
    assert words[0] == "install"
    for extra in re.findall(r"\.\[(\w+)\]", " ".join(words)):
        assert extra in PROJECT["optional-dependencies"], extra
    if "-c" in words:
        assert (ROOT / words[words.index("-c") + 1]).is_file()


@pytest.mark.parametrize("command", ["campaigns", "faults", "parameters"])
def test_cheap_commands_run(command, capsys):
    assert [command] in list(calls("ravenjax"))
    assert main([command]) == 0 and capsys.readouterr().out


def test_campaign_snippets_are_campaigns():
    """The first is a whole campaign; the others are sections to add to it, or to put in place of its own."""
    from ravenjax.campaign.faults import design
    from ravenjax.campaign.file import loading

    first, *more = blocks("toml")
    assert design.count(loading.from_dict(tomllib.loads(first), text=first)) == 4096
    for block in more:
        sections = tomllib.loads(block)
        crossed = 2 if "cross" in sections else 1
        assert design.count(loading.from_dict(tomllib.loads(first) | sections)) == crossed * 4096


def test_python_snippets_use_names_that_exist():
    for block in blocks("python"):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F,E9", "-"],
            input=block, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("block", blocks("python"))
def test_python_snippets_run(block, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", block], capture_output=True, text=True, check=False, cwd=tmp_path, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\((-?\d+, ){6}-?\d+\) 3\n", done.stdout), done.stdout
