"""Completion: what bash itself completes, what the scripts name, where an installation puts
them.
"""

import os
import shutil
import subprocess
import sys

import pytest

from ravenjax.cli import app, main

COMMANDS = (
    "run",
    "report",
    "trace",
    "verify",
    "merge",
    "search",
    "reproduce",
    "train",
    "robot",
    "study",
    "log",
    "campaigns",
    "faults",
    "parameters",
    "bench",
    "doctor",
    "completion",
)


@pytest.fixture(scope="module")
def script():
    """The script of a shell."""
    return {shell: app.generate_completion(shell=shell) for shell in ("bash", "zsh", "fish")}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_name_every_command_and_its_options(script, shell):
    for word in (*COMMANDS, "worst", "by", "executor", "shard", "json", "headless", "itp-port"):
        assert word in script[shell], word


def test_the_command_prints_the_script(capsys):
    assert main(["completion", "zsh"]) == 0
    assert capsys.readouterr().out.startswith("#compdef ravenjax")
    assert main(["completion", "tcsh"]) == 2


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["tra"], {"trace", "train"}),
        (["trace", "DIR", "--w"], {"--worst"}),
        (
            ["verify", "DIR", "--"],
            {"--sample", "--engine", "--seed", "--json", "--help", "--version", "--folder"},
        ),
        (["study", "ass"], {"assign"}),
        (["run", "camp"], {"campaign.toml"}),
        (["completion", ""], {"bash", "zsh", "fish"}),
    ],
)
def test_what_bash_offers(script, tmp_path, typed, offered):
    (tmp_path / "campaign.toml").touch()
    words = " ".join(f"'{word}'" for word in ["ravenjax", *typed])
    ask = (
        f'COMP_WORDS=({words}); COMP_CWORD={len(typed)}; _ravenjax; printf "%s\\n"'
        ' "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", f"{script['bash']}\n{ask}"],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert set(done.stdout.split()) == offered and done.stderr == ""


def test_an_installation_stays_in_the_home_folder(tmp_path):
    environment = os.environ | {"HOME": str(tmp_path), "SHELL": "/bin/bash"}
    environment.pop("XDG_DATA_HOME", None)
    done = subprocess.run(
        [sys.executable, "-m", "ravenjax.cli", "--install-completion"],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    (installed,) = tmp_path.rglob("completions/ravenjax")
    assert (
        "_ravenjax" in installed.read_text()
        and str(installed) in (tmp_path / ".bashrc").read_text()
    )
