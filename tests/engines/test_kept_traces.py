"""A trace that was kept, in the process or on disk, is the trace; one of anything else is not found
there.
"""

import dataclasses
import sys
import threading
import types
from concurrent.futures import ThreadPoolExecutor

import jax
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import trace_key, traced
from ravenjax.engines.cpu.kernel import print_kernel
from ravenjax.engines.gpu.kernel import Form, print_loop
from ravenjax.engines.interface import Block
from ravenjax.ir.time_loop import split_lanes

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "offset"}
FAULT |= {"value": [0, 4000], "start_ms": 20}


def ready(**changes):
    table = {
        "campaign": {"name": "kept", "duration_s": 0.1},
        "operator": {"motion": "reach"},
        "group": [
            {"name": "dac", "fault": [FAULT], "parameters": {"plant.mass_scale": [1.0, 1.1]}}
        ],
    }
    made = plan.make_plan(rj.load_campaign(table | changes))
    return dataclasses.replace(made, program=traced.printable_program(made.program))


@pytest.fixture(scope="module")
def made():
    return ready()


@pytest.fixture(scope="module")
def fresh(made):
    return traced.trace_tick(made.program, block(made), made.columns)


@pytest.fixture
def counted(monkeypatch, fresh):
    """Programs that were traced; tracing takes no time."""
    calls = []
    traced.FORMS.clear()
    monkeypatch.setattr(traced, "trace_tick", lambda program, *_: calls.append(program) or fresh)
    yield calls
    traced.FORMS.clear()


def block(made, rows=1) -> Block:
    return Block(*made.lanes([0] * rows, rows), None)


def forms(made, objects=None, rows=1):
    """From `objects` as another process would find them, else from this process."""
    if objects is not None:
        traced.FORMS.clear()
    return traced.traced_forms(made.program, block(made, rows), made.columns, objects)


def test_the_same_campaign_again_is_not_traced_again(made, counted):
    first = forms(made)
    assert forms(ready(), rows=3) is first and len(counted) == 1


def test_the_next_process_does_not_trace_again_whatever_the_varied_values_are(made, fresh, counted):
    objects = {}
    forms(made, objects)
    other = {"name": "dac", "fault": [FAULT | {"value": [7, 8, 9], "start_ms": 30}]}
    other["parameters"] = {"plant.mass_scale": [0.9, 1.3]}
    found = forms(ready(group=[other]), objects)
    assert len(counted) == 1 and found.traced == fresh


@pytest.mark.parametrize("kept", [None, {}], ids=["process", "disk"])
@pytest.mark.parametrize(
    "changes",
    [
        {"operator": {"motion": "reach", "scale": 0.11}},
        {"parameters": {"plant.friction_scale": 1.1}},
        {"haptics": {"threshold_mm": [2.0]}},
        {"campaign": {"name": "kept", "duration_s": 0.2}},
        {"campaign": {"name": "kept", "duration_s": 0.1, "software": "fork2015"}},
    ],
    ids=str,
)
def test_another_program_is_traced(made, counted, changes, kept):
    objects = None if kept is None else {}
    forms(made, objects)
    forms(ready(**changes), objects)
    assert len(counted) == 2


def test_numbers_of_the_parameters_count(made, counted):
    leaves, structure = jax.tree.flatten(made.program.params)
    assert len(leaves) > 100
    forms(made)
    for k, leaf in list(enumerate(leaves))[::5]:
        params = jax.tree.unflatten(
            structure, [*leaves[:k], leaf + type(leaf)(1), *leaves[k + 1 :]]
        )
        forms(dataclasses.replace(made, program=dataclasses.replace(made.program, params=params)))
    assert len(counted) == 1 + len(leaves[::5])


def test_who_asks_for_the_same_at_the_same_time_waits(made, counted):
    together = threading.Barrier(4)

    def ask(_):
        together.wait()
        return forms(made)

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(ask, range(4)))
    assert len(counted) == 1 and all(one is found[0] for one in found)


def test_other_code_or_versions_are_traced(made, counted, monkeypatch):
    objects = {}
    forms(made, objects)
    with monkeypatch.context() as patch:
        patch.setattr(trace_key, "package_versions", lambda: ("3.99",))
        forms(made, objects)
    with monkeypatch.context() as patch:
        patch.setattr(trace_key, "AT_IMPORT", "other files")
        patch.setattr(trace_key, "hash_files", lambda: "other files")
        forms(made, objects)
    assert len(counted) == 3
    forms(made, objects)
    assert len(counted) == 3


def test_a_robot_of_another_package_is_not_kept(made, counted, monkeypatch):
    monkeypatch.setitem(
        sys.modules, "my_lab_loop", types.SimpleNamespace(**vars(made.program.loop))
    )
    program, objects = dataclasses.replace(made.program, module="my_lab_loop"), {}
    for _ in range(2):
        forms(dataclasses.replace(made, program=program), objects)
    assert len(counted) == 2 and not objects


@pytest.mark.parametrize("content", [b"", b"nothing of this kind"])
def test_what_is_no_trace_is_traced_anew(made, fresh, counted, content):
    objects = {}
    forms(made, objects)
    (key,) = objects
    objects[key] = content
    assert forms(made, objects).traced == fresh and len(counted) == 2
    assert objects[key] != content


def test_printed_code_comes_back(made, fresh, counted):
    parts = split_lanes(fresh.without_signals(), 1, True)
    objects, calls = {}, []
    for printed in (print_kernel(parts, 8, frozenset()), print_loop(parts, Form(), True)):
        for width in (8, 8, 4):
            make = lambda printed=printed: calls.append(1) or printed  # noqa: E731
            assert forms(made, objects).printed((type(printed).__name__, width), make) == printed
    assert len(calls) == 4
