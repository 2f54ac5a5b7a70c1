"""The point where jaws close: that of the software's kinematics, and of the jaws that are drawn."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from made_frames import running

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.geometry import instrument, kinematics
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.robots.raven2.geometry.instrument import JAW_LENGTH
from ravenjax.train.protocol import jaws


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_closed_jaws_point_where_the_kinematics_has_them(arm):
    for jpos in np.random.default_rng(1).uniform(-2.0, 2.0, (50, 7)):
        np.testing.assert_allclose(
            jaws.along(arm, jpos.tolist()), jaw_rotation(arm, jpos)[:, 0], atol=1e-12
        )


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_the_drawn_jaws_end_there(arm):
    model = arm_model.scene()
    data = mujoco.MjData(model)
    jpos = np.array([0.5, 1.6, 0.4, 0.3, -0.2, 0.1, -0.1])  # closed, turned aside
    data.qpos[[int(model.joint(name).qposadr[0]) for name in arm_model.joint_names(arm)]] = jpos
    mujoco.mj_kinematics(model, data)
    base = model.body(arm_model.base(arm)).id
    turn = data.xmat[base].reshape(3, 3)
    for jaw in ("grasp1", "grasp2"):
        geom = next(
            g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(f"{arm}_{jaw}").id
        )
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = (
            data.geom_xpos[geom]
            + model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T
        )
        axis = turn.T @ (data.site(f"{arm}_tip").xpos - data.xpos[base])
        end = jaws.closing_point(arm, axis.tolist(), jpos.tolist())
        away = np.linalg.norm((points - data.xpos[base]) @ turn - end, axis=1)
        assert away.min() < 0.001, jaw


def test_what_is_drawn_has_its_tips_there_and_the_frame_itself_is_as_it_was():
    frame = running()
    before = frame.row.copy()
    drawn = jaws.with_tips(frame.layout, frame.row)
    assert np.array_equal(frame.row, before)
    place = frame.layout.places["gold/tip"]
    assert np.linalg.norm(drawn[place] - frame.row[place]) == pytest.approx(JAW_LENGTH, rel=1e-5)
    for name in ("tip", "virtual_tip", "model_tip"):
        drawn[frame.layout.places[f"gold/{name}"]] = before[frame.layout.places[f"gold/{name}"]]
    assert np.array_equal(drawn, before), "nothing else is changed"


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_each_jaw_ends_where_contact_has_its_tip(arm):
    for jpos in np.random.default_rng(2).uniform(-1.0, 1.0, (5, 7)):
        tips = instrument.jaw_tips(arm, Vec(jpos.tolist()))
        axis = kinematics.forward(arm, Vec(jpos.tolist())).position
        closing = jaws.closing_point(arm, [float(x) for x in axis], jpos.tolist())
        found = jaws.jaw_tips(arm, closing, jpos.tolist())
        expected = [[float(x) for x in tip.at] for tip in tips]
        np.testing.assert_allclose(found, expected, atol=1e-6)  # single precision
