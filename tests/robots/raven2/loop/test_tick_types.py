"""Every number of state and signals keeps its type and shape from tick to tick, in each
precision.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import pytest
from empty_faults import no_faults

from ravenjax.numbers.setup import CAMPAIGN, ORIGINAL, REFERENCE, Injection, SiteUse, real
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.loop import run, tick
from ravenjax.robots.raven2.loop.records import Input
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor
from ravenjax.vocabulary.detectors import DetectorUse

FAULTS = Injection(
    slots=2,
    sites=(
        SiteUse("usb_out", (("gold", "shoulder"),), ("overwrite", "stuck")),
        SiteUse("network", (("", "lost"),), ("overwrite",)),
    ),
    triggers=("time",),
)
MOST = RavenSetup(
    injection=FAULTS,
    detectors=(DetectorUse("steps", "two", 2, 2),),
    reacts=True,
    hand_yields=True,
    command_delay=2,
    noise=True,
)
FORK = RavenSetup(
    arms=("gold", "green"),
    tools=("r_grasper",) * 2,
    software="fork2015",
    console="absolute",
    cues=2,
)
CASES = {
    "float32": dataclasses.replace(MOST, precision=CAMPAIGN),
    "float32, fork": dataclasses.replace(FORK, precision=CAMPAIGN),
    "widths of the original": dataclasses.replace(MOST, precision=ORIGINAL),
    "float64": dataclasses.replace(MOST, precision=REFERENCE),
}


class Number(NamedTuple):
    """The type of a leaf; a weak type would compile once more where a strong one follows."""

    dtype: str
    shape: tuple[int, ...]
    weak: bool


class Types(NamedTuple):
    """Types by the leaf's path: of the state that a run begins with, and of two ticks one after
    the other.
    """

    start: dict[str, Number]
    states: tuple[dict[str, Number], dict[str, Number]]
    signals: tuple[dict[str, Number], dict[str, Number]]


def by_path(tree: Any) -> dict[str, Number]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {
        jax.tree_util.keystr(path): Number(str(leaf.dtype), tuple(leaf.shape), leaf.weak_type)
        for path, leaf in leaves
    }


def types_of(setup: RavenSetup) -> Types:
    with jax.enable_x64(setup.precision.needs_x64):
        motion = motions.generate("suture", 0.1, setup.arms)
        params = run.params(setup, motion.start_jpos)
        columns = tuple(jnp.asarray(column) for column in motion.table().T)
        still = real(setup, tuple(Vec.full(3, 0.0) for _ in setup.arms))
        reference = monitor.Reference(still, still)

        def advance(state: Any, now: Any) -> Any:
            signal = Input(now, columns, reference)
            return tick.tick(setup, params, no_faults(setup), state, signal)

        start = jax.eval_shape(lambda: run.init(setup, params))
        traced: Callable[..., Any] = jax.jit(advance)
        first, signals = traced.eval_shape(start, jax.ShapeDtypeStruct((), jnp.int32))
        second, more = traced.eval_shape(first, jax.ShapeDtypeStruct((), jnp.int32))
        return Types(
            by_path(start), (by_path(first), by_path(second)), (by_path(signals), by_path(more))
        )


@pytest.fixture(scope="module", params=CASES)
def setup(request):
    return CASES[request.param]


@pytest.fixture(scope="module")
def types(setup):
    return types_of(setup)


def strong(numbers: dict[str, Number]) -> dict[str, Number]:
    return {path: number._replace(weak=False) for path, number in numbers.items()}


@pytest.mark.slow
def test_state_and_signals_keep_type_and_shape_over_a_tick(types):
    """Apart from weak types of constants, with which a run may begin."""
    assert len(types.start) > 150
    assert strong(types.states[0]) == strong(types.start)
    assert types.states[1] == types.states[0]
    assert types.signals[1] == types.signals[0]


@pytest.mark.slow
def test_no_number_is_wider_or_narrower_than_its_precision(types, setup):
    widths = setup.precision
    wanted = {widths.narrow, widths.wide, widths.real}
    for numbers in (types.states[0], types.signals[0]):
        floats = {number.dtype for number in numbers.values() if number.dtype.startswith("float")}
        others = {number.dtype for number in numbers.values()} - floats
        assert floats <= wanted and widths.real in floats
        assert others <= {"int32", "uint32", "bool"}
        assert {number.shape for number in numbers.values()} == {()}, (
            "single numbers, as a tick has no axes"
        )
