"""What the tick computes at once, without JAX, is what JAX computes; records are known to JAX
whenever it comes.
"""

import hashlib
import subprocess
import sys
import threading

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jnp, lax, run_eagerly
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.setup import RavenSetup

JOINTS = st.lists(
    st.floats(-4.0, 4.0).filter(lambda x: x == 0.0 or abs(x) > 1e-30), min_size=7, max_size=7
)
"""rad; XLA takes numbers below the normal ones for 0, and so products of tiny angles."""


@given(JOINTS, st.sampled_from(ARMS))
def test_a_pose_of_float64_is_that_of_xla(joints, arm):
    def pose(number):
        pose = kinematics.forward_pose(arm, Vec(map(number, joints)))
        return [*tree.tree_leaves(pose), *quat_from_matrix(pose.rotation)]

    with run_eagerly():
        ours = pose(np.float64)
    with jax.enable_x64(True):
        theirs = pose(jnp.float64)
    assert all(type(x) is np.float64 for x in ours)
    # XLA takes sine and cosine from the C library, which rounds otherwise
    np.testing.assert_allclose(ours, np.array(theirs), rtol=1e-14, atol=1e-15)


NORMAL = st.floats(-100.0, 100.0, width=32, allow_subnormal=False)  # XLA flushes subnormals


@given(NORMAL, NORMAL)
def test_single_numbers_keep_the_types_and_bits_of_jax(x, y):
    functions = (
        lambda a, b: jnp.where(a > b, a, 1.0),
        lambda a, b: jnp.where(a > b, a, b),
        lambda a, b: jnp.sqrt(abs(a)) + b,
        lambda a, b: jnp.minimum(a, b),
        lambda a, b: lax.convert_element_type(a * 1000.0, "int32"),
        lambda a, b: lax.convert_element_type(b, "float32") * 2.0,
    )
    for function in functions:
        with run_eagerly():
            ours = function(np.float32(x), np.float32(y))
        theirs = function(jnp.float32(x), jnp.float32(y))
        assert np.asarray(ours).dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


def test_sine_cosine_and_the_start_pose_have_the_same_bits_on_every_host():
    angles = np.arange(-700, 701) / 100.0
    with run_eagerly():
        waves = [jnp.sin(angles), jnp.cos(angles)]
        assert [float(jnp.cos(x)) for x in angles.tolist()] == waves[1].tolist()
    np.testing.assert_array_max_ulp(waves[0], np.sin(angles), 1)
    np.testing.assert_array_max_ulp(waves[1], np.cos(angles), 1)
    setup = RavenSetup(arms=ARMS, tools=("r_grasper",) * 2)
    params = operator.params(setup, (tuple(HOME_JPOS),) * 2)
    start = tree.tree_leaves((params.start_position, params.start_quat))
    bits = np.concatenate([*waves, start]).tobytes()
    assert hashlib.sha256(bits).hexdigest()[:16] == "a67185622b603087"


def test_only_the_thread_that_asked_computes_at_once():
    seen = []
    with run_eagerly():
        thread = threading.Thread(target=lambda: seen.append(jnp.cos))
        thread.start()
        thread.join()
        assert jnp.cos is not seen[0]
    assert jnp.cos is seen[0] is jax.numpy.cos


@pytest.mark.parametrize("first", ["jax", "ravenjax"])
def test_records_are_known_to_jax_whichever_is_imported_first(first):
    before, after = (
        ("import jax", "") if first == "jax" else ("", "assert 'jax' not in sys.modules")
    )
    code = (
        f"import sys\n{before}\nfrom ravenjax.robots.raven2.loop import tick\n{after}\n"
        "from ravenjax.numbers.lazy import jax\nfrom ravenjax.numbers.vec import Vec\n"
        "from ravenjax.robots.raven2.geometry.joints import Pose\n"
        "assert jax.tree.leaves(Pose(Vec((1, 2, 3)), Vec(()))) == [1, 2, 3]\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
