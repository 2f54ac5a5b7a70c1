"""Writes the mass matrix and bias torques of a tree of rigid links as a program without loops.

The bias contains Coriolis, centrifugal and gravity torques, with the sign of MuJoCo's qfrc_bias.
The mass matrix uses the composite-rigid-body algorithm and the bias uses recursive Newton-Euler.
Both share the kinematics. A body has mass m and, about its origin, first moments of mass h and
second moments J. Its origin has the acceleration a, and U = [alpha]x + [omega]x^2. The force on the
body is f = U h + m a. The torque n on the body is the integral of r x (U r + a) over its mass. The
shared U saves operations, compared with Euler's form (W. Khalil's symbolic method).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from ravenjax.ir.program import Program
from ravenjax.ir.symbolic import Number, build_program, cos, make_symbols, replay_program, sin
from ravenjax.numbers import Vec
from ravenjax.numbers.algebra import cross, matrix

if TYPE_CHECKING:
    from ravenjax.mechanics.rigid_tree import Link  # imports MuJoCo

Matrix: TypeAlias = list[list[Number]]
Turn: TypeAlias = tuple[int, Number, Number]  # axis (0: x, 2: z), cosine, sine

ZERO = Vec.full(3, 0.0)


@dataclasses.dataclass
class _Body:
    """A moving link; all numbers are in its own frame."""

    turns: list[Turn]  # rotations to the parent frame, outermost first
    position: Vec  # position of the origin in the parent frame
    omega: Vec  # angular velocity
    matrix: Vec  # U
    wrench: tuple[Vec, Vec]  # moment and force of the body, for the bias
    # Of the link with all that it carries: J, the integral of r r^T dm; h, that of r dm; mass.
    second_moments: Matrix
    first_moment: Vec
    mass: Number


def mass_matrix_and_bias(
    links: Sequence[Link], known: tuple[float | None, ...] | None = None
) -> Program:
    """Return a program that computes the mass matrix M and the bias torques from joint positions,
    joint velocities and gravity (3, in the base frame).

    M is symmetric and is returned as its lower triangle, row by row, without armature. Entries that
    are constant for this tree are Python numbers. known: for each of the 2 n + 3 inputs its value
    if it is constant, or None.
    """
    n = len(links)
    inputs = make_symbols(2 * n + 3)
    constants = known or (None,) * len(inputs)
    values: list[Number] = [
        symbol if constant is None else constant
        for symbol, constant in zip(inputs, constants, strict=True)
    ]
    qpos, qvel, gravity = values[:n], values[n : 2 * n], values[2 * n :]
    bodies = _kinematics(links, qpos, qvel, -Vec(gravity))
    bias = _bias(links, bodies)
    mass = _mass_matrix(links, bodies)
    triangle = [mass[i][j] for i in range(n) for j in range(i + 1)]
    return build_program(inputs, triangle + bias)


def evaluate_program(
    program_for: Callable[[tuple[float | None, ...]], Program], inputs: Sequence[Any]
) -> tuple[list[list[Any]], list[Any]]:
    """Run the program of `mass_matrix_and_bias`. Return the rows of the mass matrix, and the bias.

    inputs: positions, speeds, gravity (3). Python numbers among them are constants, for which the
    program is simplified. program_for: (value of each input, or None if it is not constant) ->
    program.
    """
    known = tuple(float(x) if type(x) in (int, float) else None for x in inputs)
    outputs = replay_program(program_for(known), inputs)
    n = (len(inputs) - 3) // 2
    # The outputs are the rows of the lower triangle, then the bias.
    triangle = [outputs[i * (i + 1) // 2 : (i + 1) * (i + 2) // 2] for i in range(n)]
    rows = [[triangle[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
    return rows, outputs[-n:]


def carried_point(links: Sequence[Link], qpos: Vec, index: int, point: Vec) -> Vec:
    """Return the position in the base (m) of a point in the frame of link `index`; -1: the base."""
    symbols = make_symbols(len(links))
    while index >= 0:
        turns, position = _pose(links[index], symbols[index])
        point = position + _rotate(turns, point)
        index = links[index].parent
    return Vec(replay_program(build_program(symbols, list(point)), qpos))


def point_in_link(links: Sequence[Link], qpos: Vec, index: int, point: Vec) -> Vec:
    """Return a point, given in the frame of the base, in the frame of link `index`, m."""
    if index < 0:
        return point
    turns, position = _pose(links[index], qpos[index])
    in_parent = point_in_link(links, qpos, links[index].parent, point)
    return _rotate_back(turns, in_parent - position)


def _pose(link: Link, q: Number) -> tuple[list[Turn], Vec]:
    # Returns the rotations from a link's frame to its parent's, outermost first, and the position
    # of its origin there. q: position of the joint, rad about z or m along z.
    travel = q - link.reference if link.slide else 0.0
    last_turn = _turn(2, link.offset) if link.slide else _turn(2, link.offset, q)
    turns = [_turn(2, link.beta), _turn(0, link.alpha), last_turn]
    # A rotation by 0, with cosine 1 and sine 0, is left out.
    turns = [turn for turn in turns if turn[1:] != (1.0, 0.0)]
    return turns, Vec(link.position) + _rotate(turns, Vec((0.0, 0.0, travel)))


def _kinematics(
    links: Sequence[Link], qpos: list[Number], qvel: list[Number], upward: Vec
) -> list[_Body]:
    # Returns each link's motion without joint accelerations, and its wrench: the moment and the
    # force that this motion needs. upward: minus gravity, with which the base accelerates instead.
    bodies: list[_Body] = []
    # Angular acceleration of each link, and acceleration of its origin.
    accelerations: list[tuple[Vec, Vec]] = []
    for link, q, rate in zip(links, qpos, qvel, strict=True):
        turns, position = _pose(link, q)
        if link.parent < 0:
            omega, alpha, accel = ZERO, ZERO, upward
        else:
            parent = bodies[link.parent]
            alpha, accel = accelerations[link.parent]
            omega, accel = parent.omega, accel + _apply(parent.matrix, position)
        omega, alpha, accel = (_rotate_back(turns, v) for v in (omega, alpha, accel))
        # The joint moves along or about z. Its Coriolis acceleration has no z component.
        if link.slide:
            accel = accel + Vec((omega[1] * rate * 2.0, -(omega[0] * rate * 2.0), 0.0))
        else:
            alpha = alpha + Vec((omega[1] * rate, -(omega[0] * rate), 0.0))
            omega = omega.replace(2, omega[2] + rate)
        U = _acceleration_matrix(omega, alpha)
        # The pseudo-inertia is [[J, h], [h^T, mass]].
        *rows, (*first_moment, mass) = link.pseudo_inertia.tolist()
        J, h = [row[:3] for row in rows], Vec(first_moment)
        force = _apply(U, h) + accel * mass
        moment = _moment(U, J) + cross(h, accel)
        accelerations.append((alpha, accel))
        bodies.append(_Body(turns, position, omega, U, (moment, force), J, h, mass))
    return bodies


def _bias(links: Sequence[Link], bodies: list[_Body]) -> list[Number]:
    # Returns the bias of each joint: the wrenches of all links it carries, along the joint's axis.
    wrenches = [body.wrench for body in bodies]
    bias: list[Number] = [0.0] * len(links)
    for index in reversed(range(len(links))):
        moment, force = wrenches[index]
        bias[index] = force[2] if links[index].slide else moment[2]
        parent = links[index].parent
        if parent >= 0:
            moment, force = _to_parent(bodies[index], moment, force)
            wrenches[parent] = wrenches[parent][0] + moment, wrenches[parent][1] + force
    return bias


def _mass_matrix(links: Sequence[Link], bodies: list[_Body]) -> Matrix:
    """Return the lower triangle of the mass matrix, by the composite-rigid-body method. A unit
    acceleration of a joint needs a wrench on all bodies that the joint carries. The joint's row
    contains the components of this wrench along the axes of the joint and its ancestors.
    """
    n = len(links)
    inertia: Matrix = [[0.0] * n for _ in range(n)]
    for index in reversed(range(n)):
        link, body = links[index], bodies[index]
        # h: integral of r dm. J: integral of r r^T dm. A unit acceleration along z needs the force
        # mass z and the moment h x z; one about z needs z x h and the integral of r x (z x r) dm.
        h, J = body.first_moment, body.second_moments
        if link.slide:
            moment, force = Vec((h[1], -h[0], 0.0)), Vec((0.0, 0.0, body.mass))
        else:
            moment = Vec((-J[0][2], -J[1][2], J[0][0] + J[1][1]))
            force = Vec((-h[1], h[0], 0.0))
        ancestor = index
        while ancestor >= 0:
            inertia[index][ancestor] = force[2] if links[ancestor].slide else moment[2]
            moment, force = _to_parent(bodies[ancestor], moment, force)
            ancestor = links[ancestor].parent
        if link.parent >= 0:
            _add_child(bodies[link.parent], body)
    return inertia


def _add_child(parent: _Body, child: _Body):
    # Adds the child's mass, first and second moments to the parent, in the parent's frame. The move
    # by p changes the second moments J to J + p (h + mass p)^T + h p^T.
    p = child.position
    J, total = child.second_moments, parent.second_moments
    for turn in reversed(child.turns):
        J = _turn_moments(turn, J)
    h = _rotate(child.turns, child.first_moment)
    moved = h + p * child.mass
    for i in range(3):
        for j in range(i + 1):
            total[i][j] = total[i][j] + J[i][j] + (p[i] * moved[j] + h[i] * p[j])
            total[j][i] = total[i][j]
    parent.first_moment = parent.first_moment + moved
    parent.mass = parent.mass + child.mass


def _to_parent(body: _Body, moment: Vec, force: Vec) -> tuple[Vec, Vec]:
    # Returns a wrench on the body in the frame of its parent.
    moment, force = _rotate(body.turns, moment), _rotate(body.turns, force)
    return moment + cross(body.position, force), force


def _turn(axis: int, offset: float, angle: Number = 0.0) -> Turn:
    """Return the rotation about an axis (0: x, 2: z) by offset + angle, rad. An offset that is a
    multiple of a right angle adds no operation: cos(angle + pi/2) is -sin(angle), and so on.
    """
    quarters = round(offset / (math.pi / 2))
    if offset != quarters * (math.pi / 2):
        return axis, cos(angle + offset), sin(angle + offset)
    c, s = cos(angle), sin(angle)
    return axis, *((c, s), (-s, c), (-c, -s), (s, -c))[quarters % 4]


def _rotate(turns: list[Turn], v: Vec) -> Vec:
    # Returns a vector after the rotations, of which the last one is applied first.
    for axis, c, s in reversed(turns):
        # The axes of the plane in which the rotation moves points.
        x, y = (axis + 1) % 3, (axis + 2) % 3
        v = v.replace(x, c * v[x] - s * v[y]).replace(y, s * v[x] + c * v[y])
    return v


def _rotate_back(turns: list[Turn], v: Vec) -> Vec:
    # Returns the vector that the rotations turn into `v`.
    return _rotate([(axis, c, -s) for axis, c, s in reversed(turns)], v)


def _turn_moments(turn: Turn, J: Matrix) -> Matrix:
    # Returns second moments after a rotation R about one axis, R J R^T; by 90 degrees it is exact.
    axis, c, s = turn
    # The axes of the plane in which the rotation moves points.
    x, y = (axis + 1) % 3, (axis + 2) % 3
    turned = [list(row) for row in J]
    if c == 0.0:
        turned[x][x], turned[y][y], across = J[y][y], J[x][x], -J[x][y]
    else:
        # With c^2 = 1 - s^2, the entry xx of R J R^T is J_xx + s (s (J_yy - J_xx) - 2 c J_xy).
        change = s * (J[y][y] - J[x][x]) - 2.0 * c * J[x][y]
        turned[x][x], turned[y][y] = J[x][x] + s * change, J[y][y] - s * change
        across = -(c * change + J[x][y])
    turned[x][y] = turned[y][x] = across
    turned[axis][x] = turned[x][axis] = c * J[axis][x] - s * J[axis][y]
    turned[axis][y] = turned[y][axis] = s * J[axis][x] + c * J[axis][y]
    return turned


def _acceleration_matrix(omega: Vec, alpha: Vec) -> Vec:
    # Returns U = [alpha]x + [omega]x^2. U r is the acceleration of the point r of a rotating body.
    (x, y, z), (a, b, c) = omega, alpha
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return matrix(
        (-(yy + zz), xy - c, xz + b), (xy + c, -(xx + zz), yz - a), (xz - b, yz + a, -(xx + yy))
    )


def _moment(U: Vec, J: Matrix) -> Vec:
    """Return the integral of r x (U r) dm over a body. J: integral of r r^T dm."""

    def component(i: int) -> Number:
        # The integral of r_j (U r)_k - r_k (U r)_j, in which the integral of r_a r_b is J[a][b].
        j, k = (i + 1) % 3, (i + 2) % 3
        total = (U[k][k] - U[j][j]) * J[j][k]
        total = total + (U[k][j] * J[j][j] - U[j][k] * J[k][k])
        return total + (U[k][i] * J[i][j] - U[j][i] * J[i][k])

    return Vec(map(component, range(3)))


def _apply(motion: Vec, v: Vec) -> Vec:
    return Vec(row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in motion)
