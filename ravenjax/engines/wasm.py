"""Compiles LLVM IR to a WebAssembly module, so that a browser can run the simulated robot.

The module uses 128-bit vectors, has no fused multiply-add, and imports only its memory. LLVM writes
an object file. `link_module` converts the file into a loadable module, as a linker does.
"""

import io
import re
from collections.abc import Sequence

import llvmlite.binding as llvm

from ravenjax.engines.cpu import jit

MAGIC = b"\0asm\1\0\0\0"
MEMORY = ("env", "__linear_memory")
"""Module and name under which an object file imports its memory."""
_CUSTOM, _TYPE, _IMPORT, _FUNCTION, _EXPORT, _CODE = 0, 1, 2, 3, 7, 10


class Unlinkable(ValueError):
    """The object file contains something that this linker does not support."""


class _Reader(io.BytesIO):
    def number(self) -> int:
        """Read an unsigned LEB128 number: bytes of 7 bits, lowest first, + 128 if not the last."""
        result = shift = 0
        while True:
            byte = self.read(1)[0]
            result |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return result

    def content(self) -> bytes:
        """Read as many bytes as the number before them states."""
        return self.read(self.number())


def encode_leb128(value: int) -> bytes:
    """Encode a number as unsigned LEB128."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def link_module(code: bytes, defined: Sequence[str], names: Sequence[str]) -> bytes:
    """Return the module of an object file, with its functions `names` exported. Raises Unlinkable.

    defined: names of all its functions, in order.

    The code calls no outside function, contains no data and needs no stack: it imports only its
    memory. Therefore LLVM has already written the final number of each function into the calls. The
    sections of types, imports, functions and code are copied, and only exports are added. Format:
    the WebAssembly core specification; WebAssembly tool conventions, Linking.md.
    """
    reader = _Reader(code)
    if reader.read(len(MAGIC)) != MAGIC:
        raise Unlinkable(f"no WebAssembly object file: it begins with {code[: len(MAGIC)]!r}")
    sections: dict[int, bytes] = {}
    while kind := reader.read(1):
        content = reader.content()
        if kind[0] in (_TYPE, _IMPORT, _FUNCTION, _CODE):
            sections[kind[0]] = content
        elif kind[0] != _CUSTOM:
            expected = "expected only types, imports, functions and code"
            raise Unlinkable(f"the object file has a section {kind[0]}, {expected}")
    imports = _Reader(sections[_IMPORT])
    count, name = imports.number(), (imports.content().decode(), imports.content().decode())
    if count != 1 or name != MEMORY:
        got = f"{count} imports, first {'.'.join(name)}"
        raise Unlinkable(f"the object file has {got}, expected one import: env.__linear_memory")
    # An export: length of the name, name, kind (0: function), and the function's number.
    exports = [
        encode_leb128(len(name)) + name.encode() + b"\0" + encode_leb128(defined.index(name))
        for name in names
    ]
    sections[_EXPORT] = encode_leb128(len(names)) + b"".join(exports)
    return MAGIC + b"".join(
        bytes([kind]) + encode_leb128(len(sections[kind])) + sections[kind]
        for kind in sorted(sections)
    )


TRIPLE = "wasm32-unknown-unknown"
FEATURES = frozenset(("simd128", "bulk-memory", "nontrapping-fptoint", "sign-ext"))
"""Features of WebAssembly 2.0, which browsers have had since 2023 (Safari 16.4). The relaxed vector
instructions of 3.0, such as a multiply-add, may round differently on machines.
"""
WIDTH = 4
"""float32 lanes of a vector."""
# Level of code generation. It decides which values are kept in locals.
_OPTIMISATION = 2


def emit_module(text: str, names: Sequence[str]) -> bytes:
    """Return a WebAssembly module with the functions `names` of LLVM IR `text`."""
    # LLVM's options are those of the whole process and must be set first.
    jit.host_target()
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    host, target = jit.Host("generic", FEATURES), llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(host.cpu, host.text, _OPTIMISATION)
    # Names of all functions of the text, in the order in which LLVM numbers them.
    defined = re.findall(r"^define [^@]*@(\w+)\(", text, re.MULTILINE)
    return link_module(jit.emit_for_machine(text, machine), defined, names)
