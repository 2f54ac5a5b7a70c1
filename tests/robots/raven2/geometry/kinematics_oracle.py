"""The original's kinematics step by step on 4 x 4 matrices, as plainly as possible: an oracle
for the fast ones.
"""

from __future__ import annotations

import numpy as np

D = np.pi / 180
LA12, LA23, D4, LW = 75 * D, 52 * D, -0.47, 0.013
GM1, GM2, GM3, GM4 = np.sin(LA12), np.cos(LA12), np.sin(LA23), np.cos(LA23)
ALPHA = {
    "gold": np.array([0, 75, 128, 0, 90, 90]) * D,
    "green": np.array([180, 75, 52, 0, 90, 90]) * D,
}
THETA3 = {"gold": 90 * D, "green": -90 * D}
OFFSET = {
    "gold": np.array([205, 180, 0, 0, -90, 0]) * D,
    "green": np.array([25, 0, 0, 0, -90, 0]) * D,
}
ZERO = np.zeros(5)  # theta1, theta2, theta4, theta5, theta6 as initialised


def wrapped(angle: float) -> float:
    while angle > np.pi:
        angle -= 2 * np.pi
    while angle < -np.pi:
        angle += 2 * np.pi
    return angle


def link(alpha: float, a: float, theta: float, d: float) -> np.ndarray:
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st, 0, a],
            [st * ca, ct * ca, -sa, -sa * d],
            [st * sa, ct * sa, ca, ca * d],
            [0, 0, 0, 1],
        ]
    )


def links(arm: str, theta: np.ndarray) -> list[np.ndarray]:
    """T01 ... T56 from (theta1, theta2, d3, theta4, theta5, theta6)."""
    angles = (theta[0], theta[1], THETA3[arm], theta[3], theta[4], theta[5])
    offsets = zip(ALPHA[arm], (0, 0, 0, 0, 0, LW), angles, (0, 0, theta[2], D4, 0, 0), strict=True)
    return [link(alpha, a, angle, d) for alpha, a, angle, d in offsets]


def frames(arm: str, theta: np.ndarray) -> list[np.ndarray]:
    """T01, T02 ... T06."""
    product, out = np.eye(4), []
    for step in links(arm, theta):
        product = product @ step
        out.append(product)
    return out


def theta_of(arm: str, jpos: np.ndarray) -> np.ndarray:
    joints = np.array([*jpos[:5], (jpos[6] - jpos[5]) / 2])
    return np.array([wrapped(x) for x in joints + OFFSET[arm]])


def forward(arm: str, jpos: np.ndarray) -> np.ndarray:
    return frames(arm, theta_of(arm, jpos))[-1]


def jacobian(arm: str, jpos: np.ndarray) -> np.ndarray:
    t = frames(arm, theta_of(arm, jpos))
    columns = [np.r_[np.cross(f[:3, 2], t[5][:3, 3] - f[:3, 3]), f[:3, 2]] for f in t]
    columns[2] = np.r_[t[2][:3, 2], 0, 0, 0]
    return np.array(columns).T


def solutions(arm: str, t06: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """theta [8, 6], valid [8] and return code 0 or -2."""
    theta, valid = np.zeros((8, 6)), np.ones(8, bool)
    rotation, position = t06[:3, :3], t06[:3, 3]
    toward = -rotation.T @ position
    toward[2] = 0
    u = toward / np.sqrt(toward @ toward)
    wrists = [rotation @ ((-1 + 2 * a) * LW * u) + position for a in (0, 1)]
    for a, wrist in enumerate(wrists):
        insertion = np.sqrt(wrist @ wrist)
        if insertion <= LW:
            valid[4 * a : 4 * a + 4] = False
            return theta, valid, -2
        theta[4 * a : 4 * a + 2, 2] = -D4 - insertion
        theta[4 * a + 2 : 4 * a + 4, 2] = -D4 + insertion
    sign = 1 if arm == "gold" else -1
    for i in range(8):
        wrist, d = wrists[i // 4], theta[i, 2] + D4
        c2 = (-sign * wrist[2] / d - sign * GM2 * GM4) / (GM1 * GM3)
        if 1 < c2 < 1 + 1e-5 or -1 - 1e-5 < c2 < -1:
            c2 = np.sign(c2)
        if not abs(c2) <= 1:
            valid[i] = False
            continue
        theta[i, 1] = (1 if i % 2 == 0 else -1) * np.arccos(c2)
        b1, b2 = np.sin(theta[i, 1]) * GM3, np.cos(theta[i, 1]) * GM2 * GM3 - sign * GM1 * GM4
        b = np.array([[b1, b2], [-b2, b1]] if arm == "gold" else [[b1, b2], [b2, -b1]])
        c1, s1 = np.linalg.solve(b, wrist[:2] / d)
        theta[i, 0] = np.arctan2(s1, c1)
        t03 = frames(arm, theta[i])[2]
        t36 = np.linalg.inv(t03) @ t06
        c5, s5 = -t36[2, 2], (t36[2, 3] - D4) / LW
        if abs(c5) > 1e-5:
            c4, s4 = t36[0, 3] / (LW * c5), t36[1, 3] / (LW * c5)
        else:
            c4, s4 = t36[0, 2] / s5, t36[1, 2] / s5
        theta[i, 3], theta[i, 4] = np.arctan2(s4, c4), np.arctan2(s5, c5)
        if abs(s5) > 1e-5:
            c6, s6 = t36[2, 0] / s5, -t36[2, 1] / s5
        else:
            t56 = np.linalg.inv(frames(arm, theta[i])[4]) @ t06
            c6, s6 = t56[0, 0], t56[2, 0]
        theta[i, 5] = np.arctan2(s6, c6)
    return theta, valid, 0


def inverse(
    arm: str, t06: np.ndarray, grasp: float, jpos_ref: np.ndarray
) -> tuple[int, float, np.ndarray | None]:
    """Status (0, -1, -2 where taken in spite of the return code -2), cost and joints, None if
    rejected.
    """
    theta, valid, code = solutions(arm, t06)
    reference = theta_of(arm, jpos_ref)
    best, least = None, 32765.0
    for i in np.flatnonzero(valid):
        gap = reference[3] - theta[i, 3]
        if abs(gap) > 300 * D:
            theta[i, 3] += 2 * np.pi * np.sign(gap)
        difference = (reference - theta[i]) * np.array([1, 1, 100, 1, 1, 1])
        cost = difference @ difference
        if cost < least:
            best, least = i, cost
    if best is None or least > np.pi:
        return -1, least, None
    joints = theta[best] - OFFSET[arm]
    for k in (0, 1, 4, 5):
        joints[k] = wrapped(joints[k])
    jaws = -joints[5] + grasp / 2, joints[5] + grasp / 2
    return code, least, np.array([*joints[:5], *jaws])
