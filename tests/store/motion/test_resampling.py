"""Resampling by time: a smooth curve sampled anyhow comes back within the stated bound, and
nothing is invented.
"""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ravenjax.store.motion import resampling

steps_ms = st.lists(st.floats(0.2, 60.0), min_size=4, max_size=120)
"""Between samples."""

waves = st.lists(
    st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 4.0), st.floats(0.0, 6.3)),
    min_size=1,
    max_size=3,
)
"""mm, Hz and phase of the parts of a curve."""


def curve(parts, time_s):
    """mm, and the most that its second derivative can be, mm/s2."""
    value = sum(size * np.sin(2 * np.pi * hz * time_s + phase) for size, hz, phase in parts)
    return value, sum(size * (2 * np.pi * hz) ** 2 for size, hz, _ in parts)


@settings(max_examples=100)
@given(steps_ms, waves)
def test_a_smooth_curve_comes_back_within_the_bound(steps, parts):
    time_s = np.cumsum([0.0, *steps]) * 1e-3
    values, bend = curve(parts, time_s)
    at = np.arange(0.0, time_s[-1], 1e-3)
    wanted, _ = curve(parts, at)
    longest = max(steps) * 1e-3
    assert (
        np.abs(resampling.by_time(time_s, values, at) - wanted).max()
        <= bend * longest**2 / 2.0 + 1e-9
    )


@given(st.lists(st.floats(0.2, 60.0), min_size=4, max_size=60), st.integers(0, 2**31))
def test_turns_are_unit_quaternions_whatever_their_sign(steps, seed):
    time_s = np.cumsum([0.0, *steps]) * 1e-3
    quat = Rotation.from_rotvec(np.outer(time_s, [0.3, -0.2, 1.0])).as_quat()
    at = np.arange(0.0, time_s[-1], 1e-3)
    flipped = quat * np.random.default_rng(seed).choice([-1.0, 1.0], len(quat))[:, None]
    found = resampling.turns_by_time(time_s, flipped, at)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    wanted = Rotation.from_rotvec(np.outer(at, [0.3, -0.2, 1.0]))
    assert (Rotation.from_quat(found) * wanted.inv()).magnitude().max() < 1e-3
