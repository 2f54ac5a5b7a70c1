"""Generates the C library of one robot: its header, its code as LLVM IR, and an example program.

The code is that of `ControlSoftware` and `VirtualRobot`, printed as LLVM IR. It gives their bits on
every CPU, because each operation is one IEEE operation and the functions come from the C library. A
call reads and writes only the four structs that it gets: no allocation, no globals, no locks.

The structs have the memory layout that the compiled code expects.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.bundled import resources
from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import stored_size
from ravenjax.errors import UserError
from ravenjax.numbers import quantity, tree
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.hardware.virtual_robot import VirtualRobot
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.software.rows import row_type

_TABLES = resources.read_tables(__file__, "library.toml")
TYPES: dict[str, str] = _TABLES["types"]
"""Type of a number -> its C type; a truth value is 0 or -1."""
_FUNCTIONS: dict[str, str] = _TABLES["functions"]
"""Function of the library -> the transition that it performs."""


class CLibrary(NamedTuple):
    """The library as texts."""

    header: str
    code: str  # LLVM IR
    example: str  # a C program that connects the two in a closed loop


class Member(NamedTuple):
    """Consecutive numbers of one type in a struct."""

    type: str
    name: str
    dimensions: str  # "[2][7]"; "": a single number
    unit: str


class Struct(NamedTuple):
    """A struct of the header."""

    members: list[Member]
    bytes: int
    unused: int  # padding bytes at its end


def make_library(software: ControlSoftware, robot: VirtualRobot) -> CLibrary:
    """Return the library of this software and robot, with their present settings and state.

    Raises UserError if the software and the robot have different arms or tools.
    """
    arms = software.setup.arms
    if arms != robot.setup.arms or software.setup.tools != robot.setup.tools:
        raise UserError(
            f"the control software has arms {arms} with tools {software.setup.tools}, but the robot"
            f" has arms {robot.setup.arms} with tools {robot.setup.tools}: expected the same"
        )
    if software.setup.console != "increments":
        raise UserError(
            "console is 'absolute', expected 'increments', because the datagrams of the C library"
            " contain increments"
        )
    structs, inputs = _structs(software, robot), row_type(software.setup)
    content = {"arms": arms, "first": ARMS.index(arms[0]), "structs": structs, "inputs": inputs}
    folder = Path(__file__).with_name("templates")
    header = resources.render_text(folder / "ravenjax_raven2.h.j2", **content)
    example = resources.render_text(folder / "example.c.j2", **content)
    return CLibrary(f"{header}\n", _code(software, robot), f"{example}\n")


def _code(software: ControlSoftware, robot: VirtualRobot) -> str:
    # Prints the LLVM code of the library, with default parameters and start states as constants.
    transitions = software.code.transitions | robot.code.transitions
    text = transition.print_module(
        {f"{name}_steps": transitions[which] for name, which in _FUNCTIONS.items()}, frozenset()
    )
    for name in _FUNCTIONS:
        text = text.replace(f"define void @{name}_steps(", f"define internal void @{name}_steps(")
        text += (
            f"\ndefine void @{name}(ptr %fixed, ptr %state, ptr %entering, ptr %leaving) {{\n"
            f"  call void @{name}_steps(ptr %fixed, ptr %state, ptr %entering, i64 0, ptr %leaving,"
            " i64 0, ptr null, i64 1)\n  ret void\n}\n"
        )
    machines = {"control": software, "robot": robot}
    for name, (part, what) in _TABLES["constants"].items():
        owner = robot.reading if what == "signals" else machines[part]
        row = machines[part].code.kinds[what].row(getattr(owner, what))
        escaped = "".join(f"\\{byte:02X}" for byte in row.tolist())
        text += f'@{name} = constant [{len(row)} x i8] c"{escaped}", align 8\n'
    return text


def _structs(software: ControlSoftware, robot: VirtualRobot) -> dict[str, Struct]:
    """Return the struct of each record, by its name in the header without "raven_"."""
    structs = dict[str, Struct]()
    for part, machine in (("control", software), ("robot", robot)):
        units: dict[str, dict[str, None]] = {}  # a dict keeps the order
        for path, limits in quantity.list_quantities(type(machine.params)):
            units.setdefault(path, {})[limits.unit] = None
        for what in ("params", "state", "inputs", "signals"):
            if (kind := machine.code.kinds.get(what)) is not None:
                known = units if what == "params" else {}
                members, layout = members_of(kind, software.setup.arms, known), kind.layout
                end = layout.offsets[-1] + stored_size(layout.types[-1])
                structs[f"{part}_{what}"] = Struct(members, layout.bytes, layout.bytes - end)
    return structs


def members_of(
    kind: transition.RecordKind, arms: Sequence[str], units: Mapping[str, Iterable[str]]
) -> list[Member]:
    """Return the members of the C struct for a record, in order.

    A nested record becomes one member per field, named by the path to the field. The numbers of a
    Vec become an array, and so do adjacent numbers of several arms. units: by path without arms.
    """

    def members(place, path: tuple[str, ...]) -> Iterator[Member]:
        # Yields the fields of a C struct: an array where all numbers have one type, else its parts.
        types, shape = {kind.layout.types[k] for k in tree.tree_leaves(place)}, _shape(place)
        if shape is not None and len(types) == 1:
            unit = "; ".join(units.get(".".join(name for name in path if name not in arms), ()))
            dimensions = "".join(f"[{n}]" for n in shape)
            yield Member(TYPES[types.pop()], "_".join(path), dimensions, unit)
        elif isinstance(place, tuple):
            names = arms if len(place) == len(arms) else map(str, range(len(place)))
            for name, item in zip(names, place, strict=True):
                yield from members(item, (*path, name))
        elif place is not None:
            for name, item in vars(place).items():
                yield from members(item, (*path, name))

    return list(members(tree.fill_tree(kind.record, list(range(len(kind.layout.types)))), ()))


def _shape(place) -> tuple[int, ...] | None:
    """Return the dimensions of nested tuples of numbers; () for a number, None if not an array."""
    try:
        return np.array(place, dtype=int).shape
    except (TypeError, ValueError):
        return None
