"""Shared fixtures."""

import gc
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from ravenjax.engines.cpu import jit

settings.register_profile(
    "ravenjax", deadline=None
)  # the first example of a traced function pays for compiling it
settings.load_profile("ravenjax")

ROOT = Path(__file__).resolve().parent.parent
LEVEL = jit._OPTIMISATION


os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp()
"""Which code ran before does not depend on who runs the tests."""


def pytest_configure(config):
    """Fast tests run their kernels for milliseconds: machine code of the same bits made in a
    fifth of the time.
    """
    if config.option.markexpr == "not slow":
        jit._OPTIMISATION = 0


def pytest_collection_finish():
    """What was imported lives as long as the process: no garbage collection looks through it
    again, and few at all.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


@pytest.fixture(scope="module")
def usual_code():
    """Machine code as users get it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jit, "_OPTIMISATION", LEVEL)
        yield


@pytest.fixture
def command_line(capsys, monkeypatch):
    """Runs a command line, on a wide terminal: (exit code, stdout, stderr)."""
    from ravenjax.cli import console, main

    monkeypatch.setattr(console, "out", type(console.out)(width=600))
    monkeypatch.setattr(console, "err", type(console.err)(width=600, stderr=True))

    def run(*tokens):
        code = main([str(token) for token in tokens])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Path of a public recording by name; the test is skipped, naming the file, where it is
    absent.
    """

    def find(name: str) -> Path:
        folder = Path(os.environ.get("RAVENJAX_DATA", ROOT.parent / "shared" / "data"))
        if not (folder / name).exists():
            pytest.skip(
                f"{folder / name} is absent (set RAVENJAX_DATA to the folder that holds it)"
            )
        return folder / name

    return find
