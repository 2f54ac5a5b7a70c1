"""Where compiled code is kept between processes: a campaign that was compiled once starts at once."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterator, MutableMapping
from pathlib import Path

import jax

from ravenjax.errors import StoreError
from ravenjax.store import files

VARIABLE = "RAVENJAX_CACHE"
"""Environment variable: another folder, or "off"."""


def folder() -> Path | None:
    """The cache's folder, made if need be; None where it is off or cannot be made."""
    wanted = os.environ.get(VARIABLE, "")
    if wanted.lower() == "off":
        return None
    place = Path(wanted) if wanted else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ravenjax"
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:  # no cache is no reason not to run
        return None
    return place


def enable() -> Path | None:
    """Turn on JAX's persistent cache of compiled programs, unless it is set up already; its folder, None where off.

    Code for one CPU may not run on another that shares the home folder, so each kind of CPU has a folder of its own.
    """
    if jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        return Path(jax.config.jax_compilation_cache_dir)  # pyright: ignore[reportAttributeAccessIssue]
    base = folder()
    if base is None:
        return None
    place = base / f"xla-{_machine()}"
    jax.config.update("jax_compilation_cache_dir", str(place))
    return place


def objects() -> MutableMapping[str, bytes] | None:
    """Compiled objects of the printing engines by their key, on disk; None where the cache is off."""
    base = folder()
    return None if base is None else _Objects(base / "objects")


class _Objects(MutableMapping[str, bytes]):
    """One file a key; keys are hashes of all that decides the content. What cannot be written is not kept."""

    def __init__(self, place: Path) -> None:
        self._place = place

    def _path(self, key: str) -> Path:
        return self._place / hashlib.sha256(key.encode()).hexdigest()

    def __getitem__(self, key: str) -> bytes:
        try:
            return self._path(key).read_bytes()
        except OSError:
            raise KeyError(key) from None

    def __setitem__(self, key: str, value: bytes) -> None:
        try:
            self._place.mkdir(parents=True, exist_ok=True)
            files.write_aside(self._path(key), lambda target: target.write_bytes(value))
        except (OSError, StoreError):
            return

    def __delitem__(self, key: str) -> None:
        self._path(key).unlink(missing_ok=True)

    def __iter__(self) -> Iterator[str]:
        return (path.name for path in self._place.glob("*"))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _machine() -> str:
    """Short hash of what decides which instructions this CPU has."""
    flags = [platform.machine()]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags += [line for line in lines if line.startswith(("flags", "Features"))][:1]
    except OSError:
        flags.append(platform.processor())
    return hashlib.sha256("\n".join(flags).encode()).hexdigest()[:8]
