"""Forward kinematics, geometric Jacobian and tip velocity of one arm; re-exports the inverse from
`inverse`.

All results are in frame 0 of the arm, m and rad, in the floating-point type of the input. Source:
raven2 `src/raven/r2_kinematics.cpp`. The Jacobian is the geometric one of the same chain, because
the original's own (`r2_jacobian.cpp`) has placeholder lengths.
"""

from __future__ import annotations

from typing import NamedTuple

from ravenjax.numbers.algebra import cross
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.geometry.inverse import (
    AT_REMOTE_CENTRE,
    IK,
    OK,
    REJECTED,
    inverse,
    inverse_candidates,
)
from ravenjax.robots.raven2.geometry.joints import Pose, yaw
from ravenjax.robots.raven2.geometry.links import D4, GEOMETRY, GM1, GM2, GM3, LW

__all__ = [
    "AT_REMOTE_CENTRE",
    "IK",
    "OK",
    "REJECTED",
    "ChainAxes",
    "Pose",
    "chain_of",
    "forward",
    "inverse",
    "inverse_candidates",
    "jacobian",
    "tip_velocity",
]


class ChainAxes(NamedTuple):
    """Axes of the DH frames in frame 0; z1 is (0, 0, flip), z4 is z3."""

    z2: Vec
    z3: Vec
    x4: Vec
    y4: Vec
    x5: Vec
    y5: Vec
    c5: Scalar  # cos(theta5)
    tip: Vec  # m, origin of frame 6


def chain_of(arm: str, jpos: Vec) -> ChainAxes:
    """Return the axes of the chain at `jpos` (7, rad and m)."""
    geometry = GEOMETRY[arm]
    cos23, side, flip = geometry.cos23, geometry.side, geometry.flip
    theta1 = jpos[0] + geometry.zero1
    c1, s1 = jnp.cos(theta1), jnp.sin(theta1)
    c2, s2 = jnp.cos(jpos[1]), jnp.sin(jpos[1])
    if geometry.zero2:  # half a turn
        c2, s2 = -c2, -s2
    c4, s4 = jnp.cos(jpos[3]), jnp.sin(jpos[3])
    c5, s5 = jnp.sin(jpos[4]), -jnp.cos(jpos[4])  # theta5 = wrist - 90 deg

    def from_frame1(x: Scalar, y: Scalar, z: Scalar) -> Vec:
        along, across = c1 * x - s1 * y, s1 * x + c1 * y
        return Vec((along, across, z)) if flip > 0 else Vec((along, -across, -z))

    def signed(x: Scalar) -> Scalar:
        return x if side > 0 else -x

    z2 = Vec((GM1 * s1, -GM1 * c1, GM2)) if flip > 0 else Vec((GM1 * s1, GM1 * c1, -GM2))
    z3 = from_frame1(GM3 * s2, -GM2 * GM3 * c2 - GM1 * cos23, -GM1 * GM3 * c2 + GM2 * cos23)
    x3 = from_frame1(
        *map(signed, (-cos23 * s2, GM2 * cos23 * c2 - GM1 * GM3, GM1 * cos23 * c2 + GM2 * GM3))
    )
    y3 = from_frame1(*map(signed, (-c2, -GM2 * s2, -GM1 * s2)))
    x4, y4 = x3 * c4 + y3 * s4, y3 * c4 - x3 * s4
    x5, y5 = x4 * c5 + z3 * s5, z3 * c5 - x4 * s5
    return ChainAxes(z2, z3, x4, y4, x5, y5, c5, z3 * (jpos[2] + D4) + x5 * LW)


def forward(arm: str, jpos: Vec, yaw_rad: Scalar = None) -> Pose:
    """Return the pose of the jaw axis at `jpos` (7, rad and m).

    The jaws matter only by their yaw. It is (grasp2 - grasp1) / 2 unless `yaw_rad` (rad) is given,
    as the original rounds it to float32.
    """
    chain = chain_of(arm, jpos)
    theta6 = yaw(jpos) if yaw_rad is None else yaw_rad
    c6, s6 = jnp.cos(theta6), jnp.sin(theta6)
    x6 = chain.x5 * c6 - chain.y4 * s6
    y6 = -(chain.x5 * s6 + chain.y4 * c6)
    z6 = -chain.y5
    return Pose(chain.tip, Vec(Vec(row) for row in zip(x6, y6, z6, strict=True)))


def jacobian(arm: str, jpos: Vec) -> Vec:
    """Return the geometric Jacobian of frame 6.

    Rows: vx, vy, vz (m/s), wx, wy, wz (rad/s). Columns: theta1, theta2, d3, theta4, theta5, theta6.
    """
    chain = chain_of(arm, jpos)
    z1, z5, still = Vec((0.0, 0.0, GEOMETRY[arm].flip)), -chain.y4, Vec.full(3, 0.0)
    columns = (
        (*cross(z1, chain.tip), *z1),
        (*cross(chain.z2, chain.tip), *chain.z2),
        (*chain.z3, *still),
        (*(chain.y4 * (LW * chain.c5)), *chain.z3),
        (*(chain.y5 * LW), *z5),
        (*still, *-chain.y5),
    )
    return Vec(Vec(row) for row in zip(*columns, strict=True))


def tip_velocity(arm: str, jpos: Vec, jvel: Vec) -> Vec:
    """Return the velocity of the jaw axis, m/s, at joint velocities `jvel` (7, rad/s and m/s).

    The jaws only turn about this axis, so they do not matter.
    """
    chain = chain_of(arm, jpos)
    shoulder = jvel[0] if GEOMETRY[arm].flip > 0 else -jvel[0]
    turning = chain.z2 * jvel[1]
    turning = turning.replace(2, turning[2] + shoulder)
    at_wrist = chain.y4 * (chain.c5 * jvel[3]) + chain.y5 * jvel[4]
    return cross(turning, chain.tip) + chain.z3 * jvel[2] + at_wrist * LW
