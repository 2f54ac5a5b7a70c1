"""Generates the C library of one robot: its header, its code as LLVM IR, and an example program.

The code is that of `ControlSoftware` and `VirtualRobot`, printed as LLVM IR. Its results equal
theirs to the bit on every CPU, because each operation is one IEEE operation, and functions such as
the sine come from the C library. A call reads and writes only the four structs that it receives. It
allocates no memory and takes no locks. The structs have the memory layout that the code expects.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax import resources
from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import stored_size
from ravenjax.errors import UserError
from ravenjax.numbers import quantity, tree
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.software.rows import row_type
from ravenjax.robots.raven2.virtual_robot import VirtualRobot

_TABLES = resources.read_tables(__file__, "c_library.toml")
TYPES: dict[str, str] = _TABLES["types"]
"""NumPy type of a number -> its C type; a truth value is 0 or -1."""
_FUNCTIONS: dict[str, str] = _TABLES["functions"]
"""Function of the library -> the name of its computation in `transitions` of the Python objects."""


class CLibrary(NamedTuple):
    """The files of the library as texts."""

    header: str
    code: str  # LLVM IR
    example: str  # a C program that connects software and robot in a closed loop


class Member(NamedTuple):
    """A member of a struct: one number, or an array of numbers of one type."""

    type: str
    name: str
    dimensions: str  # "[2][7]"; "": a single number
    unit: str


class Struct(NamedTuple):
    """A struct of the header."""

    members: list[Member]
    bytes: int
    unused: int  # padding bytes at the end of the struct


def make_library(software: ControlSoftware, robot: VirtualRobot) -> CLibrary:
    """Return the library of this software and robot, with their present parameters and state.
    Raises UserError if software and robot have different arms or tools, or if the console of the
    software sends absolute positions.
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
    # Returns the LLVM IR of the library, with default parameters and start states as constants.
    transitions = software.code.transitions | robot.code.transitions
    loops = {f"{name}_steps": transitions[key] for name, key in _FUNCTIONS.items()}
    # No CPU features: the library must run on every CPU
    text = transition.print_module(loops, frozenset())
    # Each function is printed as a loop over steps. The library exports a call of one step (i64 1)
    # without tables (null); the distances in bytes from step to step (i64 0) are not used
    for name in _FUNCTIONS:
        text = text.replace(f"define void @{name}_steps(", f"define internal void @{name}_steps(")
        text += (
            f"\ndefine void @{name}(ptr %fixed, ptr %state, ptr %entering, ptr %leaving) {{\n"
            f"  call void @{name}_steps(ptr %fixed, ptr %state, ptr %entering, i64 0, ptr %leaving,"
            " i64 0, ptr null, i64 1)\n  ret void\n}\n"
        )
    machines = {"control": software, "robot": robot}
    # For example, raven_control_default is field "params" of part "control"
    for name, (part, field) in _TABLES["constants"].items():
        # A new robot has a first reading, whose signals are those at the start
        owner = robot.reading if field == "signals" else machines[part]
        row = machines[part].code.kinds[field].row(getattr(owner, field))
        escaped = "".join(f"\\{byte:02X}" for byte in row.tolist())
        text += f'@{name} = constant [{len(row)} x i8] c"{escaped}", align 8\n'
    return text


def _structs(software: ControlSoftware, robot: VirtualRobot) -> dict[str, Struct]:
    # Returns the struct of each record of software and robot. The key is the struct's name in the
    # header without "raven_", such as "control_params".
    structs, arms = dict[str, Struct](), software.setup.arms
    for part, machine in (("control", software), ("robot", robot)):
        # The inner dict is an ordered set of units: joints of one parameter may differ in unit
        units: dict[str, dict[str, None]] = {}
        for path, limits in quantity.list_quantities(type(machine.params)):
            units.setdefault(path, {})[limits.unit] = None
        for field in ("params", "state", "inputs", "signals"):
            if (kind := machine.code.kinds.get(field)) is not None:
                # Only parameters have declared units
                field_units = units if field == "params" else {}
                members, layout = struct_members(kind, arms, field_units), kind.layout
                end = layout.offsets[-1] + stored_size(layout.types[-1])
                structs[f"{part}_{field}"] = Struct(members, layout.bytes, layout.bytes - end)
    return structs


def struct_members(
    kind: transition.RecordKind, arms: Sequence[str], units: Mapping[str, Iterable[str]]
) -> list[Member]:
    """Return the members of the C struct for a record, in order.

    A nested record becomes one member per field, named by the path to the field. Nested tuples of
    numbers, such as a Vec for each arm, become one array if all numbers have one type.
    units: path of a parameter without the arm -> its units.
    """

    def members(node, path: tuple[str, ...]) -> Iterator[Member]:
        # Yields the members for a part of the record, whose leaves are indices of numbers.
        types, shape = {kind.layout.types[k] for k in tree.tree_leaves(node)}, _array_shape(node)
        if shape is not None and len(types) == 1:
            without_arm = ".".join(name for name in path if name not in arms)
            unit = "; ".join(units.get(without_arm, ()))
            dimensions = "".join(f"[{n}]" for n in shape)
            yield Member(TYPES[types.pop()], "_".join(path), dimensions, unit)
        elif isinstance(node, tuple):
            # A tuple with one entry per arm
            names = arms if len(node) == len(arms) else map(str, range(len(node)))
            for name, item in zip(names, node, strict=True):
                yield from members(item, (*path, name))
        elif node is not None:
            for name, item in vars(node).items():
                yield from members(item, (*path, name))

    indices = list(range(len(kind.layout.types)))
    return list(members(tree.fill_tree(kind.record, indices), ()))


def _array_shape(node) -> tuple[int, ...] | None:
    # Returns the shape of `node` as an array of integers: () for one integer, (2, 7) for a tuple of
    # two tuples of seven integers. Returns None for a dataclass, and for tuples of unequal lengths.
    try:
        return np.array(node, dtype=int).shape
    except (TypeError, ValueError):
        return None
