"""The observer against its rules written out in NumPy over whole series."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor
from ravenjax.vocabulary.failures import CODES

TICKS = 400
SETUP = RavenSetup(precision=REFERENCE)
THREE = ("tip", "golden", "model", "pos", "golden_pos")


def course(kind: str) -> dict[str, np.ndarray]:
    """A made-up run of one arm: what the observer sees, [ticks, 3] in m (pos in um) or [ticks]."""
    rng = np.random.default_rng(len(kind))
    time = np.arange(TICKS)[:, None]
    golden = np.hstack([0.02 * np.sin(time / 60.0), 2e-5 * time, 0.0 * time])
    tip, live = golden.copy(), np.ones(TICKS, bool)
    model, report = golden + rng.normal(0, 1e-4, (TICKS, 3)), np.zeros((TICKS, 3))
    if kind == "stops":
        tip[150:] = tip[149]
        live[150:] = False
    elif kind == "stands":
        tip[150:300] = tip[149]
        tip[300:] = tip[149] + golden[300:] - golden[299]
    elif kind == "leaps":
        tip[200:203] += np.array([[2e-4, 0, 0], [4e-4, 0, 0], [6e-4, 0, 0]])
        tip[203:] += [6e-4, 0, 0]
    elif kind == "runs away":
        tip[150:] += 4e-5 * (time[150:] - 149)
    elif kind == "misreports":
        report[200:] += [0.004, 0, 0]
    elif kind == "off its model":
        model += [0.01, 0, 0]
    elif kind == "coasts":
        live[150:] = False
        tip[150:] = tip[149] + np.minimum(5e-5 * (time[150:] - 149), 0.005)
    return {
        "tip": tip,
        "golden": golden,
        "model": model,
        "pos": np.trunc((tip + report) * 1e6),
        "golden_pos": np.trunc(golden * 1e6),
        "depth": 1e-3 * np.sin(time[:, 0] / 40.0),
        "dac": rng.integers(-3000, 3000, (TICKS, 7)),
        "live": live,
        "pedal": np.ones(TICKS, bool),
    }


@jax.jit
def observed(params, inputs):
    """The observer's state after all ticks of `inputs`, arrays by name."""

    def one(state, x):
        vec = {name: (Vec(x[name][i] for i in range(3)),) for name in THREE}
        signal = monitor.MonitorSignal(
            tip=vec["tip"],
            pos=vec["pos"],
            model_tip=vec["model"],
            depth=(x["depth"],),
            distance=jnp.inf,
            dac=(Vec(x["dac"][i] for i in range(7)),),
            fresh=jnp.bool_(True),
            live=x["live"],
            pedal=x["pedal"],
            tick=x["tick"],
        )
        return (
            monitor.step(
                SETUP, params, state, signal, monitor.Reference(vec["golden"], vec["golden_pos"])
            ),
            None,
        )

    at_rest = tuple(Vec(inputs[name][0][i] for i in range(3)) for name in ("tip", "pos"))
    return jax.lax.scan(one, monitor.init(SETUP, (at_rest[0],), (at_rest[1],)), inputs)[0]


def watched(series, **limits):
    """Outcomes of the run."""
    with jax.enable_x64(True):
        params = replace(monitor.MonitorParams(), **limits)
        inputs = {name: jnp.asarray(values) for name, values in series.items()}
        inputs |= {
            "dac": inputs["dac"].astype(jnp.int32),
            "tick": jnp.arange(TICKS, dtype=jnp.int32),
        }
        outcomes = monitor.outcomes(SETUP, observed(params, inputs))
        return {name: float(value) for name, value in outcomes.items()}


def first(happens: np.ndarray) -> int:
    return int(np.flatnonzero(happens)[0]) if happens.any() else -1


def by_the_rules(s):
    def steps(values):
        return np.linalg.norm(np.diff(values, axis=0, prepend=values[:1]), axis=1)

    model = np.linalg.norm(s["tip"] - s["model"], axis=1)
    golden = np.linalg.norm(s["tip"] - s["golden"], axis=1)
    step, golden_step = steps(s["tip"]), steps(s["golden"])
    two = np.linalg.norm(s["tip"] - np.vstack([s["tip"][:1], s["tip"][:1], s["tip"][:-2]]), axis=1)
    code = (steps(s["pos"]) > 100.0) & ~(steps(s["golden_pos"]) > 100.0)
    true = (step > 1e-4) & ~(golden_step > 1e-4)
    twice = lambda over: over & np.concatenate([[False], over[:-1]])  # noqa: E731
    idle = (golden_step > 1e-6) & (step < 0.25 * golden_step)
    asked = np.diff(s["golden"], axis=0, prepend=s["golden"][:1])
    missed = np.cumsum(np.where((idle | ~s["live"])[:, None], asked, 0.0), axis=0)
    standing = np.linalg.norm(s["tip"] - s["golden"] + missed, axis=1)
    off, live = np.minimum(golden, model), s["live"]
    unintended = np.minimum(off, standing)
    loss = np.where((2 * standing < off) | ((off > 3e-3) & (unintended <= 3e-3)), off, 0.0)
    report = np.linalg.norm(1e-6 * (s["pos"] - s["golden_pos"]) - (s["tip"] - s["golden"]), axis=1)
    return {
        "peak_model_deviation_mm": model.max() * 1e3,
        "peak_live_deviation_mm": model[s["live"]].max() * 1e3,
        "rms_model_deviation_mm": np.sqrt(np.mean(model**2)) * 1e3,
        "peak_golden_deviation_mm": golden.max() * 1e3,
        "rms_golden_deviation_mm": np.sqrt(np.mean(golden**2)) * 1e3,
        "unintended_mm": (live * unintended).max() * 1e3,
        "unintended_off_mm": (~live * np.minimum(golden, standing)).max() * 1e3,
        "unintended_first_ms": first(live & (unintended > 3e-3)),
        "loss_mm": (live * loss).max() * 1e3,
        "loss_first_ms": first(live & (loss > 3e-3)),
        "false_report_mm": (live * report).max() * 1e3,
        "false_report_first_ms": first(live & (report > 3e-3)),
        "halted_ms": (s["pedal"] & ~live).sum(),
        "idle_ms": idle.sum(),
        "largest_step_mm": step.max() * 1e3,
        "tip_path_mm": step.sum() * 1e3,
        "tissue_depth_mm": s["depth"].max() * 1e3,
        "jump_code_ms": first(twice(code)),
        "jump_text_ms": first((step > 1e-3) | (two > 1e-3)),
        "jump_tip_ms": first(twice(true)),
        "diverged_ms": first(golden > 1e-6),
        "failed_ms": -1,
        "failed_signal": -1,
        "tip_distance_mm": np.inf,
        "peak_dac_gold_shoulder": np.abs(s["dac"][:, 0]).max(),
    }


@pytest.mark.parametrize(
    "kind",
    ["well", "stops", "stands", "leaps", "runs away", "coasts", "misreports", "off its model"],
)
def test_outcomes_follow_the_rules(kind):
    series = course(kind)
    found = watched(series)
    for name, expected in by_the_rules(series).items():
        assert found[name] == pytest.approx(expected, rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("name", "signal"), [("tip", "tip"), ("model", "model tip"), ("golden", "deviation")]
)
def test_what_left_the_finite_first_is_told(name, signal, wrong):
    series = course("well")
    series[name][77, 1] = wrong
    series["tip"][90] = np.nan  # comes later, and tells nothing new
    found = watched(series)
    assert (found["failed_ms"], found["failed_signal"]) == (77, CODES[signal])
