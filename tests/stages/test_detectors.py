"""Detectors against their rules written out in NumPy over whole series."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import detectors
from ravenjax.vocabulary.detectors import DetectorUse

TICKS = 60
FUSIONS = ("all", "two", "any", "mpos", "mvel", "jpos")
USES = (
    *(DetectorUse("steps", fusion, count, 2) for fusion in FUSIONS for count in (1, 3)),
    DetectorUse("derivative_sum", thresholds=1),
    DetectorUse("tip_error", consecutive=2, thresholds=1),
    DetectorUse("overdrive", thresholds=1),
)
SETUP = RavenSetup(precision=REFERENCE, detectors=USES)
LIMIT = np.array([2500, 2500, 2000, 3000, 3000, 3800, 3800])


@pytest.fixture(scope="module")
def series():
    rng = np.random.default_rng(5)
    return {
        "mpos": np.cumsum(rng.normal(0, 0.08, (TICKS, 7)), axis=0),
        "mvel": np.cumsum(rng.normal(0, 0.9, (TICKS, 7)), axis=0),
        "jpos": np.cumsum(rng.normal(0, 0.0008, (TICKS, 7)), axis=0),
        "jvel": np.cumsum(rng.normal(0, 0.01, (TICKS, 7)), axis=0),
        "tip_error": rng.gamma(2.0, 1e-3, TICKS),
        "command": rng.integers(-5000, 5000, (TICKS, 7)),
        "armed": np.arange(TICKS) < 50,
    }


@pytest.fixture(scope="module")
def found(series):
    """Outcomes after all ticks, armed from tick 10 on."""
    thresholds = tuple((0.8, 1.6)[: use.thresholds] for use in USES)
    with jax.enable_x64(True):
        params = detectors.params(SETUP)
        params = detectors.DetectorParams(
            10, (), thresholds, params.shoulder, params.elbow, params.insertion
        )

        def one(state, x):
            signal = detectors.DetectorSignal(
                **{
                    name: (Vec(x[name][i] for i in range(7)),)
                    for name in ("mpos", "mvel", "jpos", "jvel", "command")
                },
                tip_error=(x["tip_error"],),
                command_limit=Vec(jnp.int32(limit) for limit in LIMIT),
                armed=x["armed"],
                tick=x["tick"],
                views=None,
            )
            return detectors.step(SETUP, params, state, signal), None

        inputs = {name: jnp.asarray(values) for name, values in series.items()}
        inputs |= {
            "tick": jnp.arange(TICKS, dtype=jnp.int32),
            "command": inputs["command"].astype(jnp.int32),
        }
        state, _ = jax.lax.scan(one, detectors.init(SETUP, detectors.params(SETUP)), inputs)
        return {name: np.asarray(value) for name, value in detectors.outcomes(SETUP, state).items()}


def naive_scores(series):
    """Score of each tick by kind, before arming."""
    joints = ("shoulder", "elbow", "insertion")
    learned = np.array([detectors.LEARNED_STEPS[joint] for joint in joints])
    steps = {}
    for place, name in enumerate(("mpos", "mvel", "jpos")):
        before = np.vstack([np.zeros((1, 3)), series[name][:-1, :3]])
        steps[name] = (np.abs(series[name][:, :3] - before) / learned[:, place]).max(axis=1)
    steps["mvel"] = np.minimum(steps["mvel"], np.concatenate([[0.0], steps["mvel"][:-1]]))
    ordered = np.sort(np.stack([steps["mpos"], steps["mvel"], steps["jpos"]]), axis=0)
    fused = {"all": ordered[0], "two": ordered[1], "any": ordered[2]} | steps
    sums = np.zeros(TICKS)
    for name, weight in (("jvel", 1.0), ("mvel", 0.001)):
        before = np.vstack([np.zeros((1, 3)), series[name][:-1, :3]])
        rates = np.abs(series[name][:, :3]) + np.abs(series[name][:, :3] - before) / 1e-3
        sums += weight * rates.sum(axis=1)
    share = (np.abs(series["command"]) / LIMIT)[:, :6].max(axis=1)
    return fused, {
        "derivative_sum": sums,
        "tip_error": series["tip_error"] * 1e3,
        "overdrive": share,
    }


@pytest.mark.parametrize("d", range(len(USES)))
def test_score_first_alarm_and_alarms_follow_the_rule(series, found, d):
    use = USES[d]
    fused, plain = naive_scores(series)
    score = fused[use.fusion] if use.kind == "steps" else plain[use.kind]
    score = np.where(series["armed"] & (np.arange(TICKS) >= 10), score, 0.0)
    padded = np.concatenate([np.zeros(use.consecutive - 1), score])
    held = np.min([padded[i : i + TICKS] for i in range(use.consecutive)], axis=0)
    np.testing.assert_allclose(found[f"detector{d}_score"], held.max(), rtol=1e-12)
    for k, threshold in enumerate((0.8, 1.6)[: use.thresholds]):
        over = held > threshold
        rises = over & ~np.concatenate([[False], over[:-1]])
        assert found[f"detector{d}_threshold{k}_alarms"] == rises.sum()
        assert found[f"detector{d}_threshold{k}_first_ms"] == (
            np.flatnonzero(over)[0] if over.any() else -1
        )
