"""What is traced without JAX is what is traced through it; what only JAX knows goes there."""

from __future__ import annotations

import dataclasses
import sys
import types
from pathlib import Path

import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import direct, traced, tracing
from ravenjax.engines.interface import Block
from ravenjax.ir.lowering import UnknownPrimitive
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import ORIGINAL
from ravenjax.robots.raven2 import ROBOT

CAMPAIGNS = sorted((Path(__file__).resolve().parents[2] / "campaigns").glob("*.toml"))
NO_JAX = "without JAX"


def arguments(campaign):
    """What is traced of a campaign's tick."""
    made = plan.make_plan(rj.load_campaign(campaign))
    return traced.printable(made.program), Block(*made.lanes([0], 1), None), made.columns


@pytest.fixture(scope="module")
def small():
    fault = {
        "site": "usb_out",
        "channel": "elbow",
        "effect": "offset",
        "value": [0, 4000],
        "start_ms": 20,
    }
    return arguments(
        {
            "campaign": {"name": "direct", "duration_s": 0.1},
            "operator": {"motion": "reach"},
            "group": [{"name": "dac", "fault": [fault]}],
        }
    )


def same(program, block, motion):
    alone, through = direct.trace(program, block, motion), tracing.trace(program, block, motion)
    assert alone == through
    assert type(alone.signals) is type(through.signals)


@pytest.mark.slow
@pytest.mark.parametrize("file", CAMPAIGNS, ids=lambda file: file.stem)
def test_a_bundled_campaign_is_traced_the_same(file):
    same(*arguments(file))


def test_a_tick_is_traced_the_same(small):
    same(*small)


def test_a_tick_that_ends_by_itself_is_traced_the_same(small):
    program, block, motion = small
    same(dataclasses.replace(program, ends=True), block, motion)


@pytest.mark.slow
def test_an_explained_tick_is_traced_the_same(small):
    program, block, motion = small
    same(ROBOT.part("campaign").explained(program), block, motion)


@pytest.fixture
def ways(monkeypatch):
    """Which way each trace went."""
    taken, alone, through = [], direct.trace, tracing.trace

    def directly(*some):
        result = alone(*some)
        taken.append(NO_JAX)
        return result

    monkeypatch.setattr(direct, "trace", directly)
    monkeypatch.setattr(tracing, "trace", lambda *some: taken.append("JAX") or through(*some))
    return taken


def test_a_campaign_goes_without_jax(small, ways):
    traced.trace(*small)
    assert ways == [NO_JAX]


def test_wide_numbers_are_traced_by_jax(small, ways):
    program, block, motion = small
    setup = dataclasses.replace(program.setup, precision=ORIGINAL)
    with pytest.raises(direct.Untraceable, match="64 bits"):
        direct.trace(dataclasses.replace(program, setup=setup), block, motion)
    with pytest.raises(
        UnknownPrimitive, match="float64"
    ):  # nor do printed programs know sines of them
        traced.trace(dataclasses.replace(program, setup=setup), block, motion)
    assert ways == ["JAX"]


def test_a_function_that_is_not_known_is_traced_by_jax(small, ways, monkeypatch):
    program, block, motion = small
    own = types.SimpleNamespace(**vars(program.loop))
    own.outcomes = lambda *some: program.loop.outcomes(*some) | {"own": jnp.cbrt(jnp.cosh(1.0))}
    monkeypatch.setitem(sys.modules, "ravenjax.own_loop", own)
    other = dataclasses.replace(program, module="ravenjax.own_loop")
    with pytest.raises(UnknownPrimitive, match=r"cbrt|cosh"):  # nor do printed programs know it
        traced.trace(other, block, motion)
    assert ways == ["JAX"]
    ways.clear()
    own.outcomes = lambda *some: (
        program.loop.outcomes(*some) | {"own": jnp.clip(jnp.float32(5.0), 1.0, 2.0)}
    )
    result = traced.trace(other, block, motion)
    assert ways == ["JAX"] and "own" in result.outcomes


def test_a_robot_of_another_package_is_traced_by_jax(small, ways, monkeypatch):
    program, block, motion = small
    monkeypatch.setitem(sys.modules, "my_lab_robot", types.SimpleNamespace(**vars(program.loop)))
    traced.trace(dataclasses.replace(program, module="my_lab_robot"), block, motion)
    assert ways == ["JAX"]


def test_where_operations_come_from_is_traced_by_jax(small, ways):
    assert traced.trace(*small, lambda eqn: "somewhere").loop.step.origins
    assert ways == ["JAX"]
