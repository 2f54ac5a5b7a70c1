"""Gravity compensation in the original's order against a second writing of it, and against the
shared-work one.
"""

from __future__ import annotations

import random

import jax
import numpy as np
import oracle_control_software as oracle
import pytest
from numpy import float32

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import gravity
from ravenjax.robots.raven2.original import literal


@pytest.mark.parametrize("arm", ARMS)
def test_is_the_originals_to_the_last_bit_and_near_the_other_writing(arm):
    rng, mech = random.Random(1), oracle.Mechanism(ARMS.index(arm), "r_grasper", False)
    differs = 0
    for _ in range(50):
        jpos = [
            float32(rng.uniform(*span))
            for span in ((0, 1.6), (0.7, 2.4), (0.2, 0.6), *((-2, 2),) * 4)
        ]
        for k, joint in zip(oracle.USED, jpos, strict=True):
            mech.joint[k].jpos = joint
        oracle.Loop.gravity(None, mech)
        with jax.enable_x64(True):
            wide = Vec(map(np.float64, jpos))
            exact = [float(t) for t in literal.gravity_torque(arm, wide)]
            shared = [
                float(t) for t in gravity.gravity_torque(arm, wide, gravity.GRAVITY_AS_STORED)
            ]
        expected = [float(mech.joint[k].tau_g) for k in range(3)]
        assert [float(float32(t)) for t in exact] == expected
        assert exact == pytest.approx(shared, rel=1e-7, abs=1e-12)  # float32 transmission ratios
        differs += [float(float32(t)) for t in shared] != expected
    assert differs > 10
