"""The C library of one robot: its header, its code as LLVM IR, an example program.

Its code is the printed code of `ControlSoftware` and `VirtualRobot`, so it has their bits on every
CPU: each operation is one IEEE operation and functions are the C library's. A call reads and writes
the four structs that it is handed, and nothing else: no allocation, no globals, no locks.

The structs lie in memory as the compiled code finds them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jinja2
import numpy as np

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import size
from ravenjax.engines.cpu.transition import RecordKind
from ravenjax.errors import UserError
from ravenjax.numbers import quantity, tree
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.hardware.virtual_robot import VirtualRobot
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.software.rows import row_type

TYPES = {
    "float32": "float",
    "float64": "double",
    "int32": "int32_t",
    "uint32": "uint32_t",
    "int64": "int64_t",
    "bool": "int32_t",
}
"""Type of a number -> that of C; a truth value is 0 or -1."""
_FUNCTIONS = {
    "raven_control_cycle": "cycle",
    "raven_control_receive": "receive",
    "raven_robot_step": "robot",
}
"""Function of the library -> its transition."""


class CLibrary(NamedTuple):
    """The library in texts."""

    header: str
    code: str  # LLVM IR
    example: str  # a C program that closes the loop of the two


class Member(NamedTuple):
    """Numbers of one type in a struct, one after the other."""

    type: str
    name: str
    dimensions: str  # "[2][7]"; "": a single number
    unit: str


class Struct(NamedTuple):
    """A struct of the header."""

    members: list[Member]
    bytes: int
    unused: int  # bytes at its end


def library(software: ControlSoftware, robot: VirtualRobot) -> CLibrary:
    """The library of these two, as they are set and where they stand. UserError where they do
    not belong together.
    """
    arms = software.setup.arms
    if arms != robot.setup.arms or software.setup.tools != robot.setup.tools:
        raise UserError(
            f"the control software has arms {arms} with tools {software.setup.tools}, the robot"
            f" {robot.setup.arms} with {robot.setup.tools}: expected the same of both"
        )
    if software.setup.console != "increments":
        raise UserError(
            "console is 'absolute', whose packets no wire carries; the C library takes increments"
        )
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("ravenjax.robots.raven2.c_library"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
<<<<<<< HEAD


def _start(software: ControlSoftware, robot: VirtualRobot) -> dict[str, np.ndarray]:
    """Bytes of each constant."""
    kinds, control = robot.code.kinds, software.code.kinds
    return {
        f"{CONTROL}_default": control["params"].row(software.params),
        f"{CONTROL}_start": control["state"].row(software.state),
        f"{ROBOT}_default": kinds["params"].row(robot.params),
        f"{ROBOT}_start": kinds["state"].row(robot.state),
        f"{ROBOT}_first": kinds["signals"].row(robot.reading.signals),
    }


def _code(transitions: Mapping[str, StateTransition], rows: Mapping[str, np.ndarray]) -> str:
    steps = {f"{name}_steps": each for name, each in transitions.items()}
    text = transition.print_module(steps, frozenset())
    for name in transitions:
        text = text.replace(f"define void @{name}_steps(", f"define internal void @{name}_steps(")
    calls = "".join(
        f"define void @{name}(ptr %fixed, ptr %state, ptr %entering, ptr %leaving) {{\n  call void"
        f" @{name}_steps(ptr %fixed, ptr %state, ptr %entering, i64 0, ptr %leaving, i64 0, ptr"
        " null, i64 1)\n  ret void\n}\n"
        for name in transitions
    )
    constants = "".join(
        f'@{name} = constant [{len(row)} x i8] c"{_escaped(row)}", align 8\n'
        for name, row in rows.items()
    )
    return f"{constants}{text}\n{calls}"


def _escaped(row: np.ndarray) -> str:
    """Bytes as LLVM writes them in a text."""
    return "".join(f"\\{byte:02X}" for byte in row.tolist())


# --- header ---

_HEAD = """\
/* Raven-II: control software and virtual robot, a call of each a millisecond. Written by ravenjax.

   Angles are rad, insertions m, positions named _um whole micrometres, torques N m, commands DAC counts and encoders
   counts. Joints are shoulder, elbow, insertion, tool_roll, wrist, grasp1, grasp2. Arms: {arms}.
   A truth value is 0 or -1. Structs of a call must not overlap. Nothing is allocated. */
