"""Lanes that end at ticks of their own leave what a run of so many ticks leaves, on every
engine.
"""

import dataclasses

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu import engine as cuda
from ravenjax.engines.interface import Block
from ravenjax.engines.xla import ScanEngine

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "value": 9000}
WINDOW = {"start_ms": [2, 5, 11], "duration_ms": [1, 4, "end"]}
CAMPAIGN = {
    "campaign": {"name": "ends", "duration_s": 0.02, "observe_ms": 3},
    "group": [{"name": "a", "fault": [{**FAULT, **WINDOW}]}],
}


@pytest.fixture(scope="module")
def ready():
    return plan.make_plan(rj.load_campaign(CAMPAIGN))


@pytest.fixture(params=["simd", "cuda", "xla"])
def engine(request, monkeypatch, tmp_path):
    if request.param == "cuda":
        real_or_pretended(monkeypatch, tmp_path)
        return cuda.CudaEngine()
    return SimdEngine() if request.param == "simd" else ScanEngine("xla")


def outcomes(engine, ready, ticks, ends):
    """Of all rows and of their golden runs, in runs of so many ticks."""
    program = dataclasses.replace(ready.program, ticks=ticks, ends=ends is not None)
    kernel, rows = engine.compile(program, ready.runs), np.arange(ready.runs)
    lanes = kernel.size(len(rows))
    own = None if ends is None else ends[np.minimum(np.arange(lanes), len(rows) - 1)]
    alone = Block(*ready.lanes(rows, lanes, harmless=True), None, ends=own)
    golden = kernel.run(alone, ready.columns)
    last = (
        None if own is None else np.full(lanes, own.max())
    )  # a series that is shared goes on to the last end
    series = kernel.run(dataclasses.replace(alone, ends=last), ready.columns).reference
    block = Block(*ready.lanes(rows, lanes), series, ends=own)
    return [golden.outcomes, kernel.run(block, ready.columns).outcomes]


@pytest.mark.slow
def test_a_lane_that_ends_is_a_shorter_run(engine, ready):
    ends = ready.ends
    assert ends.tolist() == [6, 9, 20, 9, 12, 20, 15, 18, 20]
    found = outcomes(engine, ready, ready.program.ticks, ends)
    for end in (9,):
        rows = np.flatnonzero(ends == end)
        for one, shorter in zip(found, outcomes(engine, ready, end, None), strict=True):
            for name, values in shorter.items():
                if not (
                    one is found[0] and "golden" in name
                ):  # a golden run has nothing to be far from
                    np.testing.assert_array_equal(
                        one[name][rows], values[rows], err_msg=f"{name} at {end}"
                    )
