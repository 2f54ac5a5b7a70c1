"""Parts of an instrument that can touch something: two jaw tips, shaft, wrist and jaws.

All vectors are in frame 0 of the arm, m and rad. The axes are those of `kinematics`, without
kinematic errors. The columns of a Jacobian belong to the joints of `arms.JOINTS`. Entries that are
zero at every pose are Python numbers, so they cost no operation.
"""

from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, jnp
from ravenjax.numbers.algebra import add, cross, dot, mul, scale
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.joints import D4, GEOMETRY, LW, jaw_yaw

# m, jaw axis to jaw tip; models/raven2 PROVENANCE.md: "steel jaw of about 20 mm"
JAW_LENGTH = 0.020
SHAFT_RADIUS = 0.00425  # m; PROVENANCE.md: 8.5 mm thick
# m, radius of wrist and jaws: about half the width of the drawn ones
JAW_RADIUS = 0.003
_NO_MOTION = Vec.full(3, 0.0)


class InstrumentPoint(NamedTuple):
    """A point of an instrument, and its Jacobian."""

    position: Vec  # 3, m
    columns: tuple[Vec, ...]  # 7 of 3: velocity of the point (m/s) per unit speed of each joint

    def velocity(self, jvel: Vec) -> Vec:
        """Return the velocity in m/s at joint velocities (7, rad/s and m/s)."""
        velocity = _NO_MOTION
        # v=speed binds the speed of this column
        for column, speed in zip(self.columns, jvel, strict=True):
            velocity = velocity.map(lambda total, x, v=speed: add(total, mul(x, v)), column)
        return velocity

    def project_on_joints(self, vector: Vec) -> Vec:
        """Return J^T `vector` (7): for a force on the point (N), its torques at the joints (Nm, N);
        for a direction, the speed of the point along it per unit speed of each joint.
        """
        return Vec(dot(column, vector) for column in self.columns)


class InstrumentLine(NamedTuple):
    """An instrument as two straight pieces: remote centre to wrist, wrist to tip of closed jaws."""

    chain: kinematics.ChainAxes
    wrist: Vec  # m
    end: Vec  # m, tip of the closed jaws
    end_per_yaw: Vec  # m/rad, motion of the end per yaw of the jaws


def jaw_tips(arm: str, jpos: Vec) -> tuple[InstrumentPoint, InstrumentPoint]:
    """Return the tips of jaw 1 and jaw 2 at `jpos` (7, rad and m)."""
    chain = kinematics.chain_axes(arm, jpos)
    # Indices of joints begin at 0: 5 is grasp1, 6 is grasp2. Jaw 1 rotates about the z axis of
    # Denavit-Hartenberg frame 6 by -grasp1, jaw 2 by grasp2
    first = _jaw_tip(arm, chain, jpos[5], sign=-1.0, joint=5)
    return first, _jaw_tip(arm, chain, jpos[6], sign=1.0, joint=6)


def instrument_line(arm: str, jpos: Vec) -> InstrumentLine:
    """Return the instrument at `jpos` (7, rad and m) as a line of two straight pieces."""
    chain = kinematics.chain_axes(arm, jpos)
    to_end, end_per_yaw = _jaw_vector(chain, jaw_yaw(jpos))
    return InstrumentLine(chain, chain.z3 * (jpos[2] + D4), chain.tip + to_end, end_per_yaw)


def line_point(arm: str, line: InstrumentLine, position: Vec, share: Scalar) -> InstrumentPoint:
    """Return the point of an instrument at `position` (m), with its Jacobian. share: distance of
    the point from the wrist, as a share of the piece from wrist to end; 0 for a point on the shaft.
    """
    from_wrist = (line.end - line.wrist) * share
    # The yaw is (grasp2 - grasp1) / 2, so the columns of grasp1 and grasp2 are opposite
    jaw_motion = line.end_per_yaw * (share * 0.5)
    columns = _positioning_columns(arm, line.chain, position, from_wrist)
    return InstrumentPoint(position, (*columns, -jaw_motion, jaw_motion))


def _jaw_tip(
    arm: str, chain: kinematics.ChainAxes, angle: Scalar, sign: float, joint: int
) -> InstrumentPoint:
    # Returns the tip of a jaw. angle, joint: position of the jaw's joint, and its index from 0 (5:
    # grasp1, 6: grasp2). sign: direction in which the joint rotates the jaw about z6.
    to_tip, tip_per_angle = _jaw_vector(chain, mul(sign, angle))
    position = chain.tip + to_tip
    jaw_motion = scale(sign, tip_per_angle)
    jaws = (jaw_motion, _NO_MOTION) if joint == 5 else (_NO_MOTION, jaw_motion)
    columns = _positioning_columns(arm, chain, position, chain.x5 * LW + to_tip)
    return InstrumentPoint(position, (*columns, *jaws))


def _jaw_vector(chain: kinematics.ChainAxes, angle: Scalar) -> tuple[Vec, Vec]:
    """Return the vector from jaw axis to jaw tip at `angle` (rad), m, and its derivative, m/rad."""
    # x5 cos(angle) - y4 sin(angle) is x6, the direction of a jaw at this angle
    c, s = jnp.cos(angle) * JAW_LENGTH, jnp.sin(angle) * JAW_LENGTH
    return chain.x5 * c - chain.y4 * s, -(chain.x5 * s + chain.y4 * c)


def _positioning_columns(
    arm: str, chain: kinematics.ChainAxes, position: Vec, from_wrist: Vec
) -> tuple[Vec, ...]:
    """Return the Jacobian's columns of joints 1-5. from_wrist: vector from wrist to point, m."""
    flip = GEOMETRY[arm].flip
    # Cross products of axis and lever. The axes of joints 1 to 5 are (0, 0, flip), z2, z3, z3 and
    # -y4. Joint 3 moves along its axis
    return (
        Vec((mul(-flip, position[1]), mul(flip, position[0]), 0.0)),
        cross(chain.z2, position),
        chain.z3,
        cross(chain.z3, from_wrist),
        cross(from_wrist, chain.y4),
    )
