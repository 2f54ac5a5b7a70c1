"""Kinematics and quaternions in the original's manner: 4x4 matrices, eight solutions one by one,
ROS tf's formulas.

Shares no code with the package; see `oracle_control_software`.
"""

import math

GOLD, GREEN = 0, 1
DEG = math.pi / 180.0
LA12, LA23, D4, LW = 75 * math.pi / 180, 52 * math.pi / 180, -0.47, 0.013
GM1, GM2, GM3, GM4 = math.sin(LA12), math.cos(LA12), math.sin(LA23), math.cos(LA23)


# --- transforms: (R rows, p) ---


def multiply(a, b):
    (ra, _), (rb, pb) = a, b
    r = [
        [ra[i][0] * rb[0][j] + ra[i][1] * rb[1][j] + ra[i][2] * rb[2][j] for j in range(3)]
        for i in range(3)
    ]
    return r, apply(a, pb)


def apply(t, p):
    r, o = t
    return [r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2] + o[i] for i in range(3)]


def invert(t):
    r, p = t
    rt = [[r[j][i] for j in range(3)] for i in range(3)]
    return rt, apply((rt, [0.0] * 3), [-x for x in p])


def cofactor(m, r1, c1, r2, c2):
    return m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]


def invert_matrix(m):
    """By cofactors, as tf does even where the matrix is a rotation."""
    first = [cofactor(m, 1, 1, 2, 2), cofactor(m, 1, 2, 2, 0), cofactor(m, 1, 0, 2, 1)]
    s = divide(1.0, m[0][0] * first[0] + m[0][1] * first[1] + m[0][2] * first[2])
    return [
        [first[0] * s, cofactor(m, 0, 2, 2, 1) * s, cofactor(m, 0, 1, 1, 2) * s],
        [first[1] * s, cofactor(m, 0, 0, 2, 2) * s, cofactor(m, 0, 2, 1, 0) * s],
        [first[2] * s, cofactor(m, 0, 1, 2, 0) * s, cofactor(m, 0, 0, 1, 1) * s],
    ]


def rotate(m, v):
    return [m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2] for i in range(3)]


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
    """From the last link to the first: the original multiplies on its way back from a recursion."""
    t = parts[-1]
    for part in reversed(parts[:-1]):
        t = multiply(part, t)
    return t


OFFSETS = {
    GOLD: [205 * DEG, 180 * DEG, 0.0, 0.0, -90 * DEG, 0.0],
    GREEN: [25 * DEG, 0.0, 0.0, 0.0, -90 * DEG, 0.0],
}


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
        return (
            math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)
        )
    return a / b


def norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def inverse(arm, t06):
    """Eight (theta, valid); the return code."""
    solutions = [[[0.0] * 6, True] for _ in range(8)]
    _, p = invert(t06)
    p[2] = 0.0
    wrists, insertions = [], []
    for a in (0, 1):
        s = divide(1.0, norm(p))
        p = [x * s for x in p]  # in place: the second side normalises what the first has normalised
        wrists.append(apply(t06, [x * ((-1 + 2 * a) * LW) for x in p]))
        insertions.append(norm(wrists[a]))
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
        cosine = 1 / (GM1 * GM3) * (divide(-z, d) - GM2 * GM4 if gold else divide(z, d) + GM2 * GM4)
        if 1.0 < cosine < 1.0 + 1e-5:
            cosine = 1.0
        elif -1.0 - 1e-5 < cosine < -1.0:
            cosine = -1.0
        if cosine > 1.0 or cosine < -1.0:
            solutions[i][1] = False
            continue
        th[1] = math.acos(cosine) * (1 if i % 2 == 0 else -1)
        bb1 = math.sin(th[1]) * GM3
        if gold:
            bb2 = math.cos(th[1]) * GM2 * GM3 - GM1 * GM4
            b = [[bb1, bb2, 0.0], [-bb2, bb1, 0.0], [0.0, 0.0, 1.0]]
        else:
            bb2 = math.cos(th[1]) * GM2 * GM3 + GM1 * GM4
            b = [[bb1, bb2, 0.0], [bb2, -bb1, 0.0], [0.0, 0.0, 1.0]]
        c1, s1, _ = (x * divide(1, d) for x in rotate(invert_matrix(b), [p05[0], p05[1], 0.0]))
        th[0] = math.atan2(s1, c1)
        parts = links(arm, th)
        t03 = chain(parts[:3])
        r36, p36 = multiply(invert(t03), t06)
        c5, s5 = -r36[2][2], (p36[2] - D4) / LW
        if abs(c5) > 1e-5:
            c4, s4 = p36[0] / (LW * c5), p36[1] / (LW * c5)
        else:
            c4, s4 = divide(r36[0][2], s5), divide(r36[1][2], s5)
        th[3], th[4] = math.atan2(s4, c4), math.atan2(s5, c5)
        if abs(s5) > 1e-5:
            c6, s6 = r36[2][0] / s5, -r36[2][1] / s5
        else:
            t05 = multiply(t03, chain(links(arm, th)[3:5]))
            r56, _ = multiply(invert(t05), t06)
            c6, s6 = r56[0][0], r56[2][0]
        th[5] = math.atan2(s6, c6)
    return solutions, 0


def select(solutions, ref):
    """The chosen theta, or None."""
    best, least = None, 32765.0
    for th, valid in solutions:
        if not valid:
            continue
        if abs(ref[3] - th[3]) > 300 * DEG:
            th[3] += 2 * math.pi if ref[3] > th[3] else -2 * math.pi
        cost = 0.0
        for k in range(6):
            gap = (100 if k == 2 else 1) * (ref[k] - th[k])
            cost += gap * gap
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
