import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.numbers import algebra
from ravenjax.numbers.vec import Vec

NUMBER = st.sampled_from([0, 1, -1, 0.0, 1.0, -1.0, 0.5, -3.25, np.float64(0.0), np.float64(-2.5)])
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER).map(Vec)
MATRIX = st.tuples(VECTOR, VECTOR, VECTOR).map(Vec)


def numpy(tree) -> np.ndarray:
    return np.asarray(tree, dtype=np.float64)


@given(MATRIX, MATRIX, VECTOR, VECTOR)
def test_equals_numpy(a, b, v, w):
    np.testing.assert_array_equal(numpy(algebra.matmul(a, b)), numpy(a) @ numpy(b))
    np.testing.assert_array_equal(numpy(algebra.matvec(a, v)), numpy(a) @ numpy(v))
    np.testing.assert_array_equal(numpy(algebra.transpose(a)), numpy(a).T)
    np.testing.assert_array_equal(numpy(algebra.cross(v, w)), np.cross(numpy(v), numpy(w)))
    np.testing.assert_array_equal(numpy(algebra.dot(v, w)), numpy(v) @ numpy(w))
    np.testing.assert_array_equal(numpy(algebra.plus(v, w)), numpy(v) + numpy(w))
    np.testing.assert_array_equal(numpy(algebra.minus(v, w)), numpy(v) - numpy(w))
    np.testing.assert_array_equal(numpy(algebra.scale(v[0], w)), numpy(v)[0] * numpy(w))
    np.testing.assert_allclose(float(algebra.norm(v)), np.linalg.norm(numpy(v)), rtol=1e-6)


def test_numbers_of_numpy_are_data_and_keep_nan():
    assert np.isnan(algebra.mul(np.float64(0.0), np.float64("nan")))
