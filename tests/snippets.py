"""Snippets of Markdown pages, and what tests ask of them: the README and the documentation share
it.
"""

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


class Snippet(NamedTuple):
    """One fenced block."""

    language: str
    title: str  # name of the file that it stands for; "": none
    text: str


def snippets(page: str) -> list[Snippet]:
    """Every fenced block of a page, in order."""
    found = re.findall(r'^```(\w*)(?: title="([^"]+)")?[^\n]*\n(.*?)^```$', page, re.M | re.S)
    return [Snippet(*one) for one in found]


def blocks(page: str, language: str) -> list[str]:
    """Texts of the blocks of one language, in order."""
    return [one.text for one in snippets(page) if one.language == language]


def calls(page: str, program: str) -> Iterator[list[str]]:
    """Arguments of each call of a program in the shell snippets."""
    for block in blocks(page, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            for command in re.split(r"&&|;", line.partition(" # ")[0]):
                words = shlex.split(command, comments=True)
                if words and words[0].rpartition("/")[2] == program:
                    yield words[1:]


def require_shell(block: str) -> None:
    """A block that bash can parse."""
    done = subprocess.run(["bash", "-n"], input=block, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def require_command_line(words: list[str]) -> None:
    """Arguments of `ravenjax` that it takes, without being run; files of our own folders exist."""
    from ravenjax.cli import app

    app.parse_args(words, exit_on_error=False, print_error=False)
    for word in words:
        if word.startswith(("campaigns/", "models/")):
            assert (ROOT / word).exists(), word


def require_installable(words: list[str]) -> None:
    """Arguments of `pip` that name extras and files that there are."""
    assert words[0] == "install"
    for extra in re.findall(r"\.\[(\w+)\]", " ".join(words)):
        assert extra in PROJECT["optional-dependencies"], extra
    if "-c" in words:
        assert (ROOT / words[words.index("-c") + 1]).is_file()


def require_names(block: str) -> None:
    """A block of Python that uses names that exist."""
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F,E9", "-"],
        input=block,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
