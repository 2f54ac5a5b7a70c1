import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ravenjax.numbers.lazy import run_eagerly
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import mapping

COMPONENT = st.floats(-1, 1)
QUATERNION = st.tuples(COMPONENT, COMPONENT, COMPONENT, COMPONENT).filter(
    lambda q: np.linalg.norm(q) > 0.05
)


def run(function, *arguments):
    """In float64; leading strings pick code, the rest are Vecs or rows of Vecs."""
    with run_eagerly():
        return function(*(a if isinstance(a, str) else vec(a) for a in arguments))


def vec(values) -> Vec:
    return Vec(vec(v) if np.ndim(v) else np.float64(v) for v in values)


def same_rotation(a, b):
    np.testing.assert_allclose(
        Rotation.from_quat(a).as_matrix(), Rotation.from_quat(b).as_matrix(), atol=1e-12
    )


def test_axes_of_a_packet():
    assert mapping.position_from_itp("gold", Vec((1, 2, 3))) == (-3, -1, 2)
    assert mapping.position_from_itp("green", Vec((1, 2, 3))) == (-3, 1, -2)
    for arm in ARMS:
        assert np.linalg.det(np.array(mapping.ITP_AXES[arm])) == 1.0


@pytest.mark.parametrize("arm", ARMS)
@given(quat=QUATERNION)
def test_an_increments_rotation_by_matrix_and_by_quaternion(arm, quat):
    c = np.array(mapping.ITP_AXES[arm])
    expected = c @ Rotation.from_quat(quat).as_matrix() @ c.T
    by_matrix = run(mapping.rotation_from_itp, arm, run(mapping.matrix_from_quat, quat))
    np.testing.assert_allclose(by_matrix, expected, atol=1e-12)
    by_quat = run(mapping.quat_from_itp, arm, quat)
    np.testing.assert_allclose(Rotation.from_quat(by_quat).as_matrix(), expected, atol=1e-12)
    assert np.linalg.norm(by_quat) == pytest.approx(1)


@given(a=QUATERNION, b=QUATERNION)
def test_product_turns_b_then_a(a, b):
    same_rotation(
        run(mapping.quat_mul, a, b), (Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat()
    )


@given(quat=QUATERNION)
def test_matrix_of_a_quaternion_of_any_length(quat):
    np.testing.assert_allclose(
        run(mapping.matrix_from_quat, quat), Rotation.from_quat(quat).as_matrix(), atol=1e-12
    )


@settings(max_examples=200)
@given(quat=QUATERNION)
def test_quaternion_of_a_matrix(quat):
    matrix = Rotation.from_quat(quat).as_matrix()
    assume(abs(np.trace(matrix)) > 1e-9)
    found = run(mapping.quat_from_matrix, matrix)
    same_rotation(found, quat)
    assert np.linalg.norm(found) == pytest.approx(1)
    pivot = 3 if np.trace(matrix) > 0 else int(np.argmax(np.diag(matrix)))
    assert found[pivot] > 0
