"""The arm of an MJCF file runs like the Raven-II, on two engines, and moves as C MuJoCo says."""

import dataclasses
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import planar_arm
import pytest
from rendered_page import Page, words

import ravenjax as rj
from ravenjax import functional
from ravenjax.cli import main
from ravenjax.errors import UserError
from ravenjax.numbers import replace
from ravenjax.store import manifest

FILE = """
[campaign]
name = "planar"
robot = "planar_arm"
duration_s = 0.6
seed = 3

[parameters]
kp = { uniform = [30, 50] }
kd = 2.0
tracking = 0.25

[[group]]
name = "encoder"
design = "random"
runs = 20
[[group.fault]]
site = "encoder"
channel = "*"
effect = "offset"
value = { uniform = [-0.3, 0.3] }
start_ms = { uniform = [100, 300] }
duration_ms = 100

[[group]]
name = "torque"
[[group.fault]]
site = "torque"
channel = ["shoulder", "elbow"]
effect = "overwrite"
value = [-6.0, 3.0]
start_ms = 150
duration_ms = [1, 100]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The campaign's file."""
    path = tmp_path_factory.mktemp("planar") / "planar.toml"
    path.write_text(FILE)
    return path


@pytest.fixture(scope="module")
def tables(file):
    """Its result table on two engines."""
    return {engine: rj.run(file, engine=engine) for engine in ("simd", "xla")}


def test_two_engines_agree(tables):
    simd, xla = tables["simd"], tables["xla"]
    assert len(simd) == 28 and (simd["run_id"] == xla["run_id"]).all()
    assert simd["verdict"].nunique() > 1  # there is something to disagree on
    for name in ("verdict", "response", "hazard", "check_tracking_first_ms", "applied0_ticks"):
        assert simd[name].tolist() == xla[name].tolist(), name
    for name in (
        "unintended_mm",
        "peak_model_deviation_mm",
        "tip_path_mm",
        "check_tracking_margin",
    ):
        np.testing.assert_allclose(simd[name], xla[name], rtol=1e-4, atol=1e-4, err_msg=name)


def test_pure_functions_compute_the_campaign_in_any_transformation(file, tables):
    """`functional`: vmap and shard_map against two engines and one run alone, grad against finite
    differences.
    """
    model = functional.load(file)
    assert model.targets["torque", "arm", "elbow"] == 4
    mesh, spec = jax.sharding.Mesh(jax.devices(), ("runs",)), jax.sharding.PartitionSpec("runs")
    every = jax.jit(
        jax.shard_map(
            jax.vmap(model.rollout), mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False
        )
    )
    harmless, nothing = jax.tree.map(jnp.zeros_like, model.faults), jnp.zeros((28, 600, 6))
    golden = every(model.params, harmless, nothing).series
    found = every(model.params, model.faults, golden).outcomes
    for name, table in tables.items():
        for column in ("check_tracking_first_ms", "unintended_mm", "active_ticks"):
            np.testing.assert_allclose(
                found[column], table[column], rtol=1e-4, atol=1e-4, err_msg=name
            )

    struck, params = jax.tree.map(lambda leaf: leaf[23], (model.faults, model.params))

    @jax.jit
    @jax.value_and_grad
    def excursion(value):
        slot = replace(struck.slots[0], value=value)
        out = model.rollout(params, replace(struck, slots=(slot,)), golden[23])
        return out.outcomes["unintended_mm"]

    value = struck.slots[0].value
    alone, slope = map(float, excursion(value))
    lower, higher = (float(excursion(value + step)[0]) for step in (-0.1, 0.1))
    assert alone == pytest.approx(float(found["unintended_mm"][23]), rel=1e-5)
    assert slope == pytest.approx((higher - lower) / 0.2, rel=0.02) and abs(slope) > 0.01


def test_faults_strike_when_and_where_they_are_told(tables):
    table = tables["simd"]
    assert table["activated"].all()
    assert (table["first_active_ms"] == table["fault0_start_ms"]).all()
    stopped = table["check_tracking_first_ms"] >= 0
    assert (table["response"].astype(str) == np.where(stopped, "stopped", "silent")).all()
    assert (table.loc[~stopped, "active_ticks"] == table.loc[~stopped, "fault0_duration_ms"]).all()


