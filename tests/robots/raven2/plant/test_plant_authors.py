"""The authors' model against its published check values and its published run."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from authors_values import CHECKS, M23, M33

from ravenjax.numbers.vec import Vec
from validation import authors

SPEED_CLAMP = 790.0  # rad/s, of the motor speed that the Runge-Kutta form integrates


def vec(*items: float) -> Vec:
    return Vec(jnp.float64(x) for x in items)


def flat(record) -> np.ndarray:
    return np.array(jax.tree.leaves(record), np.float64)


def rk4(
    start: authors.AuthorsState, dac: Vec, dt: float = 1e-3, tension_bug: bool = False
) -> authors.AuthorsState:
    """One classical Runge-Kutta step; the motor speed that moves the motor angle is clamped, as
    in the source.
    """

    def slope(at):
        derivative, _ = authors.rates(at, dac, tension_bug)
        clamped = derivative.m.map(lambda speed: jnp.clip(speed, -SPEED_CLAMP, SPEED_CLAMP))
        return authors.AuthorsState(q=derivative.q, qd=derivative.qd, m=clamped, md=derivative.md)

    def along(slope, step):
        return jax.tree.map(lambda x, rate: x + rate * step, start, slope)

    k1 = slope(start)
    k2 = slope(along(k1, dt / 2))
    k3 = slope(along(k2, dt / 2))
    k4 = slope(along(k3, dt))
    return along(
        jax.tree.map(lambda a, b, c, d: (a + 2.0 * b + 2.0 * c + d) / 6.0, k1, k2, k3, k4), dt
    )


@pytest.mark.parametrize("case", CHECKS)
def test_mass_matrix_gravity_and_bias(case) -> None:
    position, rate, (m11, m12, m13, m22), gravity, bias = case
    with jax.enable_x64(True):
        q, qd = vec(*position), vec(*rate)
        mass = np.array(authors.mass_matrix(q), np.float64)
        expected = [[m11, m12, m13], [m12, m22, M23], [m13, M23, M33]]
        np.testing.assert_allclose(mass, expected, atol=1e-13)
        np.testing.assert_allclose(flat(authors.gravity_forces(q)), gravity, atol=1e-12)
        np.testing.assert_allclose(flat(authors.bias_forces(q, qd)), bias, atol=1e-9)


def run_of_the_authors(recording: pd.DataFrame, rows: int, step=rk4) -> np.ndarray:
    """Their file player: negated DAC, bug kept, started at rest from the recording's second row."""
    recording = recording.iloc[1:]
    joints = ("shoulder", "elbow", "insertion")
    start = np.radians([recording[f"mpos_{joint}_deg"].iloc[0] for joint in joints])
    dac = -recording[[f"dac_{joint}" for joint in joints]].to_numpy(np.float64)[:rows]

    def tick(state: authors.AuthorsState, counts):
        state = step(state, Vec(counts[i] for i in range(3)), tension_bug=True)
        return state, jnp.stack([x for pair in zip(state.m, state.md, strict=True) for x in pair])

    first = authors.initial(vec(*start), vec(0.0, 0.0, 0.0))
    return np.asarray(jax.jit(lambda s, u: jax.lax.scan(tick, s, u))(first, jnp.asarray(dac))[1])


@pytest.mark.slow
def test_the_published_run_is_reproduced_over_all_its_rows(shared_data) -> None:
    recording = pd.read_parquet(shared_data("recording_gold_joints123.parquet"))
    published = pd.read_parquet(shared_data("model_regression_rk4.parquet")).to_numpy(np.float64)
    with jax.enable_x64(True):
        ours = run_of_the_authors(recording, len(published))
    np.testing.assert_allclose(ours, published, atol=1e-5, rtol=0)
    with jax.enable_x64(True):
        euler = run_of_the_authors(recording, 101, authors.euler)
    expected = (71.2284068, 0.0429502821, 200.760881, 0.0919059818, 899.879223, -0.192890965)
    # Chatter amplifies the inputs' printed digits.
    np.testing.assert_allclose(euler[100], expected, atol=2e-8)
