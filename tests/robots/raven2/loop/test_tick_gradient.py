"""Derivatives by reverse differentiation through several ticks are those of central differences, in
float64.

The robot is digital: DAC and encoder counts are whole numbers, and no derivative passes through
them. It is that of what lies between two roundings, and so are differences by steps so small that
no count changes. A gain of the control software therefore moves the torque that it asks for, and,
as long as no count changes, not the tip.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from empty_faults import no_faults
from jax.extend import core

from ravenjax.engines.cpu import python
from ravenjax.numbers import paths
from ravenjax.numbers.setup import REFERENCE, real
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.loop import run, tick
from ravenjax.robots.raven2.loop.records import Input
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor

SETUP = RavenSetup(precision=REFERENCE)
PARAMETERS = (
    "plant.gold.friction_scale",
    "control.motor_control.gold.kp.elbow",
    "nominal.gold.kp.elbow",
)
OUTCOMES = ("tip", "torque", "model")
WARM_UP = 800  # ticks until the pedal is down, the brakes are off and the hand moves
TICKS = 3


class Course(NamedTuple):
    """One traced tick as a function of flat numbers: parameters, state, tick -> state, outcomes."""

    jaxpr: core.ClosedJaxpr
    begin: list[Any]  # numbers of the state before the first tick that is differentiated
    values: list[float]  # of PARAMETERS
    plain: python.ScalarFunction

    def outcome(self, name: str, values: list[float]) -> float:
        """An outcome after TICKS ticks, evaluated one operation after the other by Python."""
        state = self.begin
        for now in range(WARM_UP, WARM_UP + TICKS):
            out = self.plain(self.plain.represent([*values, *state, now]))
            state, told = out[: len(self.begin)], out[len(self.begin) :]
        return float(told[OUTCOMES.index(name)])

    def gradient(self) -> np.ndarray:
        """Derivatives of the sum of all outcomes by `jax.grad`."""
        types = [variable.aval.dtype for variable in self.jaxpr.jaxpr.invars]
        begin = [
            jnp.asarray(x, dtype)
            for x, dtype in zip(self.begin, types[len(PARAMETERS) :], strict=False)
        ]

        def total(values: Any) -> Any:
            told: list[Any] = []
            state: list[Any] = begin
            for now in range(WARM_UP, WARM_UP + TICKS):
                out = evaluate(
                    self.jaxpr.jaxpr, self.jaxpr.consts, [*values, *state, jnp.int32(now)]
                )
                state, told = out[: len(begin)], out[len(begin) :]
            return sum(told)

        return np.array(jax.grad(total)([jnp.float64(value) for value in self.values]))


def evaluate(jaxpr: core.Jaxpr, consts: Any, arguments: list[Any]) -> list[Any]:
    """A jaxpr operation by operation, calls inlined: nothing of the size of a tick has to be
    compiled.
    """
    known = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))
    for equation in jaxpr.eqns:
        given = [x.val if isinstance(x, core.Literal) else known[x] for x in equation.invars]
        inner = equation.params.get("jaxpr")
        if equation.primitive.name == "cond":
            branch = equation.params["branches"][int(given[0])]
            out = evaluate(branch.jaxpr, branch.consts, given[1:])
        elif inner is not None and hasattr(inner, "consts"):
            out = evaluate(inner.jaxpr, inner.consts, given)
        else:
            out = equation.primitive.bind(*given, **equation.params)
            out = out if equation.primitive.multiple_results else [out]
        known.update(zip(equation.outvars, out, strict=True))
    return [x.val if isinstance(x, core.Literal) else known[x] for x in jaxpr.outvars]


@pytest.fixture(scope="module")
def course():
    with jax.enable_x64(True):
        motion = motions.generate("suture", 2.0, SETUP.arms)
        params = run.params(SETUP, motion.start_jpos)
        columns = tuple(jnp.asarray(column) for column in motion.table().T)
        still = real(SETUP, tuple(Vec.full(3, 0.0) for _ in SETUP.arms))
        reference = monitor.Reference(still, still)
        state = run.init(SETUP, params)

        def advance(values: Any, state: Any, now: Any) -> Any:
            changed = params
            for path, value in zip(PARAMETERS, values, strict=True):
                changed = paths.assign(changed, SETUP, path, value)
            signal = Input(now, columns, reference)
            state, signals = tick.tick(SETUP, changed, no_faults(SETUP), state, signal)
            software, model = signals.control.arms[0], signals.nominal[0]
            return state, (signals.tip[0][0], software.tau_d[1], model.tip_position[2])

        numbers = dict(paths.leaves(params, SETUP))
        values = [float(numbers[path]) for path in PARAMETERS]
        jaxpr = jax.make_jaxpr(advance)(
            [jnp.float64(value) for value in values], state, jnp.int32(0)
        )
        plain = python.compile(jaxpr)
        flat: list[Any] = jax.tree.leaves(state)
        for now in range(WARM_UP):
            flat = list(plain(plain.represent([*values, *flat, now]))[: len(flat)])
        yield Course(jaxpr, flat, values, plain)


def difference(course: Course, name: str, place: int) -> float:
    """Central difference by a step in which no count changes."""
    step = 1e-7 * course.values[place]
    ends = []
    for sign in (1, -1):
        values = list(course.values)
        values[place] += sign * step
        ends.append(course.outcome(name, values))
    return (ends[0] - ends[1]) / (2 * step)


@pytest.mark.slow
def test_a_gradient_through_ticks_is_that_of_finite_differences(course):
    differences = np.array(
        [[difference(course, name, k) for k in range(len(PARAMETERS))] for name in OUTCOMES]
    )
    own = np.diag(differences)
    assert (own != 0.0).all(), (
        "friction moves the tip, a gain the torque, the model's gain the model"
    )
    assert (differences == np.diag(own)).all(), "between two roundings nothing else reaches them"
    np.testing.assert_allclose(course.gradient(), own, rtol=1e-4)