#ifndef RAVENJAX_RAVEN2_H
#define RAVENJAX_RAVEN2_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#define RAVEN_ASSERT(truth, name) static_assert(truth, #name " has another size here than its code was made for")
#else
#define RAVEN_ASSERT(truth, name) _Static_assert(truth, #name " has another size here than its code was made for")
#endif
"""  # noqa: E501
_TAIL = """\
#ifdef __cplusplus
}
#endif
#endif
"""
_WIRE_TYPES = {"<u4": "uint32_t", "<i4": "int32_t", "<f8": "double"}


def _header(software: ControlSoftware, robot: VirtualRobot) -> str:
    arms, control, plant = software.setup.arms, software.code.kinds, robot.code.kinds
    inputs = row_type(software.setup)
    units = {CONTROL: _units(type(software.params), arms), ROBOT: _units(type(robot.params), arms)}

    def of_record(prefix: str, what: str, kind: RecordKind, about: str) -> str:
        own = units[prefix] if what == "params" else None
        return struct(f"{prefix}_{what}", members(kind, arms), kind.layout.bytes, about, own)

    entering = [
        StructMember(name, str(inputs[name].base), inputs[name].shape)
        for name in inputs.names or ()
        if name != "rest"
    ]
    parts = [
        _HEAD.format(arms=", ".join(arms)),
        _packet(),
        of_record(CONTROL, "params", control["params"], "What is set in the control software."),
        of_record(
            CONTROL, "state", control["state"], "What it remembers from one cycle to the next."
        ),
        _inputs(entering, inputs.itemsize),
        of_record(
            CONTROL,
            "signals",
            control["signals"],
            "What crossed its seams in a cycle, what it wrote among it.",
        ),
        of_record(ROBOT, "params", plant["params"], "What is set in the robot."),
        of_record(
            ROBOT, "state", plant["state"], "What it remembers from one millisecond to the next."
        ),
        of_record(
            ROBOT,
            "inputs",
            plant["inputs"],
            "What reaches it: DAC commands, output pins, its two buttons.",
        ),
        of_record(
            ROBOT,
            "signals",
            plant["signals"],
            "What it shows: encoders and pins; and what is true of it.",
        ),
        *_constants(),
        *_functions(),
        _TAIL,
    ]
    return "\n".join(parts)


def _units(params: type, arms: tuple[str, ...]) -> dict[str, str]:
    """Unit of each member of a struct of parameters."""
    units: dict[str, list[str]] = {}
    for path, one in quantity.quantities(params):
        if one.unit and one.unit not in (there := units.setdefault(path.replace(".", "_"), [])):
            there.append(one.unit)
    texts = {name: "; ".join(several) for name, several in units.items()}
    gaps = [(name, k) for name in texts for k, letter in enumerate(name) if letter == "_"]
    return texts | {f"{name[:k]}_{arm}{name[k:]}": texts[name] for name, k in gaps for arm in arms}


def _example(arms: tuple[str, ...]) -> str:
    written = "\n".join(
        f"    memcpy(message.dac[{i}], out.arms_{arm}_current_cmd_written, sizeof"
        f" message.dac[{i}]);"
        for i, arm in enumerate(arms)
    )
    return _EXAMPLE.format(arms=len(arms), first=ARMS.index(arms[0]), written=written)


_EXAMPLE = """\
/* Control software and virtual robot in a loop: 3 s, the pedal down from 0.6 s on, the first arm moving from 0.9 s on.
   cc example.c -L. -lravenjax_raven2 -Wl,-rpath,. -lm -o example && ./example */
#include <stdio.h>
#include <string.h>

#include "ravenjax_raven2.h"

