"""Records of numbers as plain C structs, which lie in memory as compiled code finds them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.engines.cpu.memory import size
from ravenjax.engines.cpu.record_kind import RecordKind
from ravenjax.numbers.lazy import jax

TYPES: Mapping[str, str] = {
    "float32": "float",
    "float64": "double",
    "int32": "int32_t",
    "uint32": "uint32_t",
    "int64": "int64_t",
    "bool": "int32_t",
}
"""Type of a number -> that of C; a truth value is 0 or -1."""


class StructMember(NamedTuple):
    """Numbers of one type, one after the other."""

    name: str
    dtype: str
    dimensions: tuple[int, ...]  # (): a single number

    @property
    def text(self) -> str:
        """Its declaration."""
        return f"{TYPES[self.dtype]} {self.name}{''.join(f'[{n}]' for n in self.dimensions)};"

    @property
    def bytes(self) -> int:
        """Its size."""
        count = 1
        for n in self.dimensions:
            count *= n
        return count * size(self.dtype)


def members(kind: RecordKind, arms: Sequence[str]) -> list[StructMember]:
    """The members of a record's struct, in order. Records within it give one member a field, named
    by the way there; numbers of a Vec are an array, and so are those of several arms that stand
    side by side."""
    places = jax.tree.unflatten(kind.tree, range(len(kind.types)))
    return list(_members(places, "", kind, arms))


def struct(
    name: str,
    own: Sequence[StructMember],
    total: int,
    about: str,
    units: Mapping[str, str] | None = None,
) -> str:
    """The struct `name` of `total` bytes. units: of members, by name, as a comment."""
    lines, end, widest = [], 0, 1
    for member in own:
        unit = (units or {}).get(member.name, "")
        lines.append(f"  {member.text}" + (f"  /* {unit} */" if unit else ""))
        end = -(-end // size(member.dtype)) * size(member.dtype) + member.bytes
        widest = max(widest, size(member.dtype))
    if -(-end // widest) * widest < total:
        lines.append(f"  uint8_t unused[{total - end}];")
    check = f"RAVEN_ASSERT(sizeof({name}) == {total}, {name});"
    return "\n".join([f"/* {about} */", "typedef struct {", *lines, f"}} {name};", check, ""])


def _members(
    place: Any, name: str, kind: RecordKind, arms: Sequence[str]
) -> Iterator[StructMember]:
    if place is None:
        return
    if isinstance(place, int):
        yield StructMember(name, kind.types[place], ())
    elif isinstance(place, tuple):
        numbers = list(_numbers(place))
        types = {kind.types[k] for k in numbers}
        if (dimensions := _shape(place)) is not None and len(types) == 1:
            yield StructMember(name, types.pop(), dimensions)
            return
        for i, item in enumerate(place):
            yield from _members(
                item, _joined(name, arms[i] if len(place) == len(arms) else str(i)), kind, arms
            )
    else:
        for field in dataclasses.fields(place):
            yield from _members(getattr(place, field.name), _joined(name, field.name), kind, arms)


def _shape(place: Any) -> tuple[int, ...] | None:
    """Dimensions of tuples of numbers, or of tuples of equally long ones; None for anything
    else, or nothing.
    """
    if isinstance(place, int):
        return ()
    if not isinstance(place, tuple) or not place:
        return None
    shapes = {_shape(item) for item in place}
    inner = shapes.pop()
    return None if shapes or inner is None else (len(place), *inner)


def _numbers(place: Any) -> Iterator[int]:
    for item in place:
        if isinstance(item, int):
            yield item
        elif isinstance(item, tuple):
            yield from _numbers(item)
        else:
            yield from jax.tree.leaves(item)


def _joined(prefix: str, name: str) -> str:
    return f"{prefix}_{name}" if prefix else name
