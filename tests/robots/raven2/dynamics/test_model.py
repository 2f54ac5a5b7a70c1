"""models/raven2/raven2.xml: the DH kinematics of the control software and the dynamics of the
authors.
"""

import math
import re
import subprocess
import sys
from pathlib import Path

import jax
import mujoco
import numpy as np
import pytest
from authors_values import CHECKS, M23, M33

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.geometry import kinematics

ROOT = Path(__file__).resolve().parents[4]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return arm_model.operating_scene()


def own(arm) -> slice:
    first = 7 * ARMS.index(arm)
    return slice(first, first + 7)


def test_joints_are_those_of_the_control_software(model):
    names = tuple(model.joint(i).name for i in range(model.njnt))
    assert names == tuple(f"{arm}_{joint}" for arm in ARMS for joint in JOINTS)
    assert (model.nq, model.nv) == (14, 14)
    degrees = [(0, 90), (45, 135), None, (-182, 182), (-70, 70), (-105, 105), (-105, 105)]
    for arm in ARMS:
        for low_high, span in zip(degrees, model.jnt_range[own(arm)], strict=True):
            np.testing.assert_allclose(
                span, np.radians(low_high) if low_high else (0.23, 0.56), rtol=1e-12
            )
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()


@pytest.mark.parametrize("arm", ARMS)
def test_tip_site_is_dh_frame_6(model, arm):
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(30):
        data.qpos[:] = rng.uniform(*model.jnt_range.T)
        mujoco.mj_kinematics(model, data)
        base, tip = data.body(f"{arm}_frame0"), data.site(f"{arm}_tip")
        to_base = base.xmat.reshape(3, 3).T
        qpos = data.qpos[own(arm)]
        yaw = (qpos[6] - qpos[5]) / 2
        turn = np.array(
            [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
        )
        with jax.enable_x64(True):
            pose = kinematics.forward_pose(arm, Vec(np.float64(x) for x in qpos))
        np.testing.assert_allclose(
            to_base @ (tip.xpos - base.xpos), np.array(pose.position), atol=1e-9
        )
        np.testing.assert_allclose(
            to_base @ tip.xmat.reshape(3, 3) @ turn, np.array(pose.rotation), atol=1e-9
        )


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("offset_deg", [155, 180])
def test_first_three_joints_are_the_authors(model, arm, check, offset_deg):
    """M, gravity and bias of joints 1-3, tool at rest in its reference pose, both arms.

    The authors' q1 is the DH angle theta1 = jpos - 155 deg under gravity along -x0, or (their
    reading of the same formulas) jpos - 180 deg with gravity turned by 25 deg about z0. M and the
    velocity terms do not tell the two apart.
    """
    q, rate, (m11, m12, m13, m22), gravity_torque, bias = check
    data = mujoco.MjData(model)
    base = data.body(f"{arm}_frame0")
    data.qpos[:] = model.key_qpos[0]
    data.qpos[own(arm)][:3] = q[0] + math.radians(offset_deg), q[1] + math.pi, q[2]
    turn = math.radians(offset_deg - 155) * (1 if arm == "gold" else -1)
    mujoco.mj_kinematics(model, data)
    down = base.xmat.reshape(3, 3) @ (-9.81 * np.array([math.cos(turn), math.sin(turn), 0.0]))
    before = model.opt.gravity.copy()
    model.opt.gravity[:] = down
    try:
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_bias[own(arm)][:3], gravity_torque, atol=1e-6)
        data.qvel[own(arm)][:3] = rate
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_bias[own(arm)][:3], bias, atol=1e-6)
    finally:
        model.opt.gravity[:] = before
    mass = np.zeros((14, 14))
    mujoco.mj_fullM(model, data, mass)
    expected = [[m11, m12, m13], [m12, m22, M23], [m13, M23, M33]]
    np.testing.assert_allclose(mass[own(arm), own(arm)][:3, :3], expected, atol=1e-6)


NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")


def test_committed_files_are_what_the_builder_writes(tmp_path):
    """Text to the letter, numbers to rounding (another machine may differ in a last digit)."""
    builder = ROOT / "analysis" / "looks" / "build.py"
    subprocess.run([sys.executable, str(builder), str(tmp_path)], check=True, capture_output=True)
    for fresh in sorted(tmp_path.rglob("*.*")):
        committed = ROOT / "models" / "raven2" / fresh.relative_to(tmp_path)
        old, new = committed.read_text(encoding="utf-8"), fresh.read_text(encoding="utf-8")
        assert NUMBER.sub("#", old) == NUMBER.sub("#", new), (
            f"{committed} differs: run python {builder}"
        )
        numbers = [np.array(NUMBER.findall(text), dtype=float) for text in (old, new)]
        np.testing.assert_allclose(
            *numbers, rtol=1e-9, atol=1.1e-5 if fresh.suffix == ".obj" else 1e-12
        )
