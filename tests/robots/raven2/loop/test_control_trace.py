"""What the control software traces to: primitives, their number, the order of fault sites,
stable number types.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from evaluated_program import in_python

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.declaration import SITES
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.usb import UsbIn

BOTH = {"arms": ("gold", "green"), "tools": ("r_grasper", "r_grasper")}
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

    def cycle(*given):
        return control.cycle(setup, *given, strike)

    given = arguments(setup)
    signals = jax.tree.structure(jax.eval_shape(cycle, *given)[1])
    numbers = in_python(cycle, *given)(jax.tree.leaves(given))
    arm = jax.tree.unflatten(signals, numbers[-signals.num_leaves :]).arms[0]
    assert [int(x) for x in arm.current_cmd_written] == [32767] * 7
    assert [int(x) for x in arm.current_cmd_checked] == [0] * 7
