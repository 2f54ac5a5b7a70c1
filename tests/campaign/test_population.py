"""Robots whose kinematic errors are drawn: by one key, for each run anew, the same for a run and
its golden run.
"""

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED

FAULT = {
    "site": "usb_out",
    "channel": "shoulder",
    "effect": "offset",
    "value": [2000, 14000],
    "start_ms": 150,
}
PREFIX = "plant.gold.kinematic_errors."
TICKS = 250


def tables(groups=None, **campaign) -> dict:
    clean, faulty = (
        {"name": "free", "repeats": 2},
        {"name": "a", "fault": [{**FAULT, "duration_ms": 32}]},
    )
    return {
        "campaign": {
            "name": "x",
            "duration_s": TICKS / 1e3,
            "kinematic_errors": "measured",
            **campaign,
        },
        "operator": {"motion": "reach"},
        "group": groups or [clean, faulty],
    }


def planned(groups=None, **campaign) -> plan.Plan:
    return plan.make_plan(rj.load_campaign(tables(groups, **campaign)))


def traced(ready: plan.Plan, row: int):
    """Signals of a run: arrays [ticks]."""
    varied, faults = ready.lanes([row], 1)
    _, harmless = ready.lanes([row], 1, harmless=True)
    blocks = Block(varied, harmless, None), Block(varied, faults, None)
    return SimdEngine().tracer(ready.program, 1).run(*blocks, ready.columns)[2]


def test_every_run_draws_its_robot_and_shares_it_with_its_golden_run() -> None:
    ready = planned()
    assert set(ready.varied) == {PREFIX + path for path in MEASURED}
    assert all(len(set(values.tolist())) == 4 for values in ready.varied.values())
    assert ready.golden.tolist() == [0, 1, 2, 3], (
        "runs of different robots have different golden runs"
    )
    assert int(ready.program.params.plant[0].kinematic_errors.registered) == 1


def test_before_its_fault_a_run_is_its_golden_run_and_both_are_off_the_report() -> None:
    signals = traced(planned(), 3)
    tip = np.stack([np.asarray(x).ravel() for x in signals.tip[0]], axis=-1)
    um = np.stack([np.asarray(x).ravel() for x in signals.control.arms[0].pos.position_um], axis=-1)
    apart = np.linalg.norm(tip - um * 1e-6, axis=1)
    assert 1e-4 < apart[10] < 0.03
    np.testing.assert_allclose(apart[:150], apart[10], atol=1e-3)


def test_the_draw_follows_the_campaign_s_seed_and_the_file_s_own_parameters_come_first() -> None:
    one, same, other = (
        planned(seed=seed).varied[PREFIX + "joint_offset.elbow"] for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    raw = tables()
    raw["parameters"] = {PREFIX + "joint_offset.elbow": 0.05}
    assert set(
        plan.make_plan(rj.load_campaign(raw)).varied[PREFIX + "joint_offset.elbow"].tolist()
    ) == {np.float32(0.05)}


def test_a_crossed_scale_gives_every_fault_the_same_robot_at_each_size() -> None:
    raw = tables()
    raw["cross"] = {"plant.kinematic_errors.scale": [0.0, 0.5, 1.0]}
    ready = plan.make_plan(rj.load_campaign(raw))
    elbow = ready.varied[PREFIX + "joint_offset.elbow"].reshape(-1)
    pair = ready.rows["pair"].to_numpy()
    assert all(len(set(elbow[pair == one].tolist())) == 1 for one in set(pair.tolist()))
    assert sorted(set(ready.varied["plant.kinematic_errors.scale"].tolist())) == [0.0, 0.5, 1.0]


@pytest.mark.slow
def test_the_engine_for_gpus_has_the_same_bits(monkeypatch, tmp_path) -> None:
    real_or_pretended(monkeypatch, tmp_path)
    group = [{"name": "a", "fault": [{**FAULT, "start_ms": 20, "duration_ms": 30}]}]
    check_engines(planned(group, duration_s=0.06), 2)
