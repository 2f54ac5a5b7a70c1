"""A hand that the cue's force moves, in campaigns: which way, who follows, and that nothing
changes without it.
"""

import copy

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES

DRIFT = fault("packet", "delx", "offset", 40, 300, duration_ms=200)
STEP = {**DRIFT, "value": 8000, "duration_ms": "end"}  # of a console of positions
STRONG = 66.0
TICKS = 900


def tables(hand: dict | None = None, **more) -> dict:
    """A drift that parts robot and model by 8 mm, after which they stay apart; a robot with
    little dry friction.
    """
    raw = {
        "campaign": {"name": "x", "duration_s": TICKS / 1e3, "parameter_set": "traj3"},
        "operator": {"motion": "still"},
        "group": [{"name": "free"}, {"name": "drift", "fault": [copy.deepcopy(DRIFT)]}],
    }
    for name, table in more.items():
        raw[name] = {**raw.get(name, {}), **table}
    return raw if hand is None else raw | {"hand": hand}


def signals_of(raw: dict, engine=None):
    """Signals of the run with the drift, arrays [ticks], and its plan."""
    ready = plan.make_plan(rj.load_campaign(raw))
    varied, harmless = ready.lanes([1], 1, harmless=True)
    _, faults = ready.lanes([1], 1)
    blocks = Block(varied, harmless, None), Block(varied, faults, None)
    return (engine or SimdEngine()).tracer(ready.program, 1).run(*blocks, ready.columns)[2], ready


def stack(vector) -> np.ndarray:
    return np.stack([np.asarray(x, float) for x in vector], axis=-1)


def yielded(signals) -> np.ndarray:
    """Where a hand at half a grip is at the end, frame 0, m: the equation of motion under the
    cue that was recorded.
    """
    stiffness, damping, mass = 3.0 * 135.0, np.sqrt(3.0) * 6.45, 0.554
    place, speed = np.zeros((2, 3))
    for pull in (
        stack(signals.haptics[0].direction) * np.asarray(signals.haptics[0].force[0])[:, None]
    ):
        speed = speed + 1e-3 * (pull * STRONG - damping * speed - stiffness * place) / mass
        place = place + 1e-3 * speed
    return place


def asked(signals, arm: str, console: str) -> np.ndarray:
    """Where the console's packets have the tip at the end, frame 0, m; increments from where it
    began.
    """
    delta = stack(signals.packet.delta[0]) * 1e-6
    if console == "absolute":
        return delta[-1]
    return np.array([[float(x) for x in row] for row in ITP_AXES[arm]]) @ delta.sum(axis=0)


def model_tip(signals) -> np.ndarray:
    return stack(signals.nominal[0].tip_position)


def true_tip(signals) -> np.ndarray:
    return stack(signals.tip[0])


@pytest.fixture(scope="module")
def table():
    """Without a hand, with one that no force reaches, and with one that the strongest device
    moves.
    """
    return {
        "none": rj.run(tables(), engine="simd"),
        "unmoved": rj.run(tables({"newtons_per_unit": 0.0}), engine="simd"),
        "moved": rj.run(tables({"newtons_per_unit": STRONG, "grip": 0.0}), engine="simd"),
    }


@pytest.mark.slow
def test_a_hand_that_no_force_reaches_leaves_every_outcome_as_it_was(table):
    unmoved = table["unmoved"].drop(columns=["hand_mm", "golden_hand_mm"])
    assert (table["unmoved"]["hand_mm"] == 0.0).all()
    for name in table["none"].columns.drop("run_id"):
        assert table["none"][name].equals(unmoved[name]), name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "console"), [("gold", "increments"), ("green", "increments"), ("gold", "absolute")]
)
def test_robot_and_model_follow_the_hand_along_the_cue(arm, console):
    """Both move by scale times the hand's displacement, towards where the model was; what parts
    them stays.
    """
    own = {"arms": [arm], "console": console, "duration_s": TICKS / 1e3, "name": "x"}
    fault = (
        {"group": [{"name": "free"}, {"name": "step", "fault": [STEP]}]}
        if console == "absolute"
        else {}
    )
    off, _ = signals_of(tables(campaign=own) | fault)
    on, ready = signals_of(tables({"newtons_per_unit": STRONG, "grip": 0.5}, campaign=own) | fault)
    expected = float(ready.program.params.operator.scale) * yielded(on)
    assert np.linalg.norm(expected) > 0.3e-3
    np.testing.assert_allclose(
        asked(on, arm, console) - asked(off, arm, console), expected, atol=3e-6
    )
    model, robot = ((part(on) - part(off))[-1] for part in (model_tip, true_tip))
    for moved in (model, robot):  # as far as friction lets them
        assert moved @ expected / np.linalg.norm(moved) / np.linalg.norm(expected) > 0.9
        assert 0.6 < np.linalg.norm(moved) / np.linalg.norm(expected) < 1.4
    parted = [float(one.haptics[0].distance[-1]) for one in (on, off)]
    assert abs(parted[0] - parted[1]) < 0.3 * np.linalg.norm(expected) and parted[1] > 3e-3


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    raw = tables({"newtons_per_unit": STRONG}, campaign={"name": "x", "duration_s": 0.3})
    raw["group"][1]["fault"] = [{**DRIFT, "start_ms": 210, "duration_ms": 80, "value": 400}]
    check_engines(plan.make_plan(loading.from_dict(raw)), 2)


def test_grip_and_force_may_be_varied():
    raw = tables({}) | {"cross": {"hand.grip": [0, 1], "hand.newtons_per_unit": [0, STRONG]}}
    raw["parameters"] = {"hand.turn_deg": 30.0}
    hand_mm = rj.run(raw, engine="simd").query("group == 'drift'")["hand_mm"].to_numpy()
    assert hand_mm[[0, 2]].tolist() == [0.0, 0.0] and hand_mm[1] > 3.0 * hand_mm[3] > 0.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"hand": {"grip": 1.5}}, "hand.grip"),
        ({"hand": {"gripp": 1.0}}, "Did you mean 'grip'"),
        ({"parameters": {"hand.grip": 0.5}}, "this campaign has no 'hand'"),
        ({"hand": {}, "parameters": {"hand.mass": 0.0}}, "expected 0.01..10 kg"),
    ],
)
def test_what_is_wrong_with_a_hand_is_refused(changes, words):
    with pytest.raises(UserError) as error:
        plan.make_plan(loading.from_dict(tables() | changes))
    assert words in str(error.value)
