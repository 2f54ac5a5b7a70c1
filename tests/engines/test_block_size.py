"""Blocks of any size: as many lanes as a kernel asks for, each with its golden run, give the
bits of one full block.
"""

import numpy as np
import pytest
from cuda_as_cpp import pretend

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu import engine as cuda
from ravenjax.engines.interface import Block
from ravenjax.engines.xla import ScanEngine

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "start_ms": 3}
FAULT |= {"duration_ms": 9, "value": [-9000, 0, 100, 5000, 20000]}
SCALES = {"plant.cable_stiffness_scale": [0.5, 1.0, 2.0]}
CAMPAIGN = {
    "campaign": {"name": "sizes", "duration_s": 0.02},
    "group": [{"name": "a", "fault": [FAULT], "parameters": SCALES}],
}


@pytest.fixture(scope="module")
def ready():
    return plan.make_plan(rj.load_campaign(CAMPAIGN))


@pytest.fixture
def engine(request, monkeypatch, tmp_path):
    if request.param == "cuda":
        pretend(monkeypatch, tmp_path)
        return cuda.CudaEngine()
    return SimdEngine() if request.param == "simd" else ScanEngine("xla")


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["simd", "cuda", "xla"], indirect=True)
def test_small_blocks_give_the_bits_of_a_large_one(engine, ready):
    """Runs of three golden runs: at once with a series a lane, and a few at a time with a series
    a golden run.
    """
    kernel, rows = engine.compile(ready.program, ready.runs), np.arange(ready.runs)
    lanes = kernel.size(len(rows))
    own = kernel.run(Block(*ready.lanes(rows, lanes, harmless=True), None), ready.columns)
    whole = kernel.run(Block(*ready.lanes(rows, lanes), own.reference), ready.columns)

    golden_runs = kernel.size(3)
    of_three = kernel.run(
        Block(*ready.lanes(rows[:3], golden_runs, harmless=True), None), ready.columns
    )
    np.testing.assert_array_equal(of_three.reference[:, :, :3], own.reference[:, :, :3])
    for some in (rows[:1], rows[1:6], rows[6:]):
        lanes = kernel.size(len(some))
        golden = ready.golden[some[np.minimum(np.arange(lanes), len(some) - 1)]]
        block = Block(*ready.lanes(some, lanes), of_three.reference[:, :, :3], golden)
        found = kernel.run(block, ready.columns)
        for name, values in whole.outcomes.items():
            np.testing.assert_array_equal(
                found.outcomes[name][: len(some)], values[some], err_msg=name
            )


@pytest.mark.slow
def test_engine_cuda_runs_what_has_neither_faults_nor_parameters(monkeypatch, tmp_path):
    pretend(monkeypatch, tmp_path)
    free = rj.load_campaign({**CAMPAIGN, "group": [{"name": "free"}]})
    assert rj.run(free, engine="cuda")["verdict"].tolist() == ["silent/none/no cue"]
