"""A robot that the package does not know runs like the Raven-II: campaign, report, verify and
trace, on two engines.
"""

import dataclasses
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import planar_arm
import pytest
from rendered_page import Page, words

import ravenjax as rj
from ravenjax import functional
from ravenjax.cli import main
from ravenjax.errors import UserError
from ravenjax.store import manifest

FILE = """
[campaign]
name = "planar"
robot = "planar_arm"
duration_s = 0.6
seed = 3

[parameters]
kp = { uniform = [30, 50] }

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


def test_engine_mjx_refuses_it(file):
    with pytest.raises(UserError, match="moves the links of the Raven-II only"):
        rj.run(file, engine="mjx")


def test_two_engines_agree(tables):
    simd, xla = tables["simd"], tables["xla"]
    assert len(simd) == 28 and (simd["run_id"] == xla["run_id"]).all()
    assert simd["verdict"].nunique() > 1  # there is something to disagree on
    for name in ("verdict", "response", "hazard", "check_torque_limit_first_ms", "applied0_ticks"):
        assert simd[name].tolist() == xla[name].tolist(), name
    for name in (
        "unintended_mm",
        "peak_model_deviation_mm",
        "tip_path_mm",
        "check_torque_limit_margin",
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
        for column in ("check_torque_limit_first_ms", "unintended_mm", "active_ticks"):
            np.testing.assert_allclose(
                found[column], table[column], rtol=1e-4, atol=1e-4, err_msg=name
            )

    struck = jax.tree.map(lambda leaf: leaf[25], model.faults)

    @jax.jit
    @jax.value_and_grad
    def excursion(kp):
        out = model.rollout({"kp": kp}, struck, golden[25])
        return out.outcomes["unintended_mm"]

    kp = model.params["kp"][25]
    alone, slope = map(float, excursion(kp))
    lower, higher = (float(excursion(kp + step)[0]) for step in (-1, 1))
    assert alone == pytest.approx(float(found["unintended_mm"][25]), rel=1e-5)
    assert slope == pytest.approx((higher - lower) / 2, rel=0.02) and abs(slope) > 0.01


def test_faults_strike_when_and_where_they_are_told(tables):
    table = tables["simd"]
    assert table["activated"].all()
    assert (table["first_active_ms"] == table["fault0_start_ms"]).all()
    stopped = table["check_torque_limit_first_ms"] >= 0
    assert (table["response"].astype(str) == np.where(stopped, "stopped", "silent")).all()
    assert (table.loc[~stopped, "active_ticks"] == table.loc[~stopped, "fault0_duration_ms"]).all()


def moved_mm(row) -> float:
    """How far the tip leaves that of the golden run, by another hand: the arm in float64, whose
    check stops it.
    """

    def tips(struck: bool) -> np.ndarray:
        jpos, jvel, tips, stopped = np.array([0.0, 1.0]), np.zeros(2), [], False
        for ms in range(600):
            wanted = (
                np.float32(0.4 * np.sin(ms / 1e3)),
                np.float32(1.0 + 0.3 * np.sin(2 * ms / 1e3)),
            )
            inside = (
                struck
                and row["fault0_start_ms"]
                <= ms
                < row["fault0_start_ms"] + row["fault0_duration_ms"]
            )
            joint, value = planar_arm.JOINTS.index(row["fault0_channel"]), row["fault0_value"]
            reported = jpos.copy()
            if inside and row["fault0_site"] == "encoder":
                reported[joint] += value
            torque = row["param:kp"] * (np.array(wanted) - reported) - 2.0 * jvel
            stopped = stopped or np.abs(torque).max() > 8.0
            driven = np.zeros(2) if stopped else torque.copy()
            if inside and row["fault0_site"] == "torque":
                driven[joint] = value
            jvel = (0.9 * jvel if stopped else jvel) + driven * 1e-3 / 0.05
            jpos = jpos + jvel * 1e-3
            a, b = jpos[0], jpos.sum()
            tips.append(300 * np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)]))
        return np.array(tips)

    return np.linalg.norm(tips(True) - tips(False), axis=1).max()


@pytest.mark.parametrize("index", [0, 7, 20, 23, 27])
def test_the_tip_goes_where_the_equations_say(tables, index):
    row = tables["simd"].iloc[index]
    assert row["peak_golden_deviation_mm"] == pytest.approx(moved_mm(row), rel=1e-3, abs=1e-3)


def test_results_are_reported_verified_and_traced(file, tmp_path, capsys):
    out = tmp_path / "result"
    assert main(["run", str(file), "--out", str(out), "--engine", "simd"]) == 0
    page = words(Page((out / "report.html").read_text()))
    assert "planar" in page and "torque_limit" in page and "s in live motion in total" in page
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
    assert list(run["jpos"].coords["joint"].values) == list(planar_arm.JOINTS)
    assert run["tip"].attrs["units"] == "m" and run.sizes["time"] == 600


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("campaign.robot=planar_leg", "planar_leg"),
        ("campaign.arms=['gold']", "expected each arm once"),
        ("campaign.policy=hard_regulation", "unknown key"),
        ("group.torque.fault.0.site=usb_out", "expected one of encoder, torque"),
        ("group.torque.fault.0.channel=wrist", "expected one of shoulder, elbow"),
        ("parameters.kq=3", "unknown parameter"),
        ('detector=[{name = "d", kind = "tip_error"}]', "runs no detectors"),
        ("parameters.kp=-1", "expected 0..1000 N m/rad"),
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
        source.write_text(text.replace("Params(40.0", f"Params({kp}"))
        beside.write_text(f"KD = {kd}")
        model.write_text(f'<mujoco><geom mass="{mass}"/></mujoco>')
        manifest.code_hash.cache_clear()
        hashes.append(manifest.code_hash(own))
    assert len({*hashes, manifest.code_hash()}) == 5 and hashes[1] == hashes[3]
