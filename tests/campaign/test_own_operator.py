"""Operators that are files of one's own: bits of the plan and of the built-in reaction, motion,
identity, errors.
"""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from branching_cases import require_same
from branching_cases import tables as computed
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.campaign.golden_runs import FastForwardPlan
from ravenjax.campaign.inspection import verification
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.errors import UserError

HEAD = "from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record, where\n"
AS_COMPUTED = """
@record
class Nothing:
    more: Annotated[Scalar, Quantity("um", 0, 1, "nothing")]

def params():
    return Nothing(0.0)

def step(params, state, view):
    return state, {
        "delta": tuple(arm.delta + params.more for arm in view.arms),
        "grasp": tuple(arm.grasp - params.more for arm in view.arms),
        "pedal": view.pedal & (params.more == 0.0),
        "pace": 1.0 - params.more,
    }
"""
REACTING = """
@record
class Reaction:
    action: Annotated[Scalar, Quantity("", 1, 3, "1 lifts the pedal, 2 slows down, 3 corrects by eye", whole=True)]
    delay: Annotated[Scalar, Quantity("ms", 0, 5000, "from the first pull to the action")]

@record
class Felt:
    tick: Scalar

def params():
    return Reaction(1, 150.0)

def init(params):
    return Felt(-1)

def step(params, state, view):
    down = view.runlevel == 3
    felt = view.arms[0].force > 0
    for arm in view.arms[1:]:
        felt = felt | (arm.force > 0)
    tick = jnp.where(felt & down & (state.tick < 0), view.tick - 1, state.tick)
    acts = (tick >= 0) & (jnp.float32(view.tick - tick) >= params.delay)
    moves = []
    for arm in view.arms:  # of the millisecond before, so is the action
        wanted = arm.model_tip - arm.tip - arm.offset * (view.scale * 1e-6)
        distance = jnp.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2])
        correcting = (tick >= 0) & (jnp.float32(view.tick - 1 - tick) >= params.delay) & down & (params.action == 3)
        speed = jnp.minimum(distance * 5.0, 0.05)
        share = jnp.where(correcting, speed * 1e-3 / jnp.maximum(distance, 1e-9), 0.0)
        moves.append(arm.delta + wanted * share * (1e6 / view.scale))
    return Felt(tick), {
        "delta": tuple(moves),
        "pace": jnp.where(acts & (params.action == 2), 0.25, 1.0),
        "pedal": ~(acts & (params.action == 1)),
    }
"""  # noqa: E501
TREMOR = """
@record
class Size:
    um: Annotated[Scalar, Quantity("um", 0, 5000, "amplitude of the hand")]

@record
class Place:
    um: Scalar

def params():
    return Size(200.0)

def init(params):
    return Place(0.0)

def step(params, state, view):
    place = params.um * jnp.sin(jnp.float32(view.tick) * (2 * 3.14159265 * 8e-3))
    move = Vec((place - state.um, 0.0, 0.0))
    return Place(place), {"delta": tuple(arm.delta + move for arm in view.arms)}
"""
TIRED = """
def step(params, state, view):
    return state, {"pedal": (view.tick < 620) | (view.tick >= 660)}
"""
FAULT = fault("packet", "delx", "offset", [20, 40], 550, arm="gold")


def tables(folder: Path, text: str = "", **more) -> dict:
    """A fault-free run and two in which packets part robot and model, with hands of that text."""
    own = {}
    if text:
        (folder / "mine.py").write_text(HEAD + text)
        own = {"hands": str(folder / "mine.py")}
    fault = {**copy.deepcopy(FAULT), "duration_ms": 150}
    raw = {
        "campaign": {"name": "x", "duration_s": 1.1},
        "operator": {"motion": "suture", **own},
        "group": [{"name": "free"}, {"name": "hit", "fault": [fault]}],
    }
    for name, table in more.items():
        raw[name] = {**raw.get(name, {}), **table} if isinstance(table, dict) else table
    return raw


