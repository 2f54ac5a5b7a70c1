"""The control software's gravity compensation: torques that hold shoulder, elbow and insertion.

Source: raven2 `src/raven/grav_comp.cpp`, `include/raven/grav_comp.h`. Masses and centres of mass
are those that the control software assumes. They differ from those of the virtual robot. The
centre of mass of link 3 is the origin of its frame, which depends on d3.
"""

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, jnp
from ravenjax.robots.raven2.geometry.joints import GEOMETRY, GM1, GM2, GM3
from ravenjax.robots.raven2.geometry.transmission import JOINT_PER_CAPSTAN_TORQUE

GRAVITY = 9.8  # m/s^2 along -x of frame 0, both arms
# m/s^2, the float32 that the original stores
GRAVITY_AS_STORED = 9.800000190734863
MASSES = (0.494, 0.750, 0.231)  # kg, links 1 to 3

CENTRES = {
    arm: tuple(map(Vec, links))
    for arm, links in resources.read_tables(__file__, "gravity.toml").items()
}
"""Centres of mass of link 1 in frame 1 and of link 2 in frame 2, in the control software, m."""


def joint_gravity_torque(arm: str, jpos: Vec, gravity: Scalar = GRAVITY) -> Vec:
    """Return the torques (Nm, Nm, N) of joints 1-3 that balance gravity (m/s^2 along -x)."""
    geometry, (link1, link2) = GEOMETRY[arm], CENTRES[arm]
    theta1 = jpos[0] + geometry.zero1
    c1, s1 = jnp.cos(theta1), jnp.sin(theta1)
    c2, s2 = jnp.cos(jpos[1]), jnp.sin(jpos[1])
    if geometry.zero2:  # theta2 differs from the elbow by half a turn
        c2, s2 = -c2, -s2
    # Sines and cosines of the twists, the angles between axes 1 and 2, and between axes 2 and 3
    sin12, cos12, sin23, cos23 = GM1, GM2, GM3, geometry.cos23
    gx, gy = -gravity * c1, gravity * s1  # gravity in frame 1; its z component is zero
    tilted_gy = cos12 * gy  # after the rotation about x by the twist of link 1
    hx, hy, hz = c2 * gx + s2 * tilted_gy, c2 * tilted_gy - s2 * gx, -sin12 * gy  # gravity, frame 2
    m1, m2, m3 = MASSES
    # First moments (kg m): of links 2 and 3 in frame 2, then of all links in frame 1.
    x2 = m2 * link2[0]
    y2 = m2 * link2[1] - m3 * sin23 * jpos[2]
    z2 = m2 * link2[2] + m3 * cos23 * jpos[2]
    x1 = m1 * link1[0] + c2 * x2 - s2 * y2
    y1 = m1 * link1[1] + cos12 * (s2 * x2 + c2 * y2) - sin12 * z2
    # A torque balances the z component of moment x gravity. The force of joint 3 balances the
    # weight of link 3 along z3, which is (0, -sin23, cos23) in frame 2.
    return Vec((y1 * gx - x1 * gy, y2 * hx - x2 * hy, m3 * (sin23 * hy - cos23 * hz)))


def gravity_torque(arm: str, jpos: Vec, gravity: Scalar = GRAVITY) -> Vec:
    """Return tau_g: capstan torques (3, Nm) that balance gravity, without cable coupling."""
    per_capstan = Vec(1.0 / ratio for ratio in JOINT_PER_CAPSTAN_TORQUE[:3])
    return joint_gravity_torque(arm, jpos, gravity) * per_capstan
