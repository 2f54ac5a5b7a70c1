"""Printed LLVM IR to a WebAssembly module: vectors of 128 bits, no fused multiply-add, no
imports but its memory.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ravenjax.engines.cpu import jit
from ravenjax.engines.wasm import linking

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
        binary = linking.link(machine.emit_object(module), names)
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
