"""Where traces and compiled code are kept between processes: a campaign that was compiled once
starts at once.

Two processes may use the folder at a time. What is damaged there counts as absent; what was used
longest ago goes when the folder grows too large.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import threading
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Any

from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError
from ravenjax.numbers import lazy
from ravenjax.numbers.setup import Precision

VARIABLE = "RAVENJAX_CACHE"
"""Environment variable: another folder, or "off"."""
SIZE_VARIABLE, SIZE_MB = "RAVENJAX_CACHE_MB", 512
"""Environment variable: how large the traces and compiled objects may grow together, MB; and its
default.
"""
_HASH = 32  # bytes of sha256 before the content of a file


def folder() -> Path | None:
    """The cache's folder, made if need be; None where it is off or cannot be made."""
    wanted = os.environ.get(VARIABLE, "")
    if wanted.lower() == "off":
        return None
    place = (
        Path(wanted)
        if wanted
        else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ravenjax"
    )
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:  # no cache is no reason not to run
        return None
    return place


def enable() -> None:
    """Turn on JAX's persistent cache of compiled programs, unless it is set up already, once JAX is
    used.

    Code for one CPU may not run on another that shares the home folder, so each kind of CPU has a
    folder of its own.
    """
    if (base := folder()) is not None:
        lazy.when_loaded(lambda jax: _use(jax, base))


def _use(jax: Any, base: Path) -> None:
    if not jax.config.jax_compilation_cache_dir:
        jax.config.update("jax_compilation_cache_dir", str(base / f"xla-{_machine()}"))


def objects() -> MutableMapping[str, bytes] | None:
    """Traces and compiled objects of the printing engines by their key, on disk; None where the
    cache is off.

    Raises UserError for a size that is no number.
    """
    base = folder()
    return None if base is None else Objects(base / "objects", _size_mb() * 1_000_000)


def _size_mb() -> int:
    text = os.environ.get(SIZE_VARIABLE, "").strip()
    if not text:
        return SIZE_MB
    if not text.isdecimal() or int(text) == 0:
        raise UserError(
            f"{SIZE_VARIABLE}={text!r}: expected a whole number of MB, 1 or more; {VARIABLE}=off"
            " keeps nothing"
        )
    return int(text)


def cached_engine(name: str, precision: Precision) -> Engine:
    """The engine of that name, which keeps traces and compiled code here. Raises UserError."""
    enable()
    return selection.select(name, precision, objects())


class Objects(MutableMapping[str, bytes]):
    """One file a key: the hash of its content, and the content. What cannot be written is not kept.

    Keys are hashes of all that decides the content.
    """

    def __init__(self, place: Path, most: int) -> None:
        """most: bytes of all files together, of which those used last stay."""
        self._place, self._most = place, most

    def _path(self, key: str) -> Path:
        return self._place / hashlib.sha256(key.encode()).hexdigest()

    def __getitem__(self, key: str) -> bytes:
        path = self._path(key)
        try:
            whole = path.read_bytes()
        except OSError:
            raise KeyError(key) from None
        content = whole[_HASH:]
        if hashlib.sha256(content).digest() != whole[:_HASH]:
            del self[key]
            raise KeyError(key)
        with contextlib.suppress(OSError):  # a folder that may only be read
            os.utime(path)
        return content

    def __setitem__(self, key: str, value: bytes) -> None:
        path = self._path(key)
        aside = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
        try:
            self._place.mkdir(parents=True, exist_ok=True)
            aside.write_bytes(hashlib.sha256(value).digest() + value)
            os.replace(aside, path)
        except OSError:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            return
        self._shrink()

    def __delitem__(self, key: str) -> None:
        with contextlib.suppress(OSError):
            self._path(key).unlink()

    def __iter__(self) -> Iterator[str]:
        """Names of files, which are hashes of keys."""
        return (path.name for path in self._place.glob("[!.]*"))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _shrink(self) -> None:
        """Remove what was used longest ago until the rest fits; another process may do the same."""
        files = []
        for path in self._place.glob("*"):
            with contextlib.suppress(OSError):
                status = path.stat()
                files.append((status.st_mtime_ns, status.st_size, path))
        excess = sum(size for _, size, _ in files) - self._most
        for _, size, path in sorted(files):
            if excess <= 0:
                break
            with contextlib.suppress(OSError):
                path.unlink()
            excess -= size


def _machine() -> str:
    """Short hash of what decides which instructions this CPU has."""
    flags = [platform.machine()]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags += [line for line in lines if line.startswith(("flags", "Features"))][:1]
    except OSError:
        flags.append(platform.processor())
    return hashlib.sha256("\n".join(flags).encode()).hexdigest()[:8]
