"""Where compiled kernels are kept between processes: a campaign that was compiled once starts at once."""

from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path

import jax

VARIABLE = "RAVENJAX_CACHE"
"""Environment variable: another folder, or "off"."""


def enable() -> Path | None:
    """Turn on JAX's persistent cache of compiled programs, unless it is set up already; its folder, None where off.

    Code for one CPU may not run on another that shares the home folder, so each kind of CPU has a folder of its own.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted.lower() == "off":
        return None
    if jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        return Path(jax.config.jax_compilation_cache_dir)  # pyright: ignore[reportAttributeAccessIssue]
    base = Path(wanted) if wanted else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ravenjax"
    folder = base / f"xla-{_machine()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # no cache is no reason not to run
        return None
    jax.config.update("jax_compilation_cache_dir", str(folder))
    return folder


def _machine() -> str:
    """Short hash of what decides which instructions this CPU has."""
    flags = [platform.machine()]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags += [line for line in lines if line.startswith(("flags", "Features"))][:1]
    except OSError:
        flags.append(platform.processor())
    return hashlib.sha256("\n".join(flags).encode()).hexdigest()[:8]
