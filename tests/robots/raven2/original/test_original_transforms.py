"""Transforms and quaternions in ROS tf's order against a second writing of them."""

from __future__ import annotations

import random

import jax
import numpy as np
import oracle_kinematics as oracle
import pytest
from scipy.spatial.transform import Rotation

from ravenjax.numbers.algebra import matrix
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import mapping
from ravenjax.robots.raven2.original import literal as tf


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def rotation(rng):
    return Rotation.from_quat([rng.gauss(0, 1) for _ in range(4)]).as_matrix()


def rows(m):
    return matrix(*(tuple(map(np.float64, row)) for row in m))


def transform(m, p):
    return tf.Transform(rows(m), Vec(map(np.float64, p)))


def lists(t):
    return [[float(x) for x in row] for row in t.rotation], [float(x) for x in t.origin]


def test_products_and_inverses_are_tfs_to_the_last_bit():
    rng = random.Random(1)
    for _ in range(50):
        a, b = ((rotation(rng).tolist(), [rng.gauss(0, 1) for _ in range(3)]) for _ in range(2))
        assert lists(tf.product(transform(*a), transform(*b))) == tuple_of(oracle.multiply(a, b))
        assert lists(tf.inverse_transform(transform(*a))) == tuple_of(oracle.invert(a))
        inverted = tf.inverse_matrix(rows(a[0]))
        assert [[float(x) for x in row] for row in inverted] == oracle.invert_matrix(a[0])
        np.testing.assert_allclose(np.array(inverted, float), np.linalg.inv(a[0]), atol=1e-14)


def tuple_of(t):
    return list(t[0]), list(t[1])


def test_quaternions_are_tfs_to_the_last_bit_in_all_four_cases():
    rng, pivots = random.Random(2), set()
    for _ in range(200):
        m = rotation(rng).astype(np.float32).astype(float).tolist()
        quat = [float(x) for x in tf.quat_from_matrix(rows(m))]
        assert quat == oracle.quaternion_of(m)
        assert quat == pytest.approx(
            [float(x) for x in mapping.quat_from_matrix(rows(m))], abs=1e-7
        )
        trace = m[0][0] + m[1][1] + m[2][2]
        pivots.add(3 if trace > 0 else int(np.argmax(np.diag(m))))
    assert pivots == {0, 1, 2, 3}
