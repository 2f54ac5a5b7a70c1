"""The whole tick: what it is made of, and what one robot does in it."""

from __future__ import annotations

from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from empty_faults import no_faults

from ravenjax.numbers.setup import Injection, SiteUse
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.declaration import SITES
from ravenjax.robots.raven2.loop import run, tick
from ravenjax.robots.raven2.loop.records import Input
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor
from ravenjax.vocabulary import effects
from ravenjax.vocabulary.detectors import DetectorUse

EFFECTS = tuple(name for name in effects.EFFECTS if name not in effects.NETWORK_EFFECTS)

ARITHMETIC = {
    "add",
    "sub",
    "mul",
    "div",
    "neg",
    "abs",
    "sign",
    "min",
    "max",
    "rem",
    "square",
    "integer_pow",
}
FUNCTIONS = {"sqrt", "sin", "cos", "acos", "atan2", "exp", "log", "floor", "round"}
LOGIC = {"and", "or", "xor", "not", "eq", "ne", "lt", "le", "gt", "ge", "select_n", "is_finite"}
BITS = {
    "shift_left",
    "shift_right_arithmetic",
    "shift_right_logical",
    "bitcast_convert_type",
    "convert_element_type",
}
SCALAR_PRIMITIVES = ARITHMETIC | FUNCTIONS | LOGIC | BITS | {"copy"}
LOOKUP_PRIMITIVES = frozenset(
    ("dynamic_slice", "gather", "squeeze", "slice", "broadcast_in_dim", "clamp")
)
"""How JAX writes one number taken from a column of the operator's motion."""


def everywhere(arms: tuple[str, ...]) -> Injection:
    """Every channel of every site with every effect, two slots."""
    uses = []
    for site in SITES.values():
        places = arms if site.per_arm else ("",)
        channels = tuple((arm, channel.name) for arm in places for channel in site.channels)
        uses.append(SiteUse(site.name, channels, EFFECTS))
    return Injection(slots=2, sites=tuple(uses), triggers=tuple(effects.TRIGGERS))


SETUPS = {
    "gold": RavenSetup(),
    "both arms": RavenSetup(arms=("gold", "green"), tools=("r_grasper", "large_needle")),
    "fork, absolute console": RavenSetup(software="fork2015", console="absolute"),
    "noise and substeps": RavenSetup(noise=True, substeps=2),
    "detectors and reaction": RavenSetup(
        detectors=(DetectorUse("steps", "two", 2, 2), DetectorUse("derivative_sum")),
        reacts=True,
        command_delay=2,
    ),
    "a hand that yields": RavenSetup(
        arms=("gold", "green"), tools=("r_grasper",) * 2, hand_yields=True
    ),
    "dynamics simulator": RavenSetup(software="fork2015", build="dyn_sim", console="absolute"),
    "every fault site": RavenSetup(injection=everywhere(("gold",))),
    "every fault site, both arms": RavenSetup(
        arms=("gold", "green"),
        tools=("r_grasper",) * 2,
        injection=everywhere(("gold", "green")),
        cues=3,
    ),
}


def build(setup: RavenSetup, ticks: int = 100, name: str = "suture"):
    """(params, state, motion columns, reference) of a run."""
    motion = motions.generate(name, ticks / 1000.0, setup.arms)
    params = run.params(setup, motion.start_jpos)
    columns = tuple(jnp.asarray(column) for column in motion.table().T)
    zero = Vec.full(3, 0.0)
    reference = monitor.Reference(tuple(zero for _ in setup.arms), tuple(zero for _ in setup.arms))
    return params, run.init(setup, params), columns, reference


def trace(setup: RavenSetup):
    params, state, columns, reference = build(setup)

    def step(state, now):
        return tick.tick(setup, params, no_faults(setup), state, Input(now, columns, reference))

    return jax.make_jaxpr(step)(state, jnp.int32(0))


def flat(jaxpr):
    """Every equation, calls inlined."""
    for equation in jaxpr.eqns:
        bodies = equation.params.get("branches", equation.params.values())  # of a rare choice, both
        inner = [value.jaxpr for value in bodies if hasattr(value, "jaxpr")]
        if inner:
            for sub in inner:
                yield from flat(sub)
        else:
            yield equation


@pytest.mark.slow
@pytest.mark.parametrize("name", SETUPS)
def test_the_tick_is_a_straight_list_of_scalar_operations(name):
    equations = list(flat(trace(SETUPS[name]).jaxpr))
    used = Counter(equation.primitive.name for equation in equations)
    unknown = set(used) - SCALAR_PRIMITIVES - LOOKUP_PRIMITIVES
    assert not unknown, f"primitives that a printer of scalar code does not know: {sorted(unknown)}"
    for equation in equations:
        if equation.primitive.name in SCALAR_PRIMITIVES:
            shapes = {variable.aval.shape for variable in (*equation.invars, *equation.outvars)}
            assert shapes == {()}, f"{equation.primitive.name} on {shapes}"


@pytest.mark.slow
def test_faults_that_a_campaign_does_not_name_are_not_in_its_tick():
    without = len(list(flat(trace(SETUPS["gold"]).jaxpr)))
    one = Injection(1, (SiteUse("usb_out", (("gold", "shoulder"),), ("overwrite",)),), ("time",))
    with_one = len(list(flat(trace(RavenSetup(injection=one)).jaxpr)))
    assert 0 < with_one - without < 60


def test_the_reference_series_holds_what_it_gives_back():
    setup = SETUPS["both arms"]
    numbers = [np.float32(i) for i in range(run.series_length(setup))]
    reference = run.reference_from(setup, numbers)
    assert [list(v) for v in (*reference.tip, *reference.pos)] == [
        [0, 1, 2],
        [6, 7, 8],
        [3, 4, 5],
        [9, 10, 11],
    ]
