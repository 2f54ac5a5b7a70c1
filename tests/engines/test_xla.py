"""Engines xla and mjx: link dynamics by MuJoCo, lanes among devices, and segments."""

import os
import subprocess
import sys

import numpy as np
import pytest

import ravenjax as rj
from ravenjax import resources
from ravenjax.campaign import compile_cache, plan
from ravenjax.engines import xla as scan
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.engines.interface import Block, TickProgram
from ravenjax.engines.xla import LANE_MULTIPLE, ScanEngine
from ravenjax.errors import UserError
from ravenjax.numbers.setup import REFERENCE, Setup
from ravenjax.robots.raven2.campaign import hands

compile_cache.enable_cache()

FAULTS = (
    ("usb_out", "shoulder", "overwrite", 6000),
    ("current_cmd", "elbow", "offset", 2000),
    ("mpos", "insertion", "offset", 5.0),
    ("encoder", "elbow", "drift", 20.0),
    ("pos_d", "x", "offset", 2000),
    ("external_torque", "elbow", "overwrite", 2.0),
)
PEDAL_ROWS = 440
"""Rows of the motion left out, so that the pedal is down from the first tick on and the hand
moves from tick 60 on.
"""


def campaign(ticks, friction=1.0, arm="gold"):
    """A fault-free run and one for each of FAULTS from tick 30 on, for 40 ms."""
    groups = [{"name": "free"}]
    for row in FAULTS:
        fault = dict(zip(("site", "channel", "effect", "value"), row, strict=True))
        fault |= {"start_ms": 30, "duration_ms": 40}
        groups.append({"name": f"{row[0]} {row[1]}", "fault": [fault]})
    return {
        "campaign": {"name": "scan", "duration_s": ticks / 1e3, "arms": [arm]},
        "operator": {"motion": "suture"},
        "parameters": {"plant.friction_scale": friction},
        "haptics": {"threshold_mm": [1.0, 3.0]},
        "group": groups,
    }


def planned(ticks, arm="gold", **options):
    """The plan of `campaign` and its motion from PEDAL_ROWS on."""
    ready = plan.make_plan(rj.load_campaign(campaign(ticks, arm=arm)), **options)
    longer = hands.operator_motion(rj.load_campaign(campaign(ticks + PEDAL_ROWS, arm=arm)))
    return ready, tuple(np.ascontiguousarray(column[PEDAL_ROWS:]) for column in longer.table().T)


def same(a, b):
    """Equal to the last bit, also where not a number."""
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def gap(a, b):
    """Largest |a - b| / max(1, |a|) of two arrays."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    np.testing.assert_array_equal(np.isfinite(a), np.isfinite(b))
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    return float((np.abs(a - b) / np.maximum(1.0, np.abs(a))).max(initial=0.0))


def run_on(engine, ready, columns):
    """Every run as a golden run: without a reference the tips of faulty runs are returned, too."""
    kernel = engine.compile(ready.program, ready.runs)
    return kernel.run(Block(*ready.lanes(range(ready.runs), LANE_MULTIPLE), None), columns)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["gold", "green"])
def test_whole_ticks_of_mjx_are_those_of_simd(arm):
    """In float32; MuJoCo's link dynamics are the oracle of the printed ones."""
    simd, mjx = (run_on(engine, *planned(100, arm)) for engine in (SimdEngine(), ScanEngine("mjx")))
    np.testing.assert_allclose(simd.reference[:, :3], mjx.reference[:, :3], rtol=0, atol=2e-6)
    assert np.ptp(simd.reference[:, :3], axis=0).max() > 1e-3, "the robot moved, m"
    for name, values in simd.outcomes.items():
        if values.dtype.kind != "f":
            np.testing.assert_allclose(values, mjx.outcomes[name], rtol=0, atol=2, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "joint", "force"),
    [("ur5e", "elbow", 20.0), ("psm", "pitch", 3.0), ("iiwa14", "joint_2", 20.0)],
)
def test_whole_ticks_of_mjx_are_those_of_simd_for_an_mjcf_file(tmp_path, arm, joint, force):
    """In float32, with servos, gravity, friction loss and springs, and faults of each of them."""
    groups = [{"name": "free"}]
    for site, effect, value in (
        ("torque", "offset", force),
        ("actuator", "overwrite", force),
        ("actuator", "scale", 0.5),
        ("encoder", "offset", 0.1),
        ("command", "drift", 0.02),
    ):
        fault = {"site": site, "channel": joint, "effect": effect, "value": value}
        fault |= {"start_ms": 30, "duration_ms": 40}
        groups.append({"name": f"{site} {effect}", "fault": [fault]})
    robot = tmp_path / "arm.xml"
    model = resources.find_model(f"{arm}/{arm}.xml").read_text()
    # A tick of the UR5e has two time steps.
    robot.write_text(model.replace('"0.001"', '"0.0025"') if arm == "ur5e" else model)
    content = {
        "campaign": {"name": "arm", "robot": str(robot), "duration_s": 0.2},
        "operator": {"hz": 2.0},
        "parameters": {"tracking": 0.5},
        "group": groups,
    }
    ready = plan.make_plan(rj.load_campaign(content))
    runs = [run_on(engine, ready, ready.columns) for engine in (SimdEngine(), ScanEngine("mjx"))]
    (simd, mjx), rows = runs, slice(ready.runs)
    tips, others = (found.reference[:, :3, rows] for found in runs)
    np.testing.assert_allclose(tips, others, rtol=0, atol=1e-6)
    assert np.ptp(tips, axis=0).max() > 1e-3, "the robot moved, m"
    for name, values in simd.outcomes.items():
        if values.dtype.kind != "f":
            np.testing.assert_array_equal(values[rows], mjx.outcomes[name][rows], err_msg=name)


