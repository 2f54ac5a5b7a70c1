"""Engine cuda without a GPU: its kernels compiled as C++, everything else as it is."""

import sys

import numpy as np
import pytest
from branching_cases import observed, require_same, tables
from cuda_as_cpp import Device, pretend
from cuda_cases import check_engines, cut
from small_loop import TABLE, in_numpy, loop

from ravenjax.campaign import golden_runs
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.gpu import code as cuda_code
from ravenjax.engines.gpu import course as cuda_course
from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu import engine as cuda
from ravenjax.engines.gpu.code import CudaCode, column_words
from ravenjax.engines.gpu.course import place_lanes, plan_course
from ravenjax.engines.gpu.kernel import Form, print_loop
from ravenjax.engines.lanes import Lanes
from ravenjax.errors import UserError
from ravenjax.ir.time_loop import split_lanes
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import replace


@pytest.mark.slow
@pytest.mark.parametrize("by_group", [True, False])
@pytest.mark.parametrize("shared_words", [0, 3, 64])
def test_a_time_loop_split_into_kernels_is_the_loop(monkeypatch, tmp_path, by_group, shared_words):
    pretend(monkeypatch, tmp_path)
    monkeypatch.setattr(cuda_code, "CHUNK", 4)
    lanes, ticks = 70, 11
    rng = np.random.default_rng(3)
    group = np.arange(lanes) % 2
    gain = rng.standard_normal(2).astype(np.float32)[group]
    kick = rng.uniform(-0.5, 0.5, lanes).astype(np.float32)
    series = rng.standard_normal((ticks, 2)).astype(np.float32)  # of each group
    given = np.ascontiguousarray(series[:, group])

    form = Form(32, shared_words, region=3, in_step_from=1)
    source = print_loop(split_lanes(loop(), 1, by_group), form, by_group)
    code = CudaCode(source, by_group, Device(), form)
    places = place_lanes(group if by_group else np.zeros_like(group), form.threads)
    entering = series.T[:, :, None] if by_group else given[:, None, :][:, :, places.lane]
    out = np.zeros((ticks, 2, lanes), np.uint32)
    finished = []
    course = plan_course(places, form.threads, np.full(lanes, ticks))
    moved = Lanes([gain, kick], entering, TABLE, out)
    found = code.run_course(moved, places, course, finished.append)

    expected, leaving = in_numpy(loop(), gain, kick, given, ticks)
    for got, column in zip(found, expected, strict=True):
        np.testing.assert_array_equal(
            column_words(got), column_words(np.broadcast_to(np.asarray(column), lanes))
        )
    np.testing.assert_array_equal(out, column_words(leaving.astype(np.float32)))
    assert finished == [4 * lanes, 4 * lanes, 3 * lanes]


@pytest.fixture(scope="module")
def short():
    """A plan of every fault site, cut to its first ticks."""
    return cut(60)


@pytest.mark.slow
def test_a_tick_has_the_bits_of_engine_simd(monkeypatch, tmp_path, short):
    pretend(monkeypatch, tmp_path)
    check_engines(short, 40)


@pytest.mark.slow
@pytest.mark.parametrize("observe", [None, 20])
def test_runs_go_on_from_their_golden_runs(monkeypatch, tmp_path, observe):
    """Several blocks of threads, which begin at snapshots of their own; or end at ticks of their
    own, in one launch.
    """
    pretend(monkeypatch, tmp_path)
    monkeypatch.setattr(cuda_code, "EVERY", 10)
    monkeypatch.setattr(cuda_course, "EVERY", 10)
    monkeypatch.setattr(cuda_code, "CHUNK", 32)
    monkeypatch.setattr(golden_runs, "MIN_SAVING", 0)
    monkeypatch.setattr(cuda_course.BlockCourse, "scattered", observe is not None)
    for module in (cuda, cuda_code):
        monkeypatch.setattr(module, "form_for", lambda _: Form(32))
    ready = striking(cut(150), np.random.default_rng(5))
    if observe is not None:
        ready = observed(ready, observe)
    engine = cuda.CudaEngine()
    assert golden_runs.FastForwardPlan(ready, 32).uses_checkpoints.all()
    courses, planned = [], cuda.plan_course
    monkeypatch.setattr(
        cuda, "plan_course", lambda *args: courses.append(planned(*args)) or courses[-1]
    )
    some, whole = tables(ready, engine), tables(ready, SimdEngine(), whole=True)
    assert any(course.first > 0 and course.group_state is not None for course in courses)
    assert any(len(course.snapshots) > 1 for course in courses)
    require_same(some, whole)
    assert (whole[0]["active_ticks"] > 0).any()


def striking(ready, rng):
    """128 runs of a plan of two golden runs, with faults that strike at any time."""
    rows = rng.integers(0, ready.runs, 128)
    faults = {name: values[rows] for name, values in ready.faults.items()}
    faults |= {
        "trigger": np.zeros_like(faults["trigger"]),
        "start": rng.integers(25, 140, faults["start"].shape).astype(faults["start"].dtype),
        "duration": rng.integers(1, 20, faults["duration"].shape).astype(faults["duration"].dtype),
        "every": np.zeros_like(faults["every"]),
    }
    golden = np.repeat([0, 1], 64).astype(np.int32)
    varied = {path: values[rows[golden]] for path, values in ready.varied.items()}
    return replace(ready, rows=ready.rows.take(rows), faults=faults, varied=varied, golden=golden)


def test_what_cannot_be_is_one_line_that_says_so(monkeypatch, short):
    monkeypatch.setattr(cuda_device, "visible_gpus", lambda: (Device(),))
    wide = replace(short.program, setup=replace(short.program.setup, precision=REFERENCE))
    with pytest.raises(UserError, match="engine 'cuda' computes in float32"):
        cuda.CudaEngine().compile(wide, 1)
    monkeypatch.undo()
    cuda_device.visible_gpus.cache_clear()
    monkeypatch.setitem(sys.modules, "cuda.bindings", None)
    with pytest.raises(
        UserError, match=r"needs the package cuda-bindings .*: pip install 'ravenjax\[cuda\]'"
    ):
        cuda.CudaEngine().compile(short.program, 1)
