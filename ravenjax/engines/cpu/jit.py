"""Compiles LLVM IR to functions for the CPU of this machine, with an optional cache on disk."""

import ctypes
import dataclasses
import platform
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ravenjax.engines.trace_key import Objects, hash_values, load_or_make
from ravenjax.errors import UserError

_OPTIMISATION = 1
"""Optimisation level of code generation. A higher level gives the same code."""
_OPTIONS = ("-pre-RA-sched=source", "-enable-misched=false")
"""Options of the whole process that keep operations in the order of `schedule_operations`."""

FUSED = frozenset(("fma", "neon", "fp-armv8"))
"""CPU features that provide a fused multiply-add."""


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
        return {16: "AVX-512", 8: "AVX2", 4: "128-bit vectors"}[self.width]

    @property
    def text(self) -> str:
        """CPU features in LLVM's format."""
        return ",".join(f"+{name}" for name in sorted(self.features))


@cache
def host_target() -> Host:
    """Return this machine's CPU. Raises UserError if it has no fused multiply-add."""
    # LLVM takes options as from a command line, which begins with the name of a program.
    for option in _OPTIONS:
        llvm.set_option("ravenjax", option)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = frozenset(name for name, has in llvm.get_host_cpu_features().items() if has)
    if not features & FUSED:
        raise UserError(
            f"CPU {llvm.get_host_cpu_name()} has no fused multiply-add, so results would differ"
            " from those of other machines: expected x86-64-v3 (Intel or AMD since 2013) or"
            " aarch64; in an emulator or a virtual machine, pass the CPU of the host through; or"
            " use --engine xla"
        )
    return Host(llvm.get_host_cpu_name(), features)


def portable_target() -> Host:
    """Return the baseline CPU of this machine's architecture."""
    return Host({"x86_64": "x86-64"}.get(platform.machine(), "generic"), frozenset())


class HostModule:
    """Compiled functions. They can be called as long as this object lives."""

    def __init__(self, code: bytes, names: Sequence[str]):
        # JITLink puts code and constants next to each other. The older loader may not, and aborts.
        self._jit = llvm.create_lljit_compiler(_machine(host_target()), use_jit_link=True)
        builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process()
        for name in names:
            builder.export_symbol(name)
        self._library = builder.link(self._jit, "kernel")

    def function(self, name: str, arguments: Sequence[Any], brief: bool = False) -> Any:
        """Return the compiled function `name`, which has no result. arguments: ctypes' types.
        ctypes releases the GIL while the function runs, unless it is `brief`: a thread that
        releases the GIL may wait milliseconds to get it back.
        """
        kind = ctypes.PYFUNCTYPE if brief else ctypes.CFUNCTYPE
        return kind(None, *arguments)(self._library[name])


def compile_functions(
    text: str, names: Sequence[str], objects: Objects | None = None
) -> HostModule:
    """Compile functions `names` of a module's text, or load them from `objects`."""
    target = host_target()
    key = hash_values(llvmlite.__version__, target.cpu, target.text, _OPTIONS, _OPTIMISATION, text)
    return HostModule(load_or_make(objects, key, lambda: emit_object(text, target)), names)


def emit_object(text: str, target: Host) -> bytes:
    """Compile a module's text to an object file of position-independent code."""
    host_target()  # initialises LLVM
    return emit_for_machine(text, _machine(target))


def emit_for_machine(text: str, machine: Any) -> bytes:
    """Compile a module's text to an object file for one of LLVM's target machines."""
    module = llvm.parse_assembly(text, llvm.create_context())
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    return machine.emit_object(module)


def _machine(target: Host) -> Any:
    return llvm.Target.from_default_triple().create_target_machine(
        target.cpu, target.text, _OPTIMISATION, reloc="pic", codemodel="small", jit=True
    )
