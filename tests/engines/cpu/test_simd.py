"""Engine simd: a lane's result is its own, whatever runs beside it; its campaigns are those of
engine xla.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import selection, traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel
from ravenjax.engines.interface import Block
from ravenjax.engines.xla import ScanEngine


def campaign(runs, duration_s=0.6, **changes):
    """Free runs, DAC faults of many sizes, and cables of two stiffnesses."""
    dac = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow"],
        "effect": ["overwrite", "latch_offset"],
        "value": {"uniform": [-9000, 9000]},
        "start_ms": {"uniform": [250, 400]},
        "duration_ms": {"uniform": [1, 100]},
    }
    mpos = {
        "site": "mpos",
        "channel": "insertion",
        "effect": "offset",
        "start_ms": 300,
        "duration_ms": 50,
    }
    weak = {"plant.cable_stiffness_scale": [0.5, 2.0]}
    return rj.load_campaign(
        {
            "campaign": {"name": "small", "duration_s": duration_s, "seed": 3},
            "operator": {"motion": "reach"},
            "haptics": {"threshold_mm": [0.5, 1.0, 3.0]},
            "group": [
                {"name": "free"},
                {"name": "dac", "design": "random", "runs": runs, "fault": [dac]},
                {
                    "name": "weak",
                    "design": "grid",
                    "parameters": weak,
                    "fault": [{**mpos, "value": [0.5, 5.0, 50.0]}],
                },
            ],
        }
        | changes
    )


@pytest.fixture(scope="module")
def ready():
    return plan.make_plan(campaign(20))


@pytest.fixture(scope="module")
def loop(ready):
    block = Block(*ready.lanes([0], 1), None)
    return traced.trace_tick(ready.program, block, ready.columns)


class Forced(SimdKernel):
    """One that groups lanes, or does not, and whose vectors have this width."""

    def __init__(self, program, loop, width, grouped):
        super().__init__(program, 16)
        self._forms, self.width, self.forced = traced.Forms(loop), width, grouped

    def _groups(self, block):
        inputs, group = self.groups(block)
        return inputs, group if self.forced else np.zeros_like(group), self.forced


def run(kernel, ready, rows):
    """Golden runs and faulty runs of these rows."""
    varied, faults = ready.lanes(rows, len(rows))
    _, harmless = ready.lanes(rows, len(rows), harmless=True)
    golden_runs = kernel.run(Block(varied, harmless, None), ready.columns)
    return golden_runs, kernel.run(Block(varied, faults, golden_runs.reference), ready.columns)


def same_lanes(a, b, of_a, of_b):
    for first, second in zip(a, b, strict=True):
        assert first.outcomes.keys() == second.outcomes.keys()
        for name, column in first.outcomes.items():
            np.testing.assert_array_equal(column[of_a], second.outcomes[name][of_b], err_msg=name)
        np.testing.assert_array_equal(first.reference[:, :, of_a], second.reference[:, :, of_b])


@pytest.fixture(scope="module")
def whole(ready, loop):
    return run(
        Forced(ready.program, loop, jit.host_target().width, True), ready, np.arange(ready.runs)
    )


@pytest.mark.slow
@pytest.mark.parametrize(("width", "grouped"), [(16, False), (8, True), (4, False), (1, True)])
def test_vector_width_and_groups_change_no_bit(ready, loop, whole, width, grouped):
    again = run(Forced(ready.program, loop, width, grouped), ready, np.arange(ready.runs))
    same_lanes(whole, again, slice(None), slice(None))


@pytest.mark.slow
def test_a_lane_does_not_see_its_neighbours_nor_other_threads(ready, loop, whole):
    kernel = SimdKernel(ready.program, 16)
    kernel._forms = traced.Forms(loop)
    rows = [
        np.array([25, 3, 3, 11]),
        np.arange(ready.runs)[::-1],
        np.array([0]),
        np.array([26, 21, 22]),
    ]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda block: run(kernel, ready, block), rows))
    for block, result in zip(rows, found, strict=True):
        same_lanes(result, whole, slice(None), block)


@pytest.mark.slow
def test_compiled_code_is_kept_and_used_again(ready, loop, whole, monkeypatch):
    objects = {}
    for _ in range(2):
        kernel = SimdKernel(ready.program, 16, objects)
        kernel._forms = traced.Forms(loop)
        again = run(kernel, ready, np.arange(7))
        same_lanes(again, whole, slice(None), np.arange(7))
        assert len(objects) == 1
        monkeypatch.setattr(jit.llvm.TargetMachine, "emit_object", None)


def rows_of(config, engine, monkeypatch) -> pd.DataFrame:
    monkeypatch.setattr(selection, "select_engine", lambda *_: engine)
    return rj.run(config)


@pytest.mark.slow
def test_verdicts_are_those_of_engine_xla(monkeypatch):
    """float32 trajectories part after a jump or a trip; of 2 000 runs at least 99.5 % still end
    in the same verdict.
    """
    config = campaign(2000)
    ours, theirs = (
        rows_of(config, engine, monkeypatch) for engine in (SimdEngine(), ScanEngine("xla"))
    )
    assert (ours["verdict"] == theirs["verdict"]).mean() >= 0.995
    assert (ours["active_ticks"] == theirs["active_ticks"]).mean() >= 0.995
    alike = ours["verdict"] == theirs["verdict"]
    near = np.isclose(
        ours["peak_model_deviation_mm"], theirs["peak_model_deviation_mm"], rtol=0.02, atol=0.01
    )
    assert near[alike].mean() >= 0.99
