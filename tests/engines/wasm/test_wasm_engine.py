"""The tick as WebAssembly: runs are those of engine simd without a fused multiply-add."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
from wasm_runtime import WasmEngine, WasmTarget

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import selection
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel
from ravenjax.engines.interface import Block
from ravenjax.numbers import tree


def unfused():
    """This machine's CPU, its fused multiply-add left alone."""
    return dataclasses.replace(jit.host(), features=jit.host().features - {"fma"})


@pytest.fixture(scope="module")
def config():
    dac = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": ["overwrite", "latch_offset"],
        "value": {"uniform": [-9000, 9000]},
        "start_ms": {"uniform": [50, 250]},
        "duration_ms": {"uniform": [1, 100]},
    }
    weak = {"plant.cable_stiffness_scale": [0.5, 2.0]}
    mpos = {
        "site": "mpos",
        "channel": "elbow",
        "effect": "offset",
        "value": 5.0,
        "start_ms": 60,
        "duration_ms": 50,
    }
    return rj.load_campaign(
        {
            "campaign": {"name": "small", "duration_s": 0.3, "seed": 3, "observe_ms": 60},
            "operator": {"motion": "reach"},
            "group": [
                {"name": "free"},
                {"name": "dac", "design": "random", "runs": 9, "fault": [dac]},
                {"name": "weak", "design": "grid", "parameters": weak, "fault": [mpos]},
            ],
        }
    )


def same(first, second):
    assert first.keys() == second.keys()
    for name, column in first.items():
        np.testing.assert_array_equal(column, second[name], err_msg=name)


TARGETS = {"simd": unfused, "wasm": WasmTarget}


def test_runs_are_those_of_simd_without_fusion(config):
    """A handful, each up to its own end, beside its golden run."""
    ready = plan.make_plan(config)
    program, rows = dataclasses.replace(ready.program, ends=False), np.arange(1, 9)
    results = {}
    for name, target in TARGETS.items():
        kernel = SimdKernel(program, 16, target=target())
        lanes = kernel.size(len(rows))
        (varied, faults), (_, harmless) = (
            ready.lanes(rows, lanes, harmless=free) for free in (False, True)
        )
        ends = ready.ends[rows[np.minimum(np.arange(lanes), len(rows) - 1)]]
        golden = kernel.run(Block(varied, harmless, None), ready.columns)
        faulty = kernel.run(Block(varied, faults, golden.reference, ends=ends), ready.columns)
        results[name] = (
            golden.reference[:, :, :8],
            {key: column[:8] for key, column in faulty.outcomes.items()},
        )
    np.testing.assert_array_equal(results["wasm"][0], results["simd"][0])
    same(results["wasm"][1], results["simd"][1])
    assert results["wasm"][1]["active_ticks"].all()


@pytest.mark.slow
def test_traces_are_those_of_simd_without_fusion(config):
    ready = plan.make_plan(config)
    program = dataclasses.replace(ready.program, ends=False)
    (varied, faults), (_, harmless) = (ready.lanes([4], 1, harmless=free) for free in (False, True))
    signals = {}
    for name, target in TARGETS.items():
        kernel = SimdKernel(program, 1, signals=True, target=target())
        golden = kernel.run(Block(varied, harmless, None), ready.columns)
        signals[name] = kernel.run_signals(Block(varied, faults, golden.reference), ready.columns)[
            1
        ]
    for one, other in zip(tree.leaves(signals["wasm"]), tree.leaves(signals["simd"]), strict=True):
        np.testing.assert_array_equal(one, other)


class _Unfused(SimdEngine):
    def compile(self, program, runs):
        kernel = super().compile(program, runs)
        kernel._target = unfused()
        return kernel


@pytest.mark.slow
def test_quick_is_that_of_simd_without_fusion_word_by_word(monkeypatch):
    config, tables = rj.load_campaign("quick"), []
    for engine in (WasmEngine(), _Unfused()):
        monkeypatch.setattr(selection, "select", lambda *_, engine=engine: engine)
        tables.append(rj.run(config))
    assert len(tables[0]) > 2500
    pd.testing.assert_frame_equal(*tables, check_exact=True)
