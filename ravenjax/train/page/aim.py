"""Where the control software wants the jaws to close: the first to follow the hand, before the
robot does.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.train.protocol.jaws import closing_point


class Aim:
    """Forward kinematics of one arm, by the model's own tip site."""

    def __init__(self, arm: ArmName) -> None:
        self._model = arm_model.one_arm(arm)
        self._data = mujoco.MjData(self._model)
        self._arm: ArmName = arm
        self._site = self._model.site(f"{arm}_tip").id
        base = self._model.body(arm_model.base(arm))
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, base.quat)
        self._origin, self._turn = base.pos.copy(), turn.reshape(3, 3)

    def tip(self, jpos: np.ndarray) -> np.ndarray:
        """[3] m, in the arm's frame 0, of joints [7] in rad and m."""
        self._data.qpos[:] = jpos
        mujoco.mj_kinematics(self._model, self._data)
        axis = (self._data.site_xpos[self._site] - self._origin) @ self._turn
        return np.array(closing_point(self._arm, axis.tolist(), jpos.tolist()))
