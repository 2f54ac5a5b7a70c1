"""Torque to counts: signs, truncation, saturation."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import dac

SETUP = RavenSetup()
NOTHING = Vec.full(7, 0)


def counts(arm, tool, torque, enabled=True, setup=SETUP, otherwise=NOTHING):
    tau = Vec.full(7, np.float32(torque))
    return [int(x) for x in dac.step(setup, arm, tool, tau, np.bool_(enabled), otherwise)]


def test_counts_of_one_newton_metre():
    assert counts("gold", "r_grasper", 0.5) == [-1847, -1847, -1847, -13664, -13664, 13664, -13664]
    assert counts("green", "large_needle", 0.5) == [1847, 1847, 1847, 13664, 13664, -13664, 13664]
    fork = RavenSetup(software="fork2015", tools=("r_grasper_B",))
    assert counts("gold", "r_grasper_B", 0.5, setup=fork)[5] == -13664


def test_saturation_and_what_no_int_can_hold():
    assert counts("green", "r_grasper", 20.0)[0] == 32767
    assert counts("green", "r_grasper", -20.0)[0] == -32768
    for beyond in (1e9, -1e9, np.nan, np.inf):
        assert counts("green", "r_grasper", beyond)[0] == -32768


@pytest.mark.parametrize("held", [0, 123])
def test_where_not_enabled_the_command_is_the_given_one(held):
    assert (
        counts("gold", "r_grasper", 0.5, enabled=False, otherwise=Vec.full(7, held)) == [held] * 7
    )
