"""Caches generated code on disk, under a hash of all inputs of the generation."""

import contextlib
import dataclasses
import functools
import hashlib
import pickle
import sys
import zlib
from collections.abc import Callable, Iterator, MutableMapping
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ravenjax import interruption, resources

Objects = MutableMapping[str, bytes]
"""A cache on disk: hash of all inputs -> content."""
Code = TypeVar("Code")

_PACKAGE = Path(__file__).resolve().parents[1]
_FOLDERS = ("engines", "stages", "faults", "parts", "vocabulary", "robots")
_FOLDERS += ("ir", "mechanics", "numbers")
_PACKAGES = ("ravenjax", "jax", "jaxlib", "mujoco", "numpy")


def hash_values(*values: Any) -> str:
    """Return a hash of nested values, which depends on types and bits of numbers."""
    digest = hashlib.sha256()
    for value in values:
        for piece in _pieces(value):
            # With its length, because "ab", "c" and "a", "bc" have the same bytes.
            digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def _pieces(value) -> Iterator[bytes]:
    # Yields pieces of bytes that are equal only for values of equal type and content, such as
    # b"builtins.tuple", b"1", b"builtins.int", b"5" for (5,).
    kind = f"{type(value).__module__}.{type(value).__qualname__}".encode()
    if isinstance(value, np.ndarray | np.generic):
        yield from (kind, value.dtype.str.encode(), repr(value.shape).encode(), value.tobytes())
        return
    if value is None or isinstance(value, bool | int | float | str | bytes):
        yield from (kind, repr(value).encode())
        return
    # `kind` stays that of the dataclass, while its fields are hashed like a dict.
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, tuple | list | dict):
        yield from (kind, str(len(value)).encode())
        for item in value.items() if isinstance(value, dict) else value:
            yield from _pieces(item)
    else:
        yield from (kind, pickle.dumps(value))


@functools.cache
def package_versions() -> tuple[str, ...]:
    """Return the versions of Python and of the packages that take part in tracing."""
    packages = (package for name in _PACKAGES for package in metadata.distributions(name=name))
    return (sys.version, *(f"{package.name} {package.version}" for package in packages))


def hash_files() -> str:
    """Return the sha256 of all files on which generated code depends: source files of the package,
    and models of robots, both the user's (in ./models) and the bundled ones.
    """
    files = [
        path
        for folder in _FOLDERS
        for suffix in ("py", "j2", "toml")
        for path in sorted((_PACKAGE / folder).rglob(f"*.{suffix}"))
    ]
    models = [*sorted(Path("models").rglob("*")), *resources.list_resources("models", "**/*")]
    result = hashlib.sha256()
    for path in (*files, *(path for path in models if path.is_file())):
        # The hash does not depend on folders outside of the package, which differ between machines.
        name = path.relative_to(_PACKAGE) if path.is_relative_to(_PACKAGE) else path.name
        result.update(f"{name}\0{path.stat().st_size}\0".encode() + path.read_bytes())
    return result.hexdigest()


AT_IMPORT = hash_files()
"""Hash of the files at the import of this module, whose code the process runs."""


def persistent_key(*values: Any) -> str:
    """Return a key for the cache on disk: a hash of these values, the source files and versions.
    Returns "" if the files have changed since the import, because the process then does not run the
    code that the files contain.
    """
    return hash_values(*values, AT_IMPORT, package_versions()) if hash_files() == AT_IMPORT else ""


def load_or_make(objects: Objects | None, key: str, make: Callable[[], Code]) -> Code:
    """Return the result of `make`, or load it from `objects` if it was stored before. key: hash of
    all inputs of `make`; "": nothing is loaded or stored. Results are pickles. Loading one can run
    code, but the cache also contains machine code, so this adds no risk.
    """
    if objects is None or not key:
        return make()
    if (content := objects.get(key)) is not None:
        # The content may be from another version, or name a module that no longer exists.
        with contextlib.suppress(Exception):
            return pickle.loads(zlib.decompress(content))
    interruption.check_interruption()
    result = make()
    interruption.check_interruption()
    # A record class that a user defined within a function cannot be pickled.
    with contextlib.suppress(pickle.PicklingError, AttributeError, TypeError):
        objects[key] = zlib.compress(pickle.dumps(result), 1)
    return result
