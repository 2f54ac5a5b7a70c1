"""Defines the motor matrix T, which gives motor angles (rad) from joints (rad or m).

Instrument cables run along the insertion, so moving the insertion turns every tool capstan. The row
of a tool motor is therefore a multiple of the insertion motor's row, plus one entry for the tool's
joint. Products with T use these factors to save operations. Cable length follows the links, so tool
motors are coupled to the *joints*. The control software couples them to the insertion motor. At
rest both are equal.
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
    """`T[i] = rows[i] + ratio[i] * rows[Z]`.

    `rows` is lower triangular; `ratio` is zero for the positioning motors.
    """

    rows: tuple[Vec, ...]  # rad/rad or rad/m
    ratio: tuple[float, ...]  # 1
    # Motion of each joint, divided by its motion with a drum as drawn. Factors 1 add no operations.
    gain: Vec = AS_DRAWN

    def motors(self, joints: Vec) -> Vec:
        """Return T x: motor angles (or speeds) from joint angles (or speeds)."""
        joints = joints.map(_divide, self.gain)
        insertion = dot(self.rows[Z], joints)
        return Vec(
            insertion if i == Z else add(dot(self.rows[i], joints), mul(self.ratio[i], insertion))
            for i in range(N)
        )

    def joints(self, motors: Vec) -> Vec:
        """Return T^-1 x: joint angles (or speeds) from motor angles (or speeds)."""
        angles = []
        for i in range(N):
            rest = sub(motors[i], mul(self.ratio[i], motors[Z]))
            for j in range(i):
                rest = sub(rest, mul(self.rows[i][j], angles[j]))
            angles.append(rest * (1.0 / self.rows[i][i]))
        return Vec(angles).map(mul, self.gain)

    def loads(self, forces: Vec) -> Vec:
        """Return T^T f: joint torques (N m, N) from motor torques (N m)."""
        insertion = forces[Z]
        for i in range(N):
            insertion = add(insertion, mul(self.ratio[i], forces[i]))
        effective = [insertion if i == Z else forces[i] for i in range(N)]
        columns = zip(*self.rows, strict=True)
        torques = Vec(dot(Vec(column), Vec(effective)) for column in columns)
        return torques.map(_divide, self.gain)

    def carried(self, loads: Vec) -> Vec:
        """Return T^-T f: motor torques (N m) that balance `loads` (N m, N) on the joints."""
        drawn, loads = dataclasses.replace(self, gain=AS_DRAWN), loads.map(mul, self.gain)
        columns = [drawn.joints(Vec(float(i == j) for j in range(N))) for i in range(N)]
        return Vec(dot(column, loads) for column in columns)

    def congruence(self, weights: Vec) -> list[list[Scalar]]:
        """Return T^T diag(w) T with the lower triangle filled (entry [i][j] with j <= i)."""
        inner: list[list[Scalar]] = [[0.0] * N for _ in range(N)]
        for i in range(N):
            inner[i][i] = weights[i]
            if i > Z:
                shared = mul(self.ratio[i], weights[i])
                inner[i][Z] = shared
                inner[Z][Z] = add(inner[Z][Z], mul(self.ratio[i], shared))
        outer: list[list[Scalar]] = [[0.0] * N for _ in range(N)]
        for i in range(N):
            for j in range(i + 1):
                for row, column, factor in _terms(self.rows, i, j):
                    outer[row][column] = add(outer[row][column], mul(factor, inner[i][j]))
        inverse = [_divide(1.0, gain) for gain in self.gain]
        return [
            [mul(outer[i][j], mul(inverse[i], inverse[j])) if j <= i else 0.0 for j in range(N)]
            for i in range(N)
        ]


def _divide(a: Scalar, b: Scalar) -> Scalar:
    return a if type(b) in (int, float) and b == 1 else a / b


def _terms(rows: Sequence[Vec], i: int, j: int) -> list[tuple[int, int, float]]:
    """Return the terms of inner[i][j] in the lower half of rows^T inner rows.

    A term is (row, column, factor): entry [row][column] contains factor times inner[i][j].
    """
    factors: dict[tuple[int, int], float] = {}
    for a, b in ((i, j),) if i == j else ((i, j), (j, i)):
        for row in range(N):
            for column in range(row + 1):
                factor = rows[a][row] * rows[b][column]
                factors[row, column] = factors.get((row, column), 0.0) + factor
    return [(row, column, factor) for (row, column), factor in factors.items() if factor != 0.0]


@cache
def arm_coupling(arm: ArmName, tool: str, software: str) -> Coupling:
    """Return the coupling of an arm with a tool. `software` sets the sign of the first jaw."""
    matrix = transmission.motor_matrix(arm, tool, software)
    ratio = tuple(matrix[i][Z] / matrix[Z][Z] if i > Z else 0.0 for i in range(N))
    rows = tuple(
        Vec(
            _clean(matrix[i][j] - ratio[i] * matrix[Z][j], matrix[i][j]) if i > Z else matrix[i][j]
            for j in range(N)
        )
        for i in range(N)
    )
    return Coupling(rows=rows, ratio=ratio)


def _clean(value: float, scale: float) -> float:
    return 0.0 if abs(value) <= 1e-9 * abs(scale) else value
