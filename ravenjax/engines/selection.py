"""Lists the engines, and selects one: by name, or the fastest that this machine supports.

`engines.toml` has a table for each engine. The code of an engine is imported when it is selected.
"""

import os
import pkgutil
from collections.abc import MutableMapping
from typing import TYPE_CHECKING, NamedTuple

from ravenjax import resources
from ravenjax.errors import UserError, suggest_name

if TYPE_CHECKING:
    from ravenjax.engines.interface import Engine
    from ravenjax.numbers.setup import Precision


class EngineProperties(NamedTuple):
    """The properties of an engine on which other modules depend."""

    code: str  # class in this package, MODULE:CLASS, whose arguments are `name` and `objects`
    needs_gpu: bool = False  # computes only on GPUs, where one run takes longer than on a CPU
    portable: bool = True  # same bits on all devices, in all blocks, with all settings of JAX
    explains: bool = True  # can compare every number of a tick, bit by bit
    slowdown: float = 1.0  # time relative to engine simd on the same CPU


_TABLES = resources.read_tables(__file__, "engines.toml")
ENGINES = {name: EngineProperties(**table) for name, table in _TABLES.items()}
"""The engines by name, fastest first."""
CHOICES = ", ".join(("auto", *ENGINES))
"""The values of `--engine`."""
SMALL_TICKS = 12_000_000
"""Ticks for each CPU core below which "auto" selects engine simd. Engine simd computes this number
in about two seconds. Engine cuda takes longer to start.
"""


def select_engine(
    name: str,
    precision: "Precision | None" = None,
    objects: MutableMapping[str, bytes] | None = None,
    ticks: int | None = None,
) -> "Engine":
    """Return the engine of that name; "auto": this machine's fastest with this precision.
    precision: types of floats; None: float32, as in campaigns. objects: cache of compiled code that
    several processes share; None: no such cache. ticks: number of ticks of all runs together; None:
    unknown, treated as a large campaign. Raises UserError.
    """
    if name == "auto":
        name = fastest_engine(precision, ticks)[0]
    make_engine = pkgutil.resolve_name(f"{__package__}.{engine_properties(name).code}")
    return make_engine(name=name, objects=objects)


def engine_properties(name: str) -> EngineProperties:
    """Return the properties of the engine `name`. Raises UserError if the name is unknown."""
    try:
        return ENGINES[name]
    # TypeError: `name` is not hashable, such as a list.
    except (KeyError, TypeError):
        text = f"engine {name!r} is unknown: expected {CHOICES}{suggest_name(name, ENGINES)}"
        raise UserError(text) from None


def single_run_engine(name: str) -> str:
    """Return `name`, or "simd" in place of "auto" and of an engine that needs a GPU."""
    return "simd" if name == "auto" or engine_properties(name).needs_gpu else name


def fastest_engine(precision: "Precision | None", ticks: int | None = None) -> tuple[str, str]:
    """Return the engine that "auto" selects, and why it is not "cuda" ("" if it is)."""
    if ticks is not None and ticks < SMALL_TICKS * len(os.sched_getaffinity(0)):
        return "simd", "this campaign is so small that engine simd ends before a GPU could start"
    from ravenjax.engines.gpu import device, engine

    try:
        if precision is not None:
            engine.require_float32(precision)
        device.require_gpu()
    except UserError as error:
        return "simd", str(error)
    return "cuda", ""
