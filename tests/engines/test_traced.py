"""What is traced for a program is kept for the next that needs the same code, and for no other."""

from __future__ import annotations

import dataclasses
import threading
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import traced
from ravenjax.engines.interface import Block
from ravenjax.engines.traced import Forms

FAULT = {
    "site": "usb_out",
    "channel": "elbow",
    "effect": "offset",
    "value": [0, 4000],
    "start_ms": 20,
}


@pytest.fixture
def counted(monkeypatch):
    """Programs that were traced, nothing being kept at first; tracing itself takes no time."""
    calls = []
    traced.forget()
    monkeypatch.setattr(traced, "trace", lambda program, *_: calls.append(program) or object())
    yield calls
    traced.forget()


def ready(duration_s=0.1, **changes):
    table = {
        "campaign": {"name": "traced", "duration_s": duration_s},
        "operator": {"motion": "reach"},
        "parameters": {"plant.mass_scale": 1.1},
        "group": [{"name": "dac", "fault": [FAULT]}],
    }
    return plan.make_plan(rj.load_campaign(table | changes))


def forms(made, rows=1) -> Forms:
    return traced.forms(made.program, Block(*made.lanes([0] * rows, rows), None), made.columns)


def test_the_same_campaign_again_is_not_traced_again(counted):
    first = forms(ready())
    assert forms(ready(), rows=3) is first and len(counted) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"operator": {"motion": "reach", "scale": 0.11}},
        {"parameters": {"plant.friction_scale": 1.1}},
        {"parameters": {"plant.mass_scale": 1.1, "plant.friction_scale": 1.0}},
        {"haptics": {"threshold_mm": [2.0]}},
        {"duration_s": 0.2},
    ],
    ids=str,
)
def test_another_program_is(counted, changes):
    assert forms(ready()) is not forms(ready(**changes)) and len(counted) == 2


def test_numbers_of_the_parameters_count(counted):
    made = ready()
    leaves, structure = jax.tree.flatten(made.program.params)
    assert len(leaves) > 100
    forms(made)
    for k, leaf in list(enumerate(leaves))[::5]:
        params = jax.tree.unflatten(
            structure, [*leaves[:k], leaf + type(leaf)(1), *leaves[k + 1 :]]
        )
        forms(dataclasses.replace(made, program=dataclasses.replace(made.program, params=params)))
    assert len(counted) == 1 + len(leaves[::5])


def test_a_block_of_other_types_is_another(counted):
    made = ready()
    varied, faults = made.lanes([0], 1)
    traced.forms(made.program, Block(varied, faults, None), made.columns)
    wide = {path: np.asarray(values, np.float64) for path, values in varied.items()}
    traced.forms(made.program, Block(wide, faults, None), made.columns)
    assert len(counted) == 2


def test_only_the_last_few_are_kept(counted):
    scales = [0.1 + 0.01 * k for k in range(traced.KEPT + 1)]
    for scale in (*scales, scales[-1], scales[0]):
        forms(ready(operator={"motion": "reach", "scale": scale}))
    assert len(counted) == len(scales) + 1, "the first one twice"


def test_who_asks_for_the_same_at_the_same_time_waits(counted):
    together, made = threading.Barrier(4), ready()

    def ask(_):
        together.wait()
        return forms(made)

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(ask, range(4)))
    assert len(counted) == 1 and all(one is found[0] for one in found)


def test_code_is_made_once_for_each_key():
    made, kept = [], Forms(None)  # type: ignore[arg-type]
    for key in (("simd", 1), ("simd", 2), ("simd", 1)):
        assert kept.code(key, lambda key=key: made.append(key) or list(key)) == list(key)
    assert made == [("simd", 1), ("simd", 2)]