def tips_mm(row, plan: np.ndarray, struck: bool) -> np.ndarray:
    """Tips by another hand: C MuJoCo in float64, with the motors' law, the check and the brakes."""
    model = mujoco.MjModel.from_xml_path(str(Path(planar_arm.__file__).with_suffix(".xml")))
    data, tips, stopped = mujoco.MjData(model), [], False
    data.qpos[:] = plan[0]
    joint = planar_arm.ROBOT.joints.index(row["fault0_channel"])
    for ms, wanted in enumerate(plan):
        inside = struck and 0 <= ms - row["fault0_start_ms"] < row["fault0_duration_ms"]
        reported = data.qpos.copy()
        if inside and row["fault0_site"] == "encoder":
            reported[joint] += row["fault0_value"]
        stopped = stopped or np.abs(wanted - reported).max() > 0.25
        torque = np.clip(row["param:kp"] * (wanted - reported) - 2.0 * data.qvel, -8, 8)
        if inside and row["fault0_site"] == "torque":
            torque[joint] = row["fault0_value"]
        if stopped:
            data.qvel *= 0.9
            data.qpos += data.qvel * 1e-3
            mujoco.mj_forward(model, data)
        else:
            data.qfrc_applied[:] = torque
            mujoco.mj_step(model, data)
            mujoco.mj_kinematics(model, data)
        tips.append(1e3 * data.site("tip").xpos)
    return np.array(tips)


@pytest.mark.parametrize("index", [0, 7, 20, 23, 27])
def test_the_tip_goes_where_c_mujoco_says(file, tables, index):
    row = tables["simd"].iloc[index]
    plan = rj.simulate(file, index, engine="simd")["jpos_d"].sel(arm="arm").values.astype(float)
    struck, golden = (tips_mm(row, plan, struck) for struck in (True, False))
    moved = np.linalg.norm(struck - golden, axis=1).max()
    assert row["peak_golden_deviation_mm"] == pytest.approx(moved, rel=1e-3, abs=2e-3)


def test_results_are_reported_verified_and_traced(file, tmp_path, capsys):
    out = tmp_path / "result"
    assert main(["run", str(file), "--out", str(out), "--engine", "simd"]) == 0
    page = words(Page((out / "report.html").read_text()))
    assert "planar" in page and "tracking" in page and "s in live motion in total" in page
    assert not re.findall(r"(?i)pedal|tissue|e-stop|surgeon|raven-|\b(?:gold|green)\b", page)
    assert main(["verify", str(out)]) == 0
    capsys.readouterr()
    assert main(["trace", str(out), "--worst", "1"]) == 0
    text = capsys.readouterr().out
    assert "the nominal model" in text and " arm " in text
    (trace,) = (out / "traces").glob("*.csv")
    assert "arm/jpos/elbow [rad]" in trace.read_text().splitlines()[0]
    assert main(["explore", str(file), "--out", str(tmp_path / "page.html")]) == 0


def test_series_have_names_and_units(file):
    run = rj.simulate(file, 3, engine="simd")
    assert tuple(run["jpos"].coords["joint"].values) == planar_arm.ROBOT.joints
    assert run["tip"].attrs["units"] == "m" and run.sizes["time"] == 600


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("campaign.robot=planar_leg", "planar_leg"),
        ("campaign.arms=['gold']", "expected each arm once"),
        ("campaign.policy=hard_regulation", "unknown key"),
        ("group.torque.fault.0.site=usb_out", "expected one of parameter, packet, encoder"),
        ("group.torque.fault.0.channel=wrist", "expected one of shoulder, elbow"),
        ("parameters.kq=3", "unknown parameter"),
        ('group=[{name = "g", hazards = ["C09"]}]', "no hazard library"),
        ('detector=[{name = "d", kind = "tip_error"}]', "only detectors with a file"),
        ("parameters.kp=-1", "expected 0..1000000000 N m/rad"),
    ],
)
def test_what_the_robot_has_not_is_refused(file, override, complaint):
    with pytest.raises(UserError, match=complaint):
        rj.run(rj.load_campaign(file, overrides=[override]), engine="simd")


def test_the_code_and_the_model_of_a_robot_of_ones_own_count(tmp_path, monkeypatch):
    """Results of one version are not continued by another."""
    source, model, beside = (tmp_path / name for name in ("own_arm.py", "arm.xml", "gains.py"))
    text = "import gains\n" + Path(planar_arm.__file__).read_text()
    monkeypatch.syspath_prepend(tmp_path)
    own = dataclasses.replace(planar_arm.ROBOT, package="own_arm", files=("arm.xml",))
    hashes = []
    for kp, mass, kd in ((40, 1.0, 2), (41, 1.0, 2), (41, 1.1, 2), (41, 1.0, 2), (41, 1.0, 3)):
        source.write_text(f"{text}KP = {kp}")
        beside.write_text(f"KD = {kd}")
        model.write_text(f'<mujoco><geom mass="{mass}"/></mujoco>')
        manifest.code_hash.cache_clear()
        hashes.append(manifest.code_hash(own))
    assert len({*hashes, manifest.code_hash()}) == 5 and hashes[1] == hashes[3]
