"""Caches compiled code on disk, so that a campaign with the same code starts quickly. Two processes
may use the folder at the same time. Damaged files are ignored. When the folder grows too large, the
files that were used longest ago are deleted.

ravenjax executes the stored code. Therefore the folder and its files must belong to the user or to
root, and nobody else may write into the folder.
"""

import contextlib
import hashlib
import os
import platform
import threading
from collections.abc import Iterator, MutableMapping
from pathlib import Path

from ravenjax import consent
from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError
from ravenjax.numbers import lazy
from ravenjax.numbers.setup import Precision
from ravenjax.store import files

VARIABLE = "RAVENJAX_CACHE"
"""Environment variable with the path of the cache folder, or "off"."""
SIZE_VARIABLE, SIZE_MB = "RAVENJAX_CACHE_MB", 512
"""Environment variable for the largest size of the cache in MB, and its default."""
# Number of bytes of the sha256 at the beginning of each file.
_HASH_BYTES = 32


def cache_folder(kind: str) -> Path | None:
    """Return the cache folder for a kind of code, and create it if needed. Return None if the cache
    is off or cannot be created. Raise UserError if others can write to it.
    """
    configured = os.environ.get(VARIABLE, "")
    if configured.lower() == "off":
        return None
    base = Path(configured) if configured else consent.user_folder("XDG_CACHE_HOME", ".cache")
    if base is None:
        return None
    for folder in (base, base / kind):
        if not configured:
            # Earlier versions created this folder with the default rights of the machine.
            with contextlib.suppress(OSError):
                folder.chmod(0o700)
        # This also creates a missing folder.
        if consent.is_private(folder):
            continue
        # The folder could not be created. A run is possible without a cache.
        if not folder.is_dir():
            return None
        raise UserError(
            f"{folder}: other users can write into this cache, or have done so, but ravenjax"
            f" executes its content. Delete the folder, remove their permission (chmod go-w), name"
            f" another folder in {VARIABLE}, or set {VARIABLE}=off"
        )
    return base / kind


def enable_cache() -> None:
    """Turn on JAX's persistent cache of compiled programs when JAX is first used. A cache that the
    user has configured is not changed. Machines with different CPUs may share a home folder, so
    each kind of CPU has a separate cache folder.
    """
    folder = cache_folder(f"xla-{_hash_cpu_features()}")

    def set_folder(jax):
        if folder is not None and not jax.config.jax_compilation_cache_dir:
            jax.config.update("jax_compilation_cache_dir", str(folder))

    lazy.call_when_jax_loads(set_folder)


def object_cache() -> MutableMapping[str, bytes] | None:
    """Return the disk cache for traces and compiled code of engines, a mapping from key to bytes.
    Return None if the cache is off. Raise UserError if the configured size is not a number.
    """
    folder = cache_folder("objects")
    if folder is None:
        return None
    advice = f"; to turn the cache off, set {VARIABLE}=off"
    size_mb = files.megabytes(SIZE_VARIABLE, SIZE_MB, advice)
    return CacheFiles(folder, size_mb * 1_000_000)


def cached_engine(name: str, precision: Precision, ticks: int | None = None) -> Engine:
    """Return the engine `name`, with this cache for its code. ticks: see `selection.select_engine`.
    Raise UserError for an engine that cannot run.
    """
    enable_cache()
    return selection.select_engine(name, precision, object_cache(), ticks)


class CacheFiles(MutableMapping[str, bytes]):
    """A mapping with one file per key. A file contains the hash of the content, then the content.
    If a file cannot be written, the entry is lost. A key is a hash of all that decides the content.
    """

    def __init__(self, folder: Path, max_bytes: int):
        """max_bytes: largest size of all files. The least recently used files are deleted."""
        self._folder, self._max_bytes = folder, max_bytes

    def _path(self, key: str) -> Path:
        return self._folder / hashlib.sha256(key.encode()).hexdigest()

    def __getitem__(self, key: str) -> bytes:
        path = self._path(key)
        try:
            stored = path.read_bytes()
        except OSError:
            raise KeyError(key) from None
        content = stored[_HASH_BYTES:]
        # A damaged file is deleted.
        if hashlib.sha256(content).digest() != stored[:_HASH_BYTES]:
            del self[key]
            raise KeyError(key)
        # The time of the last use decides which files are deleted. The folder may be read-only.
        with contextlib.suppress(OSError):
            os.utime(path)
        return content

    def __setitem__(self, key: str, value: bytes) -> None:
        path = self._path(key)
        # Another process never reads a part of a file, because the complete file is renamed.
        temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
        try:
            temporary.write_bytes(hashlib.sha256(value).digest() + value)
            os.replace(temporary, path)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            return
        self._shrink()

    def __delitem__(self, key: str) -> None:
        with contextlib.suppress(OSError):
            self._path(key).unlink()

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the files, which are hashes of the keys."""
        # Names of temporary files begin with a dot.
        return (path.name for path in self._folder.glob("[!.]*"))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _shrink(self):
        # Deletes the files that were used longest ago, until all files together have at most
        # `max_bytes`. Another process may do the same at the same time.
        entries = []
        for path in self._folder.glob("*"):
            with contextlib.suppress(OSError):
                status = path.stat()
                entries.append((status.st_mtime_ns, status.st_size, path))
        excess = sum(size for _, size, _ in entries) - self._max_bytes
        for _, size, path in sorted(entries):
            if excess <= 0:
                break
            with contextlib.suppress(OSError):
                path.unlink()
            excess -= size


def _hash_cpu_features() -> str:
    """Return a short hash of the features of this CPU, such as its vector instructions."""
    features = [platform.machine()]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        # Each core has such a line, and one suffices. On ARM the line begins with "Features".
        features += [line for line in lines if line.startswith(("flags", "Features"))][:1]
    except OSError:
        features.append(platform.processor())
    return hashlib.sha256("\n".join(features).encode()).hexdigest()[:8]


JAX_SETTINGS = (
    "jax_enable_x64",
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_threefry_partitionable",
    "jax_numpy_dtype_promotion",
    "jax_disable_jit",
)
"""Settings of JAX that change the code or the results of engines that are not portable."""


def engine_settings(engine: str) -> dict[str, str]:
    """Return XLA_FLAGS and settings of JAX, as results depend on them; {} for a portable engine."""
    if selection.engine_properties(engine).portable:
        return {}
    import jax

    settings = {name: str(getattr(jax.config, name)) for name in JAX_SETTINGS}
    return {"XLA_FLAGS": os.environ.get("XLA_FLAGS", "")} | settings
