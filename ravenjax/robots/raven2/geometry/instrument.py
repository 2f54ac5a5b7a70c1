"""Parts of an instrument that can touch something: two jaw tips, shaft, wrist and jaws.

Frame 0 of the arm, m and rad. The axes are those of `kinematics`, so no link has a kinematic error.
Columns of a Jacobian are the seven joints of `arms.JOINTS`; structural zeros are Python numbers.
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

_STILL = Vec.full(3, 0.0)


class InstrumentPoint(NamedTuple):
    """A point of an instrument, and its Jacobian."""

    at: Vec  # 3, m
    columns: tuple[Vec, ...]  # 7 of 3: velocity of the point (m/s) per unit speed of each joint

    def velocity(self, jvel: Vec) -> Vec:
        """Return the velocity in m/s at joint velocities (7, rad/s and m/s)."""
        total = _STILL
        for column, speed in zip(self.columns, jvel, strict=True):
            total = total.map(lambda so_far, x, v=speed: add(so_far, mul(x, v)), column)
        return total

    def along(self, way: Vec) -> Vec:
        """Return J^T way (7): the joint torques (N m, N) that balance a force `way` (N).

        If `way` is a direction, these are the speeds of the point along it per unit joint speed.
        """
        return Vec(dot(column, way) for column in self.columns)


class InstrumentLine(NamedTuple):
    """An instrument as two straight pieces: remote centre to wrist, wrist to tip of closed jaws."""

    chain: kinematics.ChainAxes
    wrist: Vec  # m
    end: Vec  # m, point where the jaws close
    turn: Vec  # m/rad, motion of the end per yaw of the jaws


def jaw_tips(arm: str, jpos: Vec) -> tuple[InstrumentPoint, InstrumentPoint]:
    """Return the tips of both jaws at `jpos` (7), which rotate about axis 6 by -grasp1, grasp2."""
    chain = kinematics.chain_of(arm, jpos)
    return _jaw_tip(arm, chain, jpos[5], -1.0, 5), _jaw_tip(arm, chain, jpos[6], 1.0, 6)


def instrument_line(arm: str, jpos: Vec) -> InstrumentLine:
    """Return the instrument's line at `jpos` (7, rad and m)."""
    chain = kinematics.chain_of(arm, jpos)
    to_end, turn = _jaw(chain, jaw_yaw(jpos))
    return InstrumentLine(chain, chain.z3 * (jpos[2] + D4), chain.tip + to_end, turn)


def point_on(arm: str, line: InstrumentLine, at: Vec, share: Scalar) -> InstrumentPoint:
    """Return the point at `at` (m) of an instrument, with its Jacobian.

    share: position of the point between wrist and end, 0 to 1; 0 on the shaft.
    """
    chain = line.chain
    from_wrist = (line.end - line.wrist) * share
    jaw_motion = line.turn * (share * 0.5)
    columns = _positioning_columns(arm, chain, at, from_wrist)
    return InstrumentPoint(at, (*columns, -jaw_motion, jaw_motion))


def _jaw_tip(
    arm: str, chain: kinematics.ChainAxes, angle: Scalar, sign: float, joint: int
) -> InstrumentPoint:
    # Returns the tip of one jaw. sign: direction in which its joint rotates it about axis 6.
    to_tip, turn = _jaw(chain, mul(sign, angle))
    at = chain.tip + to_tip
    jaw_motion = scale(sign, turn)
    jaws = (jaw_motion, _STILL) if joint == 5 else (_STILL, jaw_motion)
    columns = _positioning_columns(arm, chain, at, chain.x5 * LW + to_tip)
    return InstrumentPoint(at, (*columns, *jaws))


def _jaw(chain: kinematics.ChainAxes, angle: Scalar):
    """Return the vector from jaw axis to jaw tip (m) at `angle` (rad), and its rate (m/rad)."""
    c, s = jnp.cos(angle) * JAW_LENGTH, jnp.sin(angle) * JAW_LENGTH
    return chain.x5 * c - chain.y4 * s, -(chain.x5 * s + chain.y4 * c)


def _positioning_columns(arm: str, chain: kinematics.ChainAxes, at: Vec, from_wrist: Vec):
    """Return the Jacobian's columns of joints 1-5. from_wrist: vector from wrist to point, m."""
    flip = GEOMETRY[arm].flip
    return (
        Vec((mul(-flip, at[1]), mul(flip, at[0]), 0.0)),
        cross(chain.z2, at),
        chain.z3,
        cross(chain.z3, from_wrist),
        cross(from_wrist, chain.y4),
    )
