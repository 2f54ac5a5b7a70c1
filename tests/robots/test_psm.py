"""Kinematics of the dVRK PSM and of the iiwa 14 against DH tables, and of the PSM against the
geometry of a remote centre; its campaign.
"""

import mujoco
import numpy as np
import snippets
from scipy.spatial.transform import Rotation

import ravenjax as rj
from ravenjax import resources
from ravenjax.campaign import notices

# Modified DH, degrees and m: alpha, a, theta, d (sawIntuitiveResearchKit, share/kinematic/psm.json
# and share/tool/LARGE_NEEDLE_DRIVER_400006.json).
DH = [(90, 0, 90, 0), (-90, 0, -90, 0), (90, 0, 0, -0.4318)]
DH += [(0, 0, 0, 0.4162), (-90, 0, -90, 0), (-90, 0.0091, -90, 0)]
TOOLTIP_OFFSET = [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]


def test_its_kinematics():
    model = mujoco.MjModel.from_xml_path(str(resources.find_model("psm/psm.xml")))
    data = mujoco.MjData(model)
    for qpos in np.random.default_rng(5).uniform(*model.jnt_range.T, (20, model.nq)):
        turn, tip = Rotation.identity(), np.zeros(3)
        for joint, (alpha, a, theta, d) in enumerate(DH):
            angle, slide = (0.0, qpos[joint]) if joint == 2 else (qpos[joint], 0.0)
            tip = tip + turn.apply([a, 0, 0])
            turn = turn * Rotation.from_euler("x", alpha, degrees=True)
            tip = tip + turn.apply([0, 0, d + slide])
            turn = turn * Rotation.from_euler("z", np.radians(theta) + angle)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        found, axes = data.site("tip").xpos, data.site("tip").xmat.reshape(3, 3)
        np.testing.assert_allclose(found, tip, rtol=0, atol=1e-12)
        np.testing.assert_allclose(axes, turn.as_matrix() @ TOOLTIP_OFFSET, rtol=0, atol=1e-12)

        yaw, pitch, insertion, roll, bend, _ = qpos
        level = np.cos(yaw), 0.0, np.sin(yaw)
        shaft = -np.sin(pitch) * np.eye(3)[1] + np.cos(pitch) * np.cross((0, 1, 0), level)
        side = np.cos(roll) * np.cross(shaft, level) - np.sin(roll) * np.array(level)
        along = insertion + 0.4162 - 0.4318 + 0.0091 * np.cos(bend)
        tip = along * shaft + 0.0091 * np.sin(bend) * side
        np.testing.assert_allclose(found, tip, rtol=0, atol=1e-12)


def test_the_kinematics_of_the_iiwa_are_those_of_its_dh_table():
    model = mujoco.MjModel.from_xml_path(str(resources.find_model("iiwa14/iiwa14.xml")))
    data, turn, tip = mujoco.MjData(model), Rotation.identity(), np.zeros(3)
    data.qpos[:] = qpos = np.random.default_rng(2).uniform(*model.jnt_range.T)
    rows = (-90, 0.36), (90, 0), (90, 0.42), (-90, 0), (-90, 0.4), (90, 0), (0, 0.126)
    for angle, (alpha, d) in zip(qpos, rows, strict=True):
        turn = turn * Rotation.from_euler("z", angle)
        tip, turn = tip + turn.apply([0, 0, d]), turn * Rotation.from_euler("x", np.radians(alpha))
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("tip").xpos, tip, rtol=0, atol=1e-12)


def test_one_limit_of_rotating_and_sliding_joints_is_noticed():
    file = snippets.ROOT / "analysis/psm/psm.toml"
    config = rj.load_campaign(file, ["parameters.sensor=0.2", "parameters.velocity.insertion=1"])
    assert config.robot.linear == ("insertion",)
    mixed = [notice for notice in notices.of_config(config) if "such as" in notice]
    assert [notice.partition(":")[0] for notice in mixed] == ["parameters.sensor"]
