"""Printed LLVM IR to a WebAssembly module: vectors of 128 bits, no fused multiply-add, no
imports but its memory.

LLVM writes an object file. `link` makes it a module that runtimes load, as a linker would.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ravenjax.engines.cpu import jit

MAGIC = b"\0asm\1\0\0\0"
MEMORY = ("env", "__linear_memory")
"""Module and name under which an object imports its memory."""
_CUSTOM, _TYPE, _IMPORT, _FUNCTION, _EXPORT, _CODE = 0, 1, 2, 3, 7, 10
_FUNCTION_INDEX = 0  # type of a relocation
_SYMBOL_TABLE = 8  # subsection of "linking"
_UNDEFINED = 0x10  # flag of a symbol


class Unlinkable(ValueError):
    """The object holds what this linker does not know."""


@dataclasses.dataclass
class _Reader:
    """Bytes from a place on."""

    content: bytes
    at: int = 0

    def number(self) -> int:
        """An unsigned LEB128."""
        result = shift = 0
        while True:
            byte = self.content[self.at]
            self.at += 1
            result |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return result

    def byte(self) -> int:
        self.at += 1
        return self.content[self.at - 1]

    def bytes(self, count: int) -> bytes:
        self.at += count
        return self.content[self.at - count : self.at]

    def name(self) -> str:
        return self.bytes(self.number()).decode()

    @property
    def more(self) -> bool:
        return self.at < len(self.content)


def number(value: int) -> bytes:
    """An unsigned LEB128."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def link(code: bytes, names: Sequence[str]) -> bytes:
    """The module of an object file, its functions `names` exported. Raises Unlinkable.

    The code calls nothing outside, holds no data and needs no stack: it imports its memory alone.
    So the sections of types, imports, functions and code are kept, and only exports are added.
    Format: the WebAssembly core specification; WebAssembly tool conventions, Linking.md.
    """
    if code[: len(MAGIC)] != MAGIC:
        raise Unlinkable("this is no WebAssembly object of version 1")
    sections, custom = _sections(code)
    _require_memory_alone(_Reader(sections[_IMPORT]))
    functions = _functions(_Reader(custom["linking"]))
    for name, content in custom.items():
        if name == "reloc.CODE":
            _require_final(_Reader(content), sections[_CODE], functions)
        elif name.startswith("reloc."):
            raise Unlinkable(
                f"the object has relocations of {name.removeprefix('reloc.')}, expected of CODE"
                " alone"
            )
    number_of = {name: place for name, place in functions if name}
    if absent := [name for name in names if name not in number_of]:
        raise Unlinkable(
            f"the object defines no {', '.join(absent)}; it has {', '.join(number_of)}"
        )
    exports = b"".join(
        number(len(name)) + name.encode() + b"\0" + number(number_of[name]) for name in names
    )
    sections[_EXPORT] = number(len(names)) + exports
    return MAGIC + b"".join(
        bytes([kind]) + number(len(sections[kind])) + sections[kind] for kind in sorted(sections)
    )


def _sections(code: bytes) -> tuple[dict[int, bytes], dict[str, bytes]]:
    """Contents of the sections by their number, and of the custom ones by name."""
    reader = _Reader(code, len(MAGIC))
    sections: dict[int, bytes] = {}
    custom: dict[str, bytes] = {}
    while reader.more:
        kind = reader.byte()
        content = reader.bytes(reader.number())
        if kind == _CUSTOM:
            own = _Reader(content)
            name = own.name()
            custom[name] = content[own.at :]
        elif kind in (_TYPE, _IMPORT, _FUNCTION, _CODE):
            sections[kind] = content
        else:
            raise Unlinkable(
                f"the object has a section {kind}, expected types, imports, functions and code"
                " alone"
            )
    return sections, custom


def _require_memory_alone(imports: _Reader) -> None:
    count, name, kind = imports.number(), (imports.name(), imports.name()), imports.byte()
    if count != 1 or name != MEMORY or kind != 2:
        raise Unlinkable(
            f"the object imports {count} things, first {'.'.join(name)}, expected its memory alone"
        )


def _functions(linking: _Reader) -> list[tuple[str, int]]:
    """Symbols: name and function of each; "" for what is no function."""
    if linking.number() != 2:
        raise Unlinkable("the object's section 'linking' is not of version 2")
    symbols: list[tuple[str, int]] = []
    while linking.more:
        kind, content = linking.number(), _Reader(linking.bytes(linking.number()))
        if kind != _SYMBOL_TABLE:
            continue
        for _ in range(content.number()):
            symbol, flags = content.byte(), content.number()
            if symbol != 0 or flags & _UNDEFINED:
                raise Unlinkable(
                    f"the object has a symbol of kind {symbol}, flags {flags}, expected its own"
                    " functions"
                )
            place = content.number()
            symbols.append((content.name(), place))
    return symbols


def _require_final(relocations: _Reader, code: bytes, functions: Sequence[tuple[str, int]]) -> None:
    """All calls name the functions that they mean; with no imported function there is nothing to
    move.
    """
    relocations.number()  # which section
    for _ in range(relocations.number()):
        kind, at, symbol = relocations.byte(), relocations.number(), relocations.number()
        if kind != _FUNCTION_INDEX:
            raise Unlinkable(
                f"the object has a relocation of type {kind}, expected calls of functions alone"
            )
        name, place = functions[symbol]
        if (there := _Reader(code, at).number()) != place:
            raise Unlinkable(f"a call of {name} names function {there}, expected {place}")


TRIPLE = "wasm32-unknown-unknown"
FEATURES = frozenset(("simd128", "bulk-memory", "nontrapping-fptoint", "sign-ext"))
"""WebAssembly 2.0, which browsers have had since 2023 (Safari 16.4). The relaxed vector
instructions of 3.0, a multiply-add among them, may round as the machine likes: no two machines need
agree."""
WIDTH = 4
"""float32 lanes of a vector."""
_OPTIMISATION = 2  # of code generation: it decides which values live in locals


def text() -> str:
    """All that decides how operations are printed, in words."""
    return ",".join(f"+{name}" for name in sorted(FEATURES))


def emit(printed: str, names: Sequence[str], objects: jit.Objects | None = None) -> bytes:
    """The module of a text's functions `names`; taken from `objects`, where it is left
    otherwise.
    """
    source = (llvmlite.__version__, TRIPLE, text(), str(_OPTIMISATION), *names, printed)
    key = hashlib.sha256("\n".join(source).encode()).hexdigest()
    binary = objects.get(key) if objects is not None else None
    if binary is None:
        module = llvm.parse_assembly(printed, llvm.create_context())
        machine = _machine()
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        binary = link(machine.emit_object(module), names)
        if objects is not None:
            objects[key] = binary
    return binary


@cache
def _target() -> Any:
    jit.host()  # LLVM's options hold for the whole process: they are set first
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(TRIPLE)


def _machine() -> Any:
    return _target().create_target_machine("generic", text(), _OPTIMISATION)
