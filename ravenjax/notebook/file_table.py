"""One table of a campaign file as an object: it holds what was written, and nothing else.

Keys are checked where the whole campaign is: many can only be judged beside others.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

_Own = TypeVar("_Own", bound="FileTable")


class FileTable:
    """Keys of one table, frozen; None is a key that is left out."""

    _names: ClassVar[Mapping[str, str]] = {}  # key -> what it means
    _required: ClassVar[frozenset[str]] = frozenset()
    _inner: ClassVar[
        Mapping[str, type[FileTable]]
    ] = {}  # key -> class of the tables that stand there
    _files: ClassVar[tuple[str, ...]] = ()  # keys that name files

    _keys: dict[str, Any]

    def __init__(self, **keys: Any) -> None:
        own = {key: self._entered(key, value) for key, value in keys.items() if value is not None}
        object.__setattr__(self, "_keys", own)
        self._complete()

    def _complete(self) -> None:
        """What is done once the keys are there."""

    def replace(self: _Own, **keys: Any) -> _Own:
        """Itself with other values of these keys; None leaves a key out."""
        return type(self)(**{**self._keys, **keys})

    def plain(self) -> dict[str, Any]:
        """The table as TOML has it."""
        return {key: plain(value) for key, value in self._keys.items()}

    def _with_files(self: _Own, folder: Path) -> _Own:
        """Itself, with files that it and the tables in it name taken from `folder`."""
        return type(self)(
            **{key: self._rooted(key, value, folder) for key, value in self._keys.items()}
        )

    def _entered(self, key: str, value: Any) -> Any:
        inner = self._inner.get(key)
        if inner is None or isinstance(value, FileTable):
            return value if isinstance(value, FileTable) else plain(value)
        if isinstance(value, Mapping):
            return _table(inner, value)
        if isinstance(value, Sequence) and not isinstance(value, str | bytes):
            return [_table(inner, one) if isinstance(one, Mapping) else one for one in value]
        return value

    def _rooted(self, key: str, value: Any, folder: Path) -> Any:
        if isinstance(value, FileTable):
            return value._with_files(folder)
        if key in self._inner and isinstance(value, list):
            return [one._with_files(folder) if isinstance(one, FileTable) else one for one in value]
        return rooted(value, folder) if key in self._files else value

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or (name not in self._names and name not in self._keys):
            raise AttributeError(
                f"{type(self).__name__} has no key {name!r}; it has {', '.join(self._names)}"
            )
        return self._keys.get(name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a table is frozen: write changed = table.replace({name}=...)")

    __delattr__ = __setattr__  # pyright: ignore[reportAssignmentType]

    def __dir__(self) -> Iterator[str]:  # what a notebook completes
        yield from (*super().__dir__(), *self._names)

    def __eq__(self, other: object) -> bool:
        return (
            type(self) is type(other)
            and isinstance(other, FileTable)
            and self.plain() == other.plain()
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __repr__(self) -> str:
        return f"rj.{type(self).__name__}({', '.join(f'{key}={value!r}' for key, value in self._keys.items())})"  # noqa: E501

    def __reduce__(self) -> Any:
        return _again, (type(self), self._keys)


def _again(kind: type[FileTable], keys: dict[str, Any]) -> FileTable:
    return kind(**keys)


def _table(kind: type[FileTable], keys: Mapping[Any, Any]) -> Any:
    """A table of that kind; what has keys that are no text stays, for others to refuse."""
    return kind(**keys) if all(isinstance(key, str) for key in keys) else dict(keys)


def plain(value: Any) -> Any:
    """A value as TOML has it: lists for arrays, tuples and ranges; what it cannot hold stays,
    for others to refuse.
    """
    if isinstance(value, FileTable):
        return value.plain()
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items() if one is not None}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # NumPy's and pandas' numbers and arrays
        return plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray):
        return [plain(one) for one in value]
    return value


def rooted(value: Any, folder: Path) -> Any:
    """A file's path, taken from `folder`; anything else stays."""
    return str((folder / value).absolute()) if isinstance(value, str) and value else value
