"""Kinematics and quaternions in the original's manner: 4x4 matrices, eight solutions one by one, ROS tf's formulas.

Shares no code with the package; see `oracle_control_software`.
"""

from __future__ import annotations

import math

GOLD, GREEN = 0, 1
DEG = math.pi / 180.0
LA12, LA23, D4, LW = 75 * DEG, 52 * DEG, -0.47, 0.013
GM1, GM2, GM3, GM4 = math.sin(LA12), math.cos(LA12), math.sin(LA23), math.cos(LA23)


# --- transforms: (R rows, p) ---


def multiply(a, b):
    (ra, _), (rb, pb) = a, b
    r = [[ra[i][0] * rb[0][j] + ra[i][1] * rb[1][j] + ra[i][2] * rb[2][j] for j in range(3)] for i in range(3)]
    return r, apply(a, pb)


def apply(t, p):
    r, o = t
    return [r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2] + o[i] for i in range(3)]


def invert(t):
    r, p = t
    rt = [[r[j][i] for j in range(3)] for i in range(3)]
    return rt, [-(rt[i][0] * p[0] + rt[i][1] * p[1] + rt[i][2] * p[2]) for i in range(3)]


def dh(alpha, a, theta, d):
    ca, sa, ct, st = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
    return [[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]], [a, -sa * d, ca * d]


def links(arm, th):
    """T01, T12, T23, T34, T45, T56; th = theta1, theta2, d3, theta4, theta5, theta6."""
    gold = arm == GOLD
    return [
        dh(0.0 if gold else math.pi, 0.0, th[0], 0.0),
        dh(LA12, 0.0, th[1], 0.0),
        dh(math.pi - LA23 if gold else LA23, 0.0, math.pi / 2 if gold else -math.pi / 2, th[2]),
        dh(0.0, 0.0, th[3], D4),
        dh(math.pi / 2, 0.0, th[4], 0.0),
        dh(math.pi / 2, LW, th[5], 0.0),
    ]


def chain(parts):
    t = parts[0]
    for part in parts[1:]:
        t = multiply(t, part)
    return t


OFFSETS = {GOLD: [205 * DEG, 180 * DEG, 0.0, 0.0, -90 * DEG, 0.0], GREEN: [25 * DEG, 0.0, 0.0, 0.0, -90 * DEG, 0.0]}


def wrap_pi(x):
    while x > math.pi:
        x -= 2 * math.pi
    while x < -math.pi:
        x += 2 * math.pi
    return x


def joint_to_theta(arm, js):
    return [wrap_pi(j + o) for j, o in zip(js, OFFSETS[arm], strict=True)]


def theta_to_joint(arm, th):
    js = [t - o for t, o in zip(th, OFFSETS[arm], strict=True)]
    return [j if i == 3 else wrap_pi(j) for i, j in enumerate(js)]


def forward(arm, js):
    return chain(links(arm, joint_to_theta(arm, js)))


def divide(a, b):
    if b == 0.0:
        return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)
    return a / b


