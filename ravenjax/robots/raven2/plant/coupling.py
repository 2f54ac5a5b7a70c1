"""Defines the motor matrix T, which gives motor angles (rad) from joints (rad or m).

Instrument cables run along the insertion, so moving the insertion turns every tool capstan. The row
of a tool motor is therefore a multiple of the insertion motor's row, plus one entry for the tool's
joint. Products with T use these factors to save operations. Cable length follows the links, so tool
motors are coupled to the *joint* of the insertion. The control software couples them to the *motor*
of the insertion. Joint and motor agree if no cable is stretched.
"""

import dataclasses
from collections.abc import Sequence
from functools import cache

from ravenjax.numbers import Scalar, Vec
from ravenjax.numbers.algebra import add, dot, mul, sub
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission

Z = 2  # index of the insertion
N = 7
AS_DRAWN = Vec.full(N, 1.0)


@dataclasses.dataclass(frozen=True)
class Coupling:
    """`T[i][j] = (rows[i][j] + ratio[i] * rows[Z][j]) / gain[j]`, where Z is the insertion.

    `rows` is lower triangular; `ratio` is zero for the positioning motors.
    """

    rows: tuple[Vec, ...]  # rad/rad or rad/m
    ratio: tuple[float, ...]  # 1
    # Motion of each joint, divided by its motion with a drum as drawn. Factors 1 add no operations.
    gain: Vec = AS_DRAWN

    def to_motors(self, joints: Vec) -> Vec:
        """Return T x: motor angles (or speeds) from joint positions (or speeds)."""
        joints = joints.map(_divide, self.gain)
        insertion = dot(self.rows[Z], joints)
        return Vec(
            insertion if i == Z else add(dot(self.rows[i], joints), mul(self.ratio[i], insertion))
            for i in range(N)
        )

    def to_joints(self, motors: Vec) -> Vec:
        """Return T^-1 x: joint positions (or speeds) from motor angles (or speeds)."""
        joints = []
        # `rows` is lower triangular, so each joint follows from the joints before it.
        for i in range(N):
            remainder = sub(motors[i], mul(self.ratio[i], motors[Z]))
            for j in range(i):
                remainder = sub(remainder, mul(self.rows[i][j], joints[j]))
            joints.append(remainder * (1.0 / self.rows[i][i]))
        return Vec(joints).map(mul, self.gain)

    def joint_loads(self, torques: Vec) -> Vec:
        """Return T^T f: loads of the joints (N m; insertion N) from motor torques f (N m)."""
        # ratio[i] times the torque of motor i acts like a torque of the insertion's motor, Z.
        insertion = torques[Z]
        for i in range(N):
            insertion = add(insertion, mul(self.ratio[i], torques[i]))
        effective = torques.replace(Z, insertion)
        loads = Vec(dot(Vec(column), effective) for column in zip(*self.rows, strict=True))
        return loads.map(_divide, self.gain)

    def motor_torques(self, loads: Vec) -> Vec:
        """Return T^-T f: motor torques (N m) that balance loads f (N m; insertion N) on joints."""
        # T is D diag(1 / gain), where D is T with all gains 1. Therefore T^-T f is D^-T (gain f).
        drawn, loads = dataclasses.replace(self, gain=AS_DRAWN), loads.map(mul, self.gain)
        units = (Vec(float(i == j) for j in range(N)) for i in range(N))
        # Column i of D^-1, which D^-1 gives for unit vector i, is row i of D^-T.
        return Vec(dot(drawn.to_joints(unit), loads) for unit in units)

    def congruence(self, weights: Vec) -> list[list[Scalar]]:
        """Return the lower triangle of the symmetric matrix T^T W T; the other entries are 0. T is
        the motor matrix, and W the diagonal matrix of the weights.
        """
        # T is the matrix product R `rows` diag(1 / gain). R is the unit matrix, but in the column Z
        # of the insertion, R[i][Z] is ratio[i] for each tool motor i.
        # Step 1: compute the lower triangle of inner = R^T W R.
        inner: list[list[Scalar]] = [[0.0] * N for _ in range(N)]
        for i in range(N):
            inner[i][i] = weights[i]
            if i > Z:
                inner[i][Z] = mul(self.ratio[i], weights[i])
                inner[Z][Z] = add(inner[Z][Z], mul(self.ratio[i], inner[i][Z]))
        # Step 2: compute the lower triangle of outer = rows^T inner rows, term by term.
        outer: list[list[Scalar]] = [[0.0] * N for _ in range(N)]
        for i in range(N):
            for j in range(i + 1):
                for row, column, factor in _terms(self.rows, i, j):
                    outer[row][column] = add(outer[row][column], mul(factor, inner[i][j]))
        # Step 3: divide row i and column i of `outer` by gain[i].
        inverse = [_divide(1.0, gain) for gain in self.gain]
        return [
            [mul(outer[i][j], mul(inverse[i], inverse[j])) if j <= i else 0.0 for j in range(N)]
            for i in range(N)
        ]


def _divide(a: Scalar, b: Scalar) -> Scalar:
    # A constant 1 adds no operation to the tick.
    return a if type(b) in (int, float) and b == 1 else a / b


def _terms(rows: Sequence[Vec], i: int, j: int) -> list[tuple[int, int, float]]:
    """Return what the entry M[i][j] of a symmetric M adds to the lower half of rows^T M rows, as
    terms (row, column, factor): entry [row][column] of the product contains factor times M[i][j].
    """
    # Off the diagonal, the entry occurs twice in M.
    occurrences = [(i, j)] if i == j else [(i, j), (j, i)]
    factors: dict[tuple[int, int], float] = {}
    for a, b in occurrences:
        for row in range(N):
            for column in range(row + 1):
                factor = rows[a][row] * rows[b][column]
                factors[row, column] = factors.get((row, column), 0.0) + factor
    return [(row, column, factor) for (row, column), factor in factors.items() if factor != 0.0]


@cache
def arm_coupling(arm: ArmName, tool: str, software: str) -> Coupling:
    """Return the coupling of an arm with a tool. `software` sets the sign of the first jaw."""
    # A tool motor's row of the motor matrix is `ratio` times the insertion's row plus a remainder.
    # Most entries of the remainder are 0, which saves operations; rounding errors are set to 0.
    matrix = transmission.motor_matrix(arm, tool, software)
    ratio = tuple(matrix[i][Z] / matrix[Z][Z] if i > Z else 0.0 for i in range(N))
    rows = [Vec(matrix[i]) for i in range(Z + 1)]
    for i in range(Z + 1, N):
        remainder = Vec(matrix[i]) - Vec(matrix[Z]) * ratio[i]
        rows.append(remainder.map(_drop_rounding_error, matrix[i]))
    return Coupling(rows=tuple(rows), ratio=ratio)


def _drop_rounding_error(difference: float, minuend: float) -> float:
    return 0.0 if abs(difference) <= 1e-9 * abs(minuend) else difference