def test_engine_mjx_refuses_a_robot_without_a_model():
    with pytest.raises(UserError, match="moves the links of the Raven-II and of MJCF files"):
        ScanEngine("mjx").compile(TickProgram("own_arm", Setup(), None, (), 1), 1)


TICKS = 1013  # a prime: no segment but one tick divides it


def run_rows(ready, kernel, golden, rows):
    """Outcomes of a block that holds `rows`, [rows] each."""
    plan_, columns = ready
    found = kernel.run(Block(*plan_.lanes(rows, kernel.lanes), golden.reference), columns)
    return {name: values[: len(rows)] for name, values in found.outcomes.items()}


@pytest.mark.slow  # XLA compiles a whole tick for a minute or two
def test_lanes_divided_among_devices_give_the_same_bits(tmp_path):
    """Two devices that XLA simulates on the CPU stand for two accelerators."""
    script = f"""
import sys
sys.path[:0] = {sys.path!r}
import jax, numpy as np
from engines import test_xla as here
results = []
for devices in ((), tuple(jax.devices())):
    here.scan._accelerators = lambda: devices
    ready, columns = here.planned(40)
    kernel = here.scan.ScanKernel(ready.program, 2 * here.scan.LANE_MULTIPLE)
    block = here.scan.Block(*ready.lanes([0], kernel.lanes, harmless=True), None)
    golden = kernel.run(block, columns)
    results.append(here.run_rows((ready, columns), kernel, golden, range(ready.runs)))
assert len(devices) == 2
here.same(*results)
"""
    environment = {**os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    subprocess.run([sys.executable, "-c", script], env=environment, check=True, cwd=tmp_path)


@pytest.mark.slow
def test_segments_that_do_not_divide_the_run_change_nothing(monkeypatch):
    """In float64, as another length of segment is another program: in float32 a DAC command may
    be a count off.
    """
    content = {**campaign(TICKS, friction=[0.5, 1.0, 2.0]), "group": [{"name": "free"}]}
    ready = plan.make_plan(rj.load_campaign(content), REFERENCE)
    results = []
    for length in (None, TICKS):
        if length is not None:
            monkeypatch.setattr(scan, "segment_ticks", lambda ticks, longest: ticks)
        kernel = ScanEngine("xla").compile(ready.program, ready.runs)
        assert kernel.length == (length or 507), (
            "507: two segments, the last overshoots the run by one tick"
        )
        results.append(kernel.run(Block(*ready.lanes(range(3), kernel.lanes), None), ready.columns))
    split, whole = results
    assert split.reference.shape == whole.reference.shape == (TICKS, 6, LANE_MULTIPLE)
    assert gap(split.reference, whole.reference) < 1e-9
    assert split.outcomes["peak_model_deviation_mm"][:3].min() > 0.1, "the robot moved"
    for name, values in whole.outcomes.items():
        assert gap(split.outcomes[name], values) < (1e-6 if values.dtype == np.float32 else 1e-9), (
            name
        )
