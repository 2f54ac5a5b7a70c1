"""What decides a trace, as a hash: equal keys, equal code."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import pickle
import sys
from collections.abc import Iterator
from importlib import metadata
from typing import Any

import numpy as np

_PACKAGES = ("ravenjax", "jax", "jaxlib", "mujoco", "numpy")


def of(*values: Any) -> str:
    """Hash of nested values: types and bits of numbers, fields of records."""
    digest = hashlib.sha256()
    for value in values:
        for piece in _pieces(value):
            digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def _pieces(value: Any) -> Iterator[bytes]:
    kind = f"{type(value).__module__}.{type(value).__qualname__}".encode()
    if isinstance(value, np.ndarray | np.generic):
        yield from (kind, value.dtype.str.encode(), repr(value.shape).encode(), value.tobytes())
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        yield from (kind, repr(value).encode())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield kind
        for field in dataclasses.fields(value):
            yield field.name.encode()
            yield from _pieces(getattr(value, field.name))
    elif isinstance(value, tuple | list):
        yield from (kind, str(len(value)).encode())
        for item in value:
            yield from _pieces(item)
    elif isinstance(value, dict):
        yield from (kind, str(len(value)).encode())
        for item in value.items():
            yield from _pieces(item)
    else:
        yield from (kind, pickle.dumps(value))


@functools.cache
def versions() -> tuple[str, ...]:
    """Python and the packages that take part in tracing."""
    return (sys.version, *map(_version, _PACKAGES))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""