def require_equal(one, other, but: tuple[str, ...] = ("run_id",)) -> None:
    for name in [name for name in other.columns if name not in but]:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def packets_of(raw: dict):
    """What the console sent that reached the robot in a run without a fault; arrays [packets]."""
    ready = plan.make_plan(rj.load_campaign(raw))
    varied, harmless = ready.lanes([0], 1, harmless=True)
    blocks = (Block(varied, harmless, None),) * 2
    packet = SimdEngine().tracer(ready.program, 1).run(*blocks, ready.columns)[2].packet
    arrived = np.flatnonzero(np.asarray(packet.received))
    delta = np.stack([np.asarray(x) for x in packet.delta[0]], axis=-1)[arrived]
    return (
        arrived,
        delta,
        np.asarray(packet.grasp[0])[arrived],
        np.asarray(packet.surgeon_mode)[arrived],
        ready.motion,
    )


SETTINGS = {
    "both arms": {"campaign": {"arms": ["gold", "green"]}},
    "positions": {"campaign": {"console": "absolute"}},
    "long packets": {"parameters": {"network.cycles_per_packet": 3}},
    "a hand that yields": {"hand": {"newtons_per_unit": 60.0}},
}


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in [*SETTINGS][1:]]


@pytest.mark.parametrize("case", ["both arms", *SLOW])
def test_the_plan_given_back_has_the_bits_of_the_built_in_operator(tmp_path, case):
    own, built_in = (
        rj.run(tables(tmp_path, text, **SETTINGS[case]), engine="simd")
        for text in (AS_COMPUTED, "")
    )
    assert list(own.columns) == list(built_in.columns) and not set(own["run_id"]) & set(
        built_in["run_id"]
    )
    require_equal(own, built_in)


def test_a_file_may_react_as_the_built_in_operator_does(tmp_path):
    """Its three actions, written as a file: lifting the pedal and slowing down to the bit."""
    hit = {"group": tables(tmp_path)["group"][1:]}
    own = tables(tmp_path, REACTING, **hit, cross={"operator.own.hands.action": [1, 2, 3]})
    built_in = tables(
        tmp_path, reaction={"delay_ms": 150.0}, **hit, cross={"reaction.action": [1, 2, 3]}
    )
    own, built_in = (rj.run(raw, engine="simd") for raw in (own, built_in))
    assert (built_in["reaction_ms"] > 0).all() and built_in["pedal_down_ms"].nunique() > 2
    names = [
        name
        for name in built_in.columns
        if name in own.columns and not name.startswith(("param:", "run_id"))
    ]
    exact = built_in["param:reaction.action"] < 3
    require_equal(own[exact], built_in.loc[exact, names], ("pair",))
    for name in ("peak_model_deviation_mm", "peak_golden_deviation_mm", "rms_model_deviation_mm"):
        np.testing.assert_allclose(own[name], built_in[name], rtol=2e-4, err_msg=name)


@pytest.mark.parametrize("packets", ["every_cycle", pytest.param("bursts", marks=pytest.mark.slow)])
def test_a_tremor_is_what_the_console_sends(tmp_path, packets):
    raw = tables(tmp_path, TREMOR, campaign={"packets": packets}, operator={"motion": "still"})
    ticks, delta, _, pedal, _ = packets_of(raw)
    place = 0.1 * 200.0 * np.sin(2 * np.pi * 8e-3 * ticks)
    begins = int(np.flatnonzero(pedal)[0]) - 1
    sent = delta.cumsum(axis=0)
    assert (
        abs(
            sent[begins + 1 :, 0] - (place[begins + 1 :] - (place[begins] if begins >= 0 else 0.0))
        ).max()
        < 2.0
    )
    assert np.ptp(sent[:, 0]) > 36 and not sent[:, 1:].any()


def test_runs_go_on_from_golden_runs_whose_operator_lifts_the_pedal(tmp_path):
    """Faults that count time in pedal-down, which nobody knows before: to the bit as if nothing
    were shared.
    """
    fault = {
        **copy.deepcopy(FAULT),
        "trigger": "pedal",
        "start_ms": [20, 60, 120, 200],
        "duration_ms": 30,
    }
    timed = {**copy.deepcopy(FAULT), "start_ms": [700, 800], "duration_ms": 30}
    group = [{"name": "pedal", "fault": [fault]}, {"name": "timed", "fault": [timed]}]
    text = TREMOR.replace(
        "view.arms)}", 'view.arms), "pedal": (view.tick < 620) | (view.tick >= 660)}'
    )
    ready = plan.make_plan(rj.load_campaign(tables(tmp_path, text, group=group)))
    assert FastForwardPlan(ready, 1).uses_checkpoints.any() and (ready.acts > 0).all()
    branched, whole = computed(ready, SimdEngine()), computed(ready, SimdEngine(), whole=True)
    require_same(branched, whole)
    first = whole[0]["applied0_first_ms"]
    assert (first >= ready.acts).all() and first.max() > 660


