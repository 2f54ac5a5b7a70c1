"""Harms of a campaign's own against their definition, written out over whole series."""

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.numbers import harm
from ravenjax.numbers.setup import REFERENCE
from ravenjax.robots.raven2.setup import RavenSetup

X, Y = np.random.default_rng(1).normal(0, 1, (2, 200))
NOW = range(200)
PARTS = {
    "x > 1 and not y < 0.5": [min(X[t] - 1, Y[t] - 0.5) for t in NOW],
    "x > 1 and once[3:9](y > 2)": [
        min(X[t] - 1, max(Y[max(t - 9, 0) : max(t - 2, 0)] - 2, default=-np.inf)) for t in NOW
    ],
    "always[0:4](x > -1) or historically(y < 2)": [
        max(min(X[t : t + 5] + 1), min(2 - Y[: t + 1])) for t in range(196)
    ],
    "not implies(x > 1, eventually[2:5](y > 0))": [
        min(X[t] - 1, -max(Y[t + 2 : t + 6])) for t in range(195)
    ],
}


def test_a_harm_has_the_robustness_of_its_expression():
    ahead = [0, 0, 4, 5]
    uses = tuple(harm.HarmUse("h", text, "watch") for text in PARTS)
    setup = RavenSetup(precision=REFERENCE, harms=uses)
    with jax.enable_x64(True):
        zeros = dict.fromkeys(harm.SIGNALS, 0.0)

        def step(state, now):
            signals = zeros | {"x": now[0], "y": now[1]}
            state = harm.step(setup, state, [signals], now[2].astype(jnp.int32))
            return state, [(one.peak, one.first) for one in state]

        series = jax.lax.scan(step, harm.init(setup), np.column_stack([X, Y, NOW]))[1]
    for (peak, first), late, expected in zip(series, ahead, PARTS.values(), strict=True):
        expected = np.array(expected)
        assert np.allclose(peak[late:], np.maximum.accumulate(expected))
        assert first[-1] == np.argmax(expected > 0) + late
