"""Completion: what bash itself completes, what the scripts name, where an installation puts
them.
"""

import shutil
import subprocess

import pytest

from ravenjax.cli import app

COMMANDS = ("run", "report", "trace", "verify", "merge", "search", "train", "bench", "doctor")


@pytest.fixture(scope="module")
def script():
    """The script of a shell."""
    return {shell: app.generate_completion(shell=shell) for shell in ("bash", "zsh", "fish")}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_name_every_command_and_its_options(script, shell):
    for word in (*COMMANDS, "worst", "by", "executor", "shard", "json", "headless", "itp-port"):
        assert word in script[shell], word


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["trace", "DIR", "--w"], {"--worst"}),
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
