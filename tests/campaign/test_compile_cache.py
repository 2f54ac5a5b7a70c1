"""What is kept between processes comes back whole or not at all, and never grows beyond its
size.
"""

import os
import subprocess
import sys

import jax
import pytest

from ravenjax.campaign import compile_cache
from ravenjax.campaign.compile_cache import CacheFiles
from ravenjax.errors import UserError

WHOLE = 10_000_000


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: whole[:-1],
        lambda whole: b"",
        lambda whole: whole[:-3] + bytes([whole[-3] ^ 1]) + whole[-2:],
    ],
    ids=["cut", "empty", "a bit of the content"],
)
def test_a_damaged_file_counts_as_absent_and_is_made_anew(tmp_path, damage):
    kept = CacheFiles(tmp_path, WHOLE)
    kept["one"], kept["two"] = b"first content", b"second content"
    (path,) = [path for path in tmp_path.iterdir() if path.read_bytes().endswith(b"first content")]
    path.write_bytes(damage(path.read_bytes()))
    assert kept.get("one") is None and kept["two"] == b"second content"
    kept["one"] = b"first content"
    assert kept["one"] == b"first content"


def test_what_was_used_longest_ago_goes_first(tmp_path):
    kept = CacheFiles(tmp_path, 3 * (1000 + 32))
    for number, key in enumerate("abc"):
        kept[key] = bytes(1000)
        os.utime(kept._path(key), ns=(number, number))
    assert kept["a"] == bytes(1000)  # used again: now the latest
    kept["d"] = bytes(1000)
    assert "b" not in kept and all(key in kept for key in "acd")
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 3 * (1000 + 32)


def test_two_processes_may_write_and_read_at_once(tmp_path):
    code = (
        "import sys; from pathlib import Path; from ravenjax.campaign.compile_cache import"
        " CacheFiles\nkept = CacheFiles(Path(sys.argv[1]), 60_000)\nfor number in range(200):\n   "
        " key = str(number % 7); kept[key] = key.encode() * 9000\n    assert kept.get(key) in"
        " (None, key.encode() * 9000)\n"
    )
    started = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) for _ in range(2)]
    assert [process.wait() for process in started] == [0, 0]


@pytest.mark.parametrize("size", ["0", "-1", "many", "1.5"])
def test_a_size_that_is_none_is_refused(monkeypatch, tmp_path, size):
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path))
    monkeypatch.setenv(compile_cache.SIZE_VARIABLE, size)
    with pytest.raises(UserError, match=compile_cache.SIZE_VARIABLE):
        compile_cache.object_cache()


def test_folder_and_size_are_taken_from_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path))
    monkeypatch.setenv(compile_cache.SIZE_VARIABLE, "1")
    kept = compile_cache.object_cache()
    kept["a"], kept["b"] = bytes(600_000), bytes(600_000)
    assert len(kept) == 1
    monkeypatch.setenv(compile_cache.VARIABLE, "off")
    assert compile_cache.object_cache() is None


def test_settings_of_xla_are_recorded_for_engines_that_use_it(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=true")
    assert compile_cache.engine_settings("simd") == {}
    with jax.default_matmul_precision("bfloat16"):
        settings = compile_cache.engine_settings("mjx")
    assert settings["XLA_FLAGS"].endswith("math=true")
    assert settings["jax_default_matmul_precision"] == "bfloat16"
