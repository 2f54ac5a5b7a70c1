"""Writes a folder with a robot as a C library: header, object file, shared library and an example.

The object file needs no C compiler, because LLVM emits it, as for the engines. The shared library
needs the system's linker. Without a linker, a program can use the object file.
"""

import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ravenjax.engines.cpu import jit
from ravenjax.errors import UserError
from ravenjax.robots.raven2 import c_library
from ravenjax.robots.raven2.software.control_software import ControlSoftware
from ravenjax.robots.raven2.virtual_robot import VirtualRobot

NAME = "ravenjax_raven2"
COMPILERS = ("cc", "gcc", "clang")
PORTABLE, NATIVE = "portable", "native"
CPUS = (PORTABLE, NATIVE)


class CFolder(NamedTuple):
    """Paths of the files that were written."""

    header: Path
    object: Path
    shared: Path | None  # None if no compiler is installed
    example: Path


def write_library(
    folder: Path,
    software: ControlSoftware | None = None,
    robot: VirtualRobot | None = None,
    cpu: str = PORTABLE,
) -> CFolder:
    """Write the C library of a control software and a robot, with their settings and state.

    The default software is raven2. `cpu`: "portable" code runs on any CPU of this architecture;
    "native" code may use all features of this CPU. Both give identical bits. Raise UserError for
    wrong arguments, and if the compiler cannot link the library.
    """
    if cpu not in CPUS:
        raise UserError(f"cpu is {cpu!r}, expected one of {', '.join(CPUS)}")
    software = ControlSoftware() if software is None else software
    robot = VirtualRobot(software.setup.arms, software.setup.tools) if robot is None else robot
    texts = c_library.make_library(software, robot)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be created ({error.strerror or error}); name another folder"
        ) from error
    files = {ending: folder / f"{NAME}.{ending}" for ending in ("h", "o")}
    example = folder / "example.c"
    files["h"].write_text(texts.header, encoding="utf-8")
    files["o"].write_bytes(
        jit.emit_object(texts.code, jit.host_target() if cpu == NATIVE else jit.portable_target())
    )
    example.write_text(texts.example, encoding="utf-8")
    return CFolder(files["h"], files["o"], _linked(files["o"], folder / f"lib{NAME}.so"), example)


def _linked(code: Path, shared: Path) -> Path | None:
    """Link an object file to a shared library. Return None if no compiler is installed."""
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        # A library that was linked from an earlier object would not match this object.
        shared.unlink(missing_ok=True)
        return None
    words = [compiler, "-shared", "-o", str(shared), str(code), "-lm"]
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise UserError(f"{' '.join(words)} failed: {result.stderr.strip()}. Link {code} yourself")
    return shared
