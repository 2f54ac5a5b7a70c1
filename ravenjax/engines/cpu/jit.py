"""Printed LLVM IR to functions that can be called, on this machine's CPU; compiled code may
outlive the process.
"""

from __future__ import annotations

import ctypes
import dataclasses
import hashlib
import platform
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ravenjax.engines.trace_key import Objects

_OPTIMISATION = 1
"""Of code generation; the IR itself needs no passes. A higher level gives the same code."""
_OPTIONS = ("-pre-RA-sched=source", "-enable-misched=false")
"""Operations stay in the order in which they are printed: `schedule` has put them there. For the
whole process.
"""


@dataclasses.dataclass(frozen=True)
class Host:
    """The CPU that code is compiled for."""

    cpu: str
    features: frozenset[str]

    @property
    def width(self) -> int:
        """float32 lanes of its widest vectors."""
        return 16 if "avx512f" in self.features else 8 if "avx2" in self.features else 4

    @property
    def vectors(self) -> str:
        """Its widest vectors in words."""
        return {16: "AVX-512", 8: "AVX2", 4: "128-bit vectors"}[self.width]

    @property
    def text(self) -> str:
        """Features as LLVM takes them."""
        return ",".join(f"+{name}" for name in sorted(self.features))


@cache
def host() -> Host:
    """This machine's CPU."""
    for option in _OPTIONS:
        llvm.set_option("ravenjax", option)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = frozenset(name for name, there in llvm.get_host_cpu_features().items() if there)
    return Host(llvm.get_host_cpu_name(), features)


def portable() -> Host:
    """Any CPU of this machine's kind."""
    return Host({"x86_64": "x86-64"}.get(platform.machine(), "generic"), frozenset())


class HostModule:
    """Compiled functions, for as long as this object lives."""

    def __init__(self, code: bytes, names: Sequence[str]) -> None:
        # JITLink puts code and constants side by side; the older loader may not, and then aborts
        # the process.
        self._jit = llvm.create_lljit_compiler(_machine(host()), use_jit_link=True)
        builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process()
        for name in names:
            builder.export_symbol(name)
        self._library = builder.link(self._jit, "kernel")

    def function(self, name: str, arguments: Sequence[Any], brief: bool = False) -> Any:
        """A function without a result. ctypes releases the GIL while it runs, except for a `brief`
        one: a thread that releases the GIL may wait milliseconds to get it back."""
        kind = ctypes.PYFUNCTYPE if brief else ctypes.CFUNCTYPE
        return kind(None, *arguments)(self._library[name])


def compile(text: str, names: Sequence[str], objects: Objects | None = None) -> HostModule:
    """Compile functions `names` of a module's text, or take them from `objects`, where they are
    left otherwise.
    """
    target = host()
    source = (llvmlite.__version__, target.cpu, target.text, *_OPTIONS, str(_OPTIMISATION), text)
    key = hashlib.sha256("\n".join(source).encode()).hexdigest()
    code = objects.get(key) if objects is not None else None
    if code is None:
        code = emit(text, target)
        if objects is not None:
            objects[key] = code
    return HostModule(code, names)


def emit(text: str, target: Host) -> bytes:
    """An object file of a module's text, of position-independent code."""
    host()  # LLVM is made ready
    module = llvm.parse_assembly(text, llvm.create_context())
    machine = _machine(target)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    return machine.emit_object(module)


def _machine(target: Host) -> Any:
    llvm_target = llvm.Target.from_default_triple()
    return llvm_target.create_target_machine(
        target.cpu, target.text, _OPTIMISATION, reloc="pic", codemodel="small", jit=True
    )
