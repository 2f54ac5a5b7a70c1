"""The page's own kinematics against MuJoCo's, in node; and the shapes it draws against the
model's.
"""

import base64
import json
import shutil
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.campaign import figure
from ravenjax.robots.raven2.dynamics import arm_model, body_shapes

ROOT = Path(__file__).resolve().parents[3]
NODE = shutil.which("node")
SCRIPT = """
import { load } from "./tests/browser_scripts.mjs";
const { places } = await load("ravenjax/analyses/explorer/static/figure.js");
let text = "";
for await (const part of process.stdin) text += part;
const { bodies, positions } = JSON.parse(text);
console.log(JSON.stringify(places(bodies, positions).map((place) => Array.from(place))));
"""


@pytest.fixture(scope="module")
def description():
    return figure.describe_figure()


@pytest.mark.skipif(NODE is None, reason="no node on the path (apt-get install nodejs)")
def test_bodies_stand_where_mujoco_puts_them(description):
    model = arm_model.operating_scene()
    data = mujoco.MjData(model)
    random = np.random.default_rng(4)
    positions = {arm: random.uniform(-0.6, 0.9, 7).tolist() for arm in ARMS}
    data.qpos[:] = model.key("home").qpos
    for arm in ARMS:
        for name, value in zip(arm_model.joint_names(arm), positions[arm], strict=True):
            data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    told = subprocess.run(
        [str(NODE), "--input-type=module", "-e", SCRIPT],
        input=json.dumps({"bodies": description["bodies"], "positions": positions}),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    places = np.array(json.loads(told.stdout)).reshape(-1, 4, 4).transpose(0, 2, 1)
    assert len(places) == model.nbody
    np.testing.assert_allclose(places[:, :3, 3], data.xpos, atol=1e-9)
    np.testing.assert_allclose(places[:, :3, :3], data.xmat.reshape(-1, 3, 3), atol=1e-9)


def test_corners_of_shapes_are_the_models_to_20_um(description):
    model = arm_model.operating_scene()
    for body, told in enumerate(description["bodies"]):
        groups = body_shapes.group_geoms(model, body)
        assert len(told["meshes"]) == len(groups)
        for mesh, geoms in zip(told["meshes"], groups, strict=True):
            whole = body_shapes.merged_mesh(model, geoms)
            words = np.frombuffer(base64.b64decode(mesh["corners"]), "<u2").reshape(-1, 3)
            corners = np.array(mesh["low"]) + np.array(mesh["size"]) * words / figure.STEPS
            np.testing.assert_allclose(corners.min(axis=0), whole.vertices.min(axis=0), atol=2e-5)
            np.testing.assert_allclose(corners.max(axis=0), whole.vertices.max(axis=0), atol=2e-5)
            faces = np.frombuffer(base64.b64decode(mesh["faces"]), "<u2").reshape(-1, 3)
            assert faces.max() < len(corners)
            area = np.linalg.norm(
                np.cross(*(corners[faces[:, k]] - corners[faces[:, 0]] for k in (1, 2))), axis=1
            )
            assert area.sum() / 2 == pytest.approx(whole.area, rel=1e-3)
