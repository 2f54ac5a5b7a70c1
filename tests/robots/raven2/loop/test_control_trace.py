"""What the control software traces to: primitives, their number, the order of fault sites,
stable number types.
"""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.engines.cpu import python
from ravenjax.ir import lowering, regions
from ravenjax.numbers.setup import CAMPAIGN, ORIGINAL
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.sites import SITES
from ravenjax.robots.raven2.stages.usb import UsbIn

BOTH = {"arms": ("gold", "green"), "tools": ("r_grasper", "r_grasper")}
ALLOWED = {
    *(
        "add",
        "sub",
        "mul",
        "div",
        "neg",
        "abs",
        "max",
        "min",
        "sqrt",
        "round",
        "sin",
        "cos",
        "atan2",
    ),
    *(
        "eq",
        "ne",
        "lt",
        "le",
        "gt",
        "ge",
        "and",
        "or",
        "not",
        "xor",
        "select_n",
        "convert_element_type",
    ),
    *("shift_left", "shift_right_arithmetic"),
}
ORDER = [
    "packet",
    "packet_header",
    "usb_in",
    "runlevel",
    "mpos",
    "mvel",
    "jpos",
    "jvel",
    "pos",
    "ori",
    "pos_d",
]
ORDER += ["ori_d", "jpos_d", "mpos_d", "tau_d", "current_cmd", "usb_out", "pins_out"]


def primitives(jaxpr):
    """Names of the operations, those of functions that are called among them."""
    names = set()
    for eqn in jaxpr.eqns:
        inner = eqn.params.get("jaxpr") or eqn.params.get("call_jaxpr")
        names |= (
            {eqn.primitive.name} if inner is None else primitives(getattr(inner, "jaxpr", inner))
        )
    return names


def inputs(setup):
    arms, zero = range(len(setup.arms)), np.int32(0)
    number = np.dtype(setup.precision.wide).type
    still, unit = (
        tuple(Vec.full(3, zero) for _ in arms),
        tuple(Vec(map(number, (0, 0, 0, 1))) for _ in arms),
    )
    packet = Packet(zero, zero, zero, still, unit, tuple(zero for _ in arms), zero)
    return control.Inputs(
        packet, UsbIn(tuple(Vec.full(7, zero) for _ in arms), tuple(arms)), tuple(arms)
    )


def arguments(setup):
    return control.params(setup), control.init(setup), inputs(setup)


def each_pair():
    """Every combination; those of the fast suite hold every pair of choices."""
    choices = itertools.product(
        (CAMPAIGN, ORIGINAL), ("raven2", "fork2015"), ("increments", "absolute")
    )
    for precision, software, console in choices:
        odd = (precision is ORIGINAL) + (software == "fork2015") + (console == "absolute")
        name = f"{'original' if precision is ORIGINAL else 'campaign'}-{software}-{console}"
        yield pytest.param(
            precision, software, console, id=name, marks=[pytest.mark.slow] * (odd % 2)
        )


@pytest.mark.slow
@pytest.mark.parametrize(("precision", "software", "console"), [*each_pair()])
def test_only_scalar_primitives_and_the_state_keeps_its_types(precision, software, console):
    setup = RavenSetup(**BOTH, software=software, console=console, precision=precision)
    with jax.enable_x64(precision.needs_x64):
        given = arguments(setup)
        jaxpr, (state, _) = jax.make_jaxpr(lambda *a: control.cycle(setup, *a), return_shape=True)(
            *given
        )
        before = [jnp.asarray(x).dtype for x in jax.tree.leaves(given[1])]
    literal = {"acos"} if precision is ORIGINAL else set()  # the original's own way to theta2
    assert primitives(jaxpr.jaxpr) <= ALLOWED | literal | {"cond"}  # `types.rarely`
    assert jax.tree.structure(state) == jax.tree.structure(given[1])
    assert [leaf.dtype for leaf in jax.tree.leaves(state)] == before
    if precision is CAMPAIGN:
        assert {str(dtype) for dtype in before} == {"int32", "float32"}


@pytest.mark.parametrize(("arms", "limit"), [(("gold",), 2000), (("gold", "green"), 3850)])
def test_the_number_of_operations_stays_low(arms, limit):
    setup = RavenSetup(arms=arms, tools=("r_grasper",) * len(arms))
    program = lowering.lower(jax.make_jaxpr(lambda *a: control.cycle(setup, *a))(*arguments(setup)))
    always = [
        i
        for i in regions.arrange(program.operations, program.needed(), program.outputs)
        if isinstance(i, int)
    ]
    assert sum(program.operations[i].name not in ("input", "constant") for i in always) < limit


def test_every_site_of_the_control_software_is_passed_once_in_order():
    passed = []

    def note(site, signal, present=True):
        passed.append(site)
        if site in ("ori", "ori_d"):  # rotation matrices, which are struck as quaternions
            assert [[jnp.shape(x) for x in row] for row in signal[1]] == [[()] * 3] * 3
            return signal
        for channel in SITES[site].channels:
            value = signal
            for step in channel.path:
                value = (
                    getattr(value, step)
                    if isinstance(step, str) and step != "ARM"
                    else value[1 if step == "ARM" else step]
                )
            assert jnp.shape(value) == ()
        return signal

    setup = RavenSetup(**BOTH)
    jax.make_jaxpr(lambda *a: control.cycle(setup, *a, note))(*arguments(setup))
    assert passed == ORDER


def test_a_fault_after_the_checks_reaches_the_boards():
    setup = RavenSetup(**BOTH)

    def strike(site, signal, present=True):
        return tuple(Vec.full(7, jnp.int32(32767)) for _ in signal) if site == "usb_out" else signal

    given = arguments(setup)
    jaxpr, (_, shape) = jax.make_jaxpr(
        lambda *a: control.cycle(setup, *a, strike), return_shape=True
    )(*given)
    cycle, signals = python.compile(jaxpr), jax.tree.structure(shape)
    numbers = cycle(cycle.represent(jax.tree.leaves(given)))
    arm = jax.tree.unflatten(signals, numbers[-signals.num_leaves :]).arms[0]
    assert [int(x) for x in arm.current_cmd_written] == [32767] * 7
    assert [int(x) for x in arm.current_cmd_checked] == [0] * 7