def test_its_parameters_are_swept_and_decide_with_its_text(tmp_path):
    raw = tables(
        tmp_path,
        TREMOR,
        cross={"operator.own.hands.um": [0, 500, 2000]},
        operator={"motion": "still"},
    )
    table = rj.run(raw, engine="simd")
    paths = table.groupby("param:operator.own.hands.um")["golden_tip_path_mm"].max()
    way = 4 * 0.2 * 8 * 0.6  # mm in 0.6 s of pedal-down
    # Dry friction holds small ones.
    assert paths[0] < paths[500] < paths[2000] and 0.2 * way < paths[2000] < 1.2 * way
    (tmp_path / "mine.py").write_text(HEAD + TREMOR.replace("200.0", "201.0"))
    assert not set(plan.make_plan(rj.load_campaign(raw)).rows["run_id"]) & set(table["run_id"])


def test_a_campaign_with_one_is_verified_and_alike_in_python(tmp_path):
    (tmp_path / "mine.py").write_text(HEAD + REACTING)
    campaign = tmp_path / "x.toml"
    campaign.write_text(
        '[campaign]\nname = "x"\nduration_s = 0.9\n[operator]\nmotion = "suture"\nfile ='
        ' "mine.py"\n[[group]]\nname = "a"\n[[group.fault]]\nsite = "packet"\nchannel = "delx"\narm'
        ' = "gold"\neffect = "offset"\nvalue = [20, 40]\nstart_ms = 550\nduration_ms = 150\n'
    )
    rj.run(loading.load_campaign(campaign), out=tmp_path / "out", engine="simd")
    assert verification.verify_folder(tmp_path / "out", 1).fine
    config = loading.load_campaign(campaign)
    assert re.match(
        r"suture, generated; hands moved by .*mine\.py; scale 0\.1",
        dict(config.lines())["operator"],
    )
    declared = rj.Campaign(
        name="x",
        duration_s=0.9,
        operator=rj.Operator(motion="suture", hands=tmp_path / "mine.py"),
        group=[rj.Group(name="a", fault=[rj.Fault(**FAULT, duration_ms=150)])],
    )
    (tmp_path / "again.toml").write_text(declared.to_toml())
    for again in (declared.config, loading.load_campaign(tmp_path / "again.toml")):
        assert again.model_dump() == config.model_dump()
    (tmp_path / "mine.py").write_text(HEAD + TIRED)
    assert not verification.verify_folder(tmp_path / "out", 1).fine


STEP = "def step(params, state, view):\n    return "
WRONG = {
    "syntax": ("def step(params:\n", r"mine\.py:2: invalid Python"),
    "key": (
        STEP + "state, {'dleta': ()}",
        (
            r"mine\.py:2: .*returns the key 'dleta' in hands, expected some of delta, grasp,"
            r" pedal, pace\. Did .*'delta'"
        ),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_by_one_error(tmp_path, case):
    text, said = WRONG[case]
    with pytest.raises(UserError, match=said) as error:
        rj.run(tables(tmp_path, text), engine="simd")
    assert len(str(error.value).splitlines()) == 1


NETWORK = {"site": "network", "start_ms": 600, "duration_ms": 50}


@pytest.mark.parametrize(
    "more, said",
    [
        ({"operator": {"hands": "mine.csv"}}, "expected the path of a .py file"),
        ({"reaction": {}}, "react in the file"),
        (
            {"group": [{"name": "a", "fault": [{**NETWORK, "effect": "delay", "value": 5}]}]},
            "may send older packets",
        ),
        ({"parameters": {"operator.own.hands.mm": 1}}, re.escape("operator.own.hands.um")),
        ({"parameters": {"operator.own.hands.um": 9000}}, "0..5000 um"),
    ],
)
def test_what_does_not_go_with_one_is_refused(tmp_path, more, said):
    with pytest.raises(UserError, match=said):
        plan.make_plan(rj.load_campaign(tables(tmp_path, TREMOR, **more)))


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    check_engines(plan.make_plan(loading.from_dict(tables(tmp_path, REACTING))), 3)