int main(void) {{
  raven_control_params software = raven_control_default;
  raven_control_state state = raven_control_start;
  raven_control_inputs in;
  raven_control_signals out;
  raven_robot_params mechanics = raven_robot_default;
  raven_robot_state robot = raven_robot_start;
  raven_robot_inputs message;
  raven_robot_signals seen = raven_robot_first;
  memset(&in, 0, sizeof in);
  memset(&message, 0, sizeof message);

  for (int ms = 0; ms < 3000; ++ms) {{
    /* the console */
    in.packet.sequence = (uint32_t)ms + 1;
    in.packet.surgeon_mode = ms >= 600;
    in.packet.delx[{first}] = ms >= 900 ? 10 : 0;
    in.packet.dely[{first}] = ms >= 900 ? 5 : 0;
    in.packet.Qw[0] = in.packet.Qw[1] = 1.0;
    in.size = (int32_t)sizeof in.packet;
    in.received = 1;

    /* USB, from the robot */
    memcpy(in.enc_val, seen.encoders, sizeof in.enc_val);
    for (int arm = 0; arm < {arms}; ++arm) {{
      in.pins[arm] = seen.pins;
      in.read_ok[arm] = 1;
    }}
    raven_control_cycle(&software, &state, &in, &out);

    /* USB, to the robot */
{written}
    message.output_pins = out.pins_out;
    raven_robot_step(&mechanics, &robot, &message, &seen);

    printf("%d %d", ms, seen.runlevel);
    for (int arm = 0; arm < {arms}; ++arm)
      for (int joint = 0; joint < 7; ++joint) printf(" %d %d", message.dac[arm][joint], seen.encoders[arm][joint]);
    for (int axis = 0; axis < 3; ++axis) printf(" %.9g", seen.tip[0][axis]);
    printf("\\n");
  }}
  return 0;
}}
"""  # noqa: E501


def _packet() -> str:
    """A datagram from the console; packed, since its quaternions stand at no multiple of eight
    bytes.
    """
    lines = []
    for name, dtype, *shape in U_STRUCT.descr:
        lines.append(f"  {_WIRE_TYPES[str(dtype)]} {name}{f'[{len(ARMS)}]' if shape else ''};")
    return "\n".join(
        [
            (
                "/* Of an ITP console: increments in um, grasp in mrad; entry 0 is the gold arm's,"
                " 1 the green one's. */"
            ),
            "#pragma pack(push, 1)",
            "typedef struct {",
            *lines,
            "} raven_packet;",
            "#pragma pack(pop)",
            f"RAVEN_ASSERT(sizeof(raven_packet) == {U_STRUCT.itemsize}, raven_packet);",
            "",
        ]
    )


def _inputs(entering: list[StructMember], total: int) -> str:
    comments = {
        "size": "bytes of the datagram",
        "received": "1: one arrived in this cycle",
        "enc_val": "counts",
        "pins": "byte of each board, bits 6 and 7: run level of the PLC",
        "read_ok": "1: the board's read succeeded",
    }
    lines = []
    for member in entering:
        text = "  raven_packet packet;" if member.name == "packet" else f"  {member.text}"
        lines.append(text + (f"  /* {comments[member.name]} */" if member.name in comments else ""))
    end = sum(U_STRUCT.itemsize if member.name == "packet" else member.bytes for member in entering)
    if end < total:
        lines.append(f"  uint8_t unused[{total - end}];")
    name = f"{CONTROL}_inputs"
    return "\n".join(
        [
            (
                "/* What enters the control software in a cycle: a packet or none, and what USB"
                " delivered. */"
            ),
            "typedef struct {",
            *lines,
            f"}} {name};",
            f"RAVEN_ASSERT(sizeof({name}) == {total}, {name});",
            "",
        ]
    )


def _constants() -> list[str]:
    return [
        (
            "/* Parameters as exported, states where both stand at first, and what the robot shows"
            " then. */"
        ),
        f"extern const {CONTROL}_params {CONTROL}_default;",
        f"extern const {CONTROL}_state {CONTROL}_start;",
        f"extern const {ROBOT}_params {ROBOT}_default;",
        f"extern const {ROBOT}_state {ROBOT}_start;",
        f"extern const {ROBOT}_signals {ROBOT}_first;",
        "",
    ]


def _functions() -> Iterator[str]:
    for name, (prefix, _, about) in _FUNCTIONS.items():
        yield f"/* {about} */"
        yield (
            f"void {name}(const {prefix}_params *params, {prefix}_state *state, const"
            f" {prefix}_inputs *inputs,\n{' ' * len(f'void {name}(')}{prefix}_signals *signals);\n"
=======
    header, example = (
        templates.get_template(f"{name}.j2").render(
            arms=arms,
            first=ARMS.index(arms[0]),
            structs=_structs(software, robot),
            inputs=row_type(software.setup),
>>>>>>> physics
        )
        for name in ("ravenjax_raven2.h", "example.c")
    )
    return CLibrary(header, _code(software, robot), example)


def _code(software: ControlSoftware, robot: VirtualRobot) -> str:
    own = software.code.transitions | robot.code.transitions
    text = transition.print_steps(
        {name: own[which] for name, which in _FUNCTIONS.items()}, frozenset()
    )
    for name in _FUNCTIONS:
        text = text.replace(f"define void @{name}_steps(", f"define internal void @{name}_steps(")
        text += (
            f"\ndefine void @{name}(ptr %fixed, ptr %state, ptr %entering, ptr %leaving) {{\n"
            f"  call void @{name}_steps(ptr %fixed, ptr %state, ptr %entering, i64 0, ptr %leaving,"
            " i64 0, ptr null, i64 1)\n  ret void\n}\n"
        )
    control, plant = software.code.kinds, robot.code.kinds
    constants = {
        "raven_control_default": control["params"].row(software.params),
        "raven_control_start": control["state"].row(software.state),
        "raven_robot_default": plant["params"].row(robot.params),
        "raven_robot_start": plant["state"].row(robot.state),
        "raven_robot_first": plant["signals"].row(robot.reading.signals),
    }
    for name, row in constants.items():
        escaped = "".join(f"\\{byte:02X}" for byte in row.tolist())
        text += f'@{name} = constant [{len(row)} x i8] c"{escaped}", align 8\n'
    return text


def _structs(software: ControlSoftware, robot: VirtualRobot) -> dict[str, Struct]:
    """Struct of each record, by its name in the header without "raven_"."""
    structs = dict[str, Struct]()
    for part, own in (("control", software), ("robot", robot)):
        units: dict[str, dict[str, None]] = {}  # a dict keeps their order
        for path, limits in quantity.quantities(type(own.params)):
            units.setdefault(path, {})[limits.unit] = None
        for what in ("params", "state", "inputs", "signals"):
            if (kind := own.code.kinds.get(what)) is not None:
                known = units if what == "params" else {}
                members, layout = members_of(kind, software.setup.arms, known), kind.layout
                end = layout.offsets[-1] + size(layout.types[-1])
                structs[f"{part}_{what}"] = Struct(members, layout.bytes, layout.bytes - end)
    return structs


def members_of(
    kind: RecordKind, arms: Sequence[str], units: Mapping[str, Iterable[str]]
) -> list[Member]:
    """The members of a record's struct, in order. Records within it give one member a field, named
    by the way there; numbers of a Vec are an array, and so are those of several arms that stand
    side by side. units: by path, without arms."""

    def members(place: Any, path: tuple[str, ...]) -> Iterator[Member]:
        types, shape = {kind.layout.types[k] for k in tree.leaves(place)}, _shape(place)
        if shape is not None and len(types) == 1:
            unit = "; ".join(units.get(".".join(name for name in path if name not in arms), ()))
            dimensions = "".join(f"[{n}]" for n in shape)
            yield Member(TYPES[types.pop()], "_".join(path), dimensions, unit)
        elif isinstance(place, tuple):
            names = arms if len(place) == len(arms) else map(str, range(len(place)))
            for name, item in zip(names, place, strict=True):
                yield from members(item, (*path, name))
        elif place is not None:
            for field in dataclasses.fields(place):
                yield from members(getattr(place, field.name), (*path, field.name))

    return list(members(tree.filled(kind.record, list(range(len(kind.layout.types)))), ()))


def _shape(place: Any) -> tuple[int, ...] | None:
    """Dimensions of a number or of equally long tuples of them; None for anything else."""
    try:
        return np.array(place, dtype=int).shape
    except (TypeError, ValueError):
        return None