def inverse(arm, t06):
    """Eight (theta, valid); the return code."""
    solutions = [[[0.0] * 6, True] for _ in range(8)]
    _, p = invert(t06)
    length = math.sqrt(p[0] * p[0] + p[1] * p[1])
    u = [divide(p[0], length), divide(p[1], length), 0.0]
    wrists, insertions = [], []
    for a in (0, 1):
        wrists.append(apply(t06, [(-1 + 2 * a) * LW * x for x in u]))
        insertions.append(math.sqrt(sum(x * x for x in wrists[a])))
    for a in (0, 1):
        if insertions[a] <= LW:
            for i in range(4):
                solutions[4 * a + i][1] = False
            return solutions, -2
        for i in range(4):
            solutions[4 * a + i][0][2] = -D4 - insertions[a] if i < 2 else -D4 + insertions[a]
    gold = arm == GOLD
    for i in range(8):
        th = solutions[i][0]
        p05 = wrists[i // 4]
        d = th[2] + D4
        z = p05[2]
        cosine = ((-z / d - GM2 * GM4) if gold else (z / d + GM2 * GM4)) / (GM1 * GM3)
        if 1.0 < cosine < 1.0 + 1e-5:
            cosine = 1.0
        elif -1.0 - 1e-5 < cosine < -1.0:
            cosine = -1.0
        if not -1.0 <= cosine <= 1.0:
            solutions[i][1] = False
            continue
        th[1] = math.acos(cosine) * (1 if i % 2 == 0 else -1)
        bb1 = math.sin(th[1]) * GM3
        x, y = p05[0] / d, p05[1] / d
        if gold:
            bb2 = math.cos(th[1]) * GM2 * GM3 - GM1 * GM4
            det = bb1 * bb1 + bb2 * bb2
            c1, s1 = (bb1 * x - bb2 * y) / det, (bb2 * x + bb1 * y) / det
        else:
            bb2 = math.cos(th[1]) * GM2 * GM3 + GM1 * GM4
            det = -bb1 * bb1 - bb2 * bb2
            c1, s1 = (-bb1 * x - bb2 * y) / det, (-bb2 * x + bb1 * y) / det
        th[0] = math.atan2(s1, c1)
        parts = links(arm, th)
        t03 = chain(parts[:3])
        r36, p36 = multiply(invert(t03), t06)
        c5, s5 = -r36[2][2], (p36[2] - D4) / LW
        if abs(c5) > 1e-5:
            c4, s4 = p36[0] / (LW * c5), p36[1] / (LW * c5)
        else:
            c4, s4 = r36[0][2] / s5, r36[1][2] / s5
        th[3], th[4] = math.atan2(s4, c4), math.atan2(s5, c5)
        if abs(s5) > 1e-5:
            c6, s6 = r36[2][0] / s5, -r36[2][1] / s5
        else:
            parts = links(arm, th)
            r56, _ = multiply(invert(chain(parts[:5])), t06)
            c6, s6 = r56[0][0], r56[2][0]
        th[5] = math.atan2(s6, c6)
    return solutions, 0


def select(solutions, ref):
    """The chosen theta, or None."""
    best, least = None, 32765.0
    for th, valid in solutions:
        if not valid:
            continue
        if ref[3] - th[3] > 300 * DEG:
            th[3] += 2 * math.pi
        elif ref[3] - th[3] < -300 * DEG:
            th[3] -= 2 * math.pi
        cost = sum((ref[k] - th[k]) ** 2 for k in (0, 1, 3, 4, 5)) + (100 * (ref[2] - th[2])) ** 2
        if cost < least:
            best, least = th, cost
    return None if best is None or least > math.pi else best


# --- quaternions of ROS tf ---


def matrix_of(q):
    x, y, z, w = q
    s = divide(2.0, x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    wx, wy, wz = w * xs, w * ys, w * zs
    xx, xy, xz, yy, yz, zz = x * xs, x * ys, x * zs, y * ys, y * zs, z * zs
    return [
        [1.0 - (yy + zz), xy - wz, xz + wy],
        [xy + wz, 1.0 - (xx + zz), yz - wx],
        [xz - wy, yz + wx, 1.0 - (xx + yy)],
    ]


def quaternion_of(m):
    q = [0.0] * 4
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        s = math.sqrt(trace + 1.0)
        q[3] = s * 0.5
        s = 0.5 / s
        q[0], q[1], q[2] = (m[2][1] - m[1][2]) * s, (m[0][2] - m[2][0]) * s, (m[1][0] - m[0][1]) * s
        return q
    i = (2 if m[1][1] < m[2][2] else 1) if m[0][0] < m[1][1] else (2 if m[0][0] < m[2][2] else 0)
    j, k = (i + 1) % 3, (i + 2) % 3
    s = math.sqrt(m[i][i] - m[j][j] - m[k][k] + 1.0)
    q[i] = s * 0.5
    s = divide(0.5, s)
    q[3] = (m[k][j] - m[j][k]) * s
    q[j] = (m[j][i] + m[i][j]) * s
    q[k] = (m[k][i] + m[i][k]) * s
    return q


def product(a, b):
    return [
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    ]
