"""Compiles LLVM IR to callable functions for this machine's CPU, with an optional disk cache."""

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
"""Optimisation level of code generation. The IR needs no passes, and a higher level gives the same
code.
"""
_OPTIONS = ("-pre-RA-sched=source", "-enable-misched=false")
"""Options that keep operations in the order in which they are printed, which `schedule` has chosen.

They hold for the whole process.
"""
FUSED = frozenset(("fma", "neon", "fp-armv8"))
"""CPU features that provide a fused multiply-add."""
NO_FMA = "no FMA"
"""Words in the description of a CPU without fused multiply-add, which rounds differently."""


@dataclasses.dataclass(frozen=True)
class Host:
    """A CPU that code is compiled for."""

    cpu: str
    features: frozenset[str]

    @property
    def width(self) -> int:
        """Number of float32 lanes of the CPU's widest vectors."""
        return 16 if "avx512f" in self.features else 8 if "avx2" in self.features else 4

    @property
    def vectors(self) -> str:
        """Description of the CPU's widest vectors."""
        widest = {16: "AVX-512", 8: "AVX2", 4: "128-bit vectors"}[self.width]
        return widest if self.features & FUSED else f"{widest}, {NO_FMA}"

    @property
    def text(self) -> str:
        """CPU features in LLVM's format."""
        return ",".join(f"+{name}" for name in sorted(self.features))


@cache
def host() -> Host:
    """Return this machine's CPU."""
    for option in _OPTIONS:
        llvm.set_option("ravenjax", option)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = frozenset(name for name, there in llvm.get_host_cpu_features().items() if there)
    return Host(llvm.get_host_cpu_name(), features)


def portable() -> Host:
    """Return the baseline CPU of this machine's architecture."""
    return Host({"x86_64": "x86-64"}.get(platform.machine(), "generic"), frozenset())


class HostModule:
    """Compiled functions. They can be called as long as this object lives."""

    def __init__(self, code: bytes, names: Sequence[str]) -> None:
        # JITLink places code and constants side by side. The older loader may not, and then aborts
        # the process.
        self._jit = llvm.create_lljit_compiler(_machine(host()), use_jit_link=True)
        builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process()
        for name in names:
            builder.export_symbol(name)
        self._library = builder.link(self._jit, "kernel")

    def function(self, name: str, arguments: Sequence[Any], brief: bool = False) -> Any:
        """Return a function without a result.

        ctypes releases the GIL while the function runs, unless it is `brief`: a thread that
        releases the GIL may wait milliseconds to get it back.
        """
        kind = ctypes.PYFUNCTYPE if brief else ctypes.CFUNCTYPE
        return kind(None, *arguments)(self._library[name])


def compile(text: str, names: Sequence[str], objects: Objects | None = None) -> HostModule:
    """Compile functions `names` of a module's text, or load them from `objects`. New code is stored
    there.
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
    """Compile a module's text to an object file of position-independent code."""
    # This initialises LLVM.
    host()
    module = llvm.parse_assembly(text, llvm.create_context())
    machine = _machine(target)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    return machine.emit_object(module)


def _machine(target: Host) -> Any:
    llvm_target = llvm.Target.from_default_triple()
    return llvm_target.create_target_machine(
        target.cpu, target.text, _OPTIMISATION, reloc="pic", codemodel="small", jit=True
    )
