"""The README's snippets are what they say: campaigns load, command lines are understood, Python
runs as it stands.
"""

import re
import shutil
import subprocess
import sys
import tomllib

import pytest
import snippets

from ravenjax.cli import main

TEXT = (snippets.ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    """Snippets of one language, in order."""
    return snippets.blocks(TEXT, language)


def calls(program):
    """Arguments of each call of a program in the shell snippets."""
    return list(snippets.calls(TEXT, program))


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("block", blocks("bash"), ids=lambda block: block.split("\n")[0][:40])
def test_shell_snippets_are_shell(block):
    snippets.require_shell(block)


@pytest.mark.parametrize("words", calls("ravenjax"), ids=" ".join)
def test_command_lines_are_understood(words):
    """Parsed without being run: commands and options exist, and so do files that are named with
    a folder of ours.
    """
    snippets.require_command_line(words)


@pytest.mark.parametrize("words", calls("pip"), ids=" ".join)
def test_what_is_installed_exists(words):
    snippets.require_installable(words)


@pytest.mark.parametrize("command", ["campaigns", "faults", "parameters"])
def test_cheap_commands_run(command, capsys):
    assert [command] in calls("ravenjax")
    assert main([command]) == 0 and capsys.readouterr().out


def test_campaign_snippets_are_campaigns():
    """The first is a whole campaign; the others are sections to add to it, or to put in place of
    its own.
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.faults import design

    first, *more = blocks("toml")
    assert design.count_rows(loading.from_dict(tomllib.loads(first), text=first)) == 4096
    for block in more:
        sections = tomllib.loads(block)
        crossed = 2 if "cross" in sections else 1
        assert (
            design.count_rows(loading.from_dict(tomllib.loads(first) | sections)) == crossed * 4096
        )


def test_python_snippets_use_names_that_exist():
    for block in blocks("python"):
        snippets.require_names(block)


@pytest.mark.slow
@pytest.mark.parametrize("block", blocks("python"))
def test_python_snippets_run(block, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", block],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\((-?\d+, ){6}-?\d+\) 3\n", done.stdout), done.stdout
