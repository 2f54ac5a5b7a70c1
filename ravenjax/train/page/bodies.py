"""Which bodies of the MuJoCo model are drawn, and with which geoms."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from ravenjax.robots.raven2.arms import ArmName


def fixed(model: mujoco.MjModel) -> list[int]:
    """Bodies that never move: welded to the world."""
    return np.flatnonzero(model.body_weldid == 0).tolist()


def moving(model: mujoco.MjModel, arm: ArmName) -> list[int]:
    """Moving links of an arm."""
    links = np.flatnonzero(model.body_weldid != 0).tolist()
    return [body for body in links if model.body(body).name.startswith(f"{arm}_")]


def geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms of a body; the unbounded floor is left out."""
    own = np.flatnonzero(model.geom_bodyid == body).tolist()
    return [geom for geom in own if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE]


def names(model: mujoco.MjModel, bodies: list[int]) -> Iterator[tuple[int, str]]:
    """Each body with its name, those without shapes left out."""
    for body in bodies:
        if geoms(model, body):
            yield body, model.body(body).name
